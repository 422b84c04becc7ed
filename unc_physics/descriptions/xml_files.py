"""Read XML files, and find the files that they reference."""

from __future__ import annotations

import os
import re
from pathlib import Path
from xml.etree import ElementTree

from ..checks.errors import InvalidRequestError, LimitExceededError, UncPhysicsError

_BYTES = 50_000_000  # largest size of a file
#: Environment variables with folders of packages and models.
_SEARCHED = ("AMENT_PREFIX_PATH", "ROS_PACKAGE_PATH", "GZ_SIM_RESOURCE_PATH", "GAZEBO_MODEL_PATH")


def read_xml(path: Path) -> tuple[str, ElementTree.Element]:
    """Return text and root of an XML file, which must not define entities.

    Raises
    ------
    InvalidRequestError, LimitExceededError
    """
    place = f"description {path}"
    try:
        size = path.stat().st_size
        if path.is_file() and size > _BYTES:
            raise LimitExceededError(f"must have at most {_BYTES} bytes", field=place, value=size)
        text = path.read_text(encoding="utf-8")
    except UncPhysicsError:
        raise
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or "it is not UTF-8 text"
        raise InvalidRequestError(f"cannot be read: {reason}", field=place) from None
    if "<!ENTITY" in text:
        raise InvalidRequestError("must define no entities", field=place)
    if re.search(r"<xacro:|\$\{", text):
        raise InvalidRequestError(
            "is a xacro file; make a URDF of it first: xacro FILE.xacro > FILE.urdf", field=place
        )
    try:
        return text, ElementTree.fromstring(text)
    except (ElementTree.ParseError, RecursionError) as error:
        raise InvalidRequestError(f"is no XML: {error}", field=place) from None


def referred(uri: str, base: Path) -> Path | None:
    """Return the path of a file that a description references, or None if it is not found.

    ``package://NAME/...`` and ``model://NAME/...`` are searched in folders NAME around the description, and
    in the folders of ROS and Gazebo environment variables. Other paths are relative to its folder.
    """
    scheme, separator, rest = uri.partition("://")
    if not separator:
        path = base / uri
        return path if path.exists() else None
    if scheme == "file":
        return Path(rest) if Path(rest).exists() else None
    if scheme not in ("package", "model"):
        return None
    folders = [base, *base.resolve().parents]
    for name in _SEARCHED:
        for entry in filter(None, os.environ.get(name, "").split(os.pathsep)):
            folders += [Path(entry), Path(entry) / "share"]
    package, _, inside = rest.partition("/")
    for folder in folders:
        if (folder / rest).exists():
            return folder / rest
        if folder.name == package and (folder / inside).exists():
            return folder / inside
    return None
