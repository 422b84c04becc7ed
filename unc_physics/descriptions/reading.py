"""Read description files: text, referenced files, and the format from the file name."""

from __future__ import annotations

import os
import re
from importlib.util import find_spec
from pathlib import Path
from xml.etree import ElementTree

from ..checks.errors import InvalidRequestError, LimitExceededError, NotSupportedError, UncPhysicsError
from .parts import Description

#: Suffixes of description files.
URDF, SDF = (".urdf",), (".sdf", ".world")
_BYTES = 50_000_000  # largest size of a file
_NEEDED = ("manifold3d", "scipy", "trimesh", "yourdfpy")
#: Environment variables with folders of packages and models.
_SEARCHED = ("AMENT_PREFIX_PATH", "ROS_PACKAGE_PATH", "GZ_SIM_RESOURCE_PATH", "GAZEBO_MODEL_PATH")


def is_description(path) -> bool:
    """Return whether a file is read as URDF or SDF, by its suffix."""
    return Path(path).suffix.lower() in (*URDF, *SDF)


def require_libraries() -> None:
    """Raise `NotSupportedError` if a library for descriptions and meshes is missing."""
    missing = [name for name in _NEEDED if find_spec(name) is None]
    if missing:
        raise NotSupportedError(
            f"URDF and SDF need {' and '.join(missing)}: install the extra 'descriptions', or pip install"
            f" {' '.join(missing)}"
        )


def read_description(path, configuration=None) -> Description:
    """Read the links of a URDF or SDF file.

    Parameters
    ----------
    path : path-like
    configuration : mapping of str to float, optional
        Positions of a URDF's joints [rad or m], by name. By default links behind a joint count as moving.

    Raises
    ------
    InvalidRequestError, LimitExceededError, NotSupportedError
        If the file cannot be read, is too large, or is not a description, or a library is missing.
    """
    path = Path(path)
    if not is_description(path):
        raise InvalidRequestError(
            f"must end in one of {', '.join((*URDF, *SDF))}", field="description", value=str(path)
        )
    require_libraries()
    if path.suffix.lower() in URDF:
        from .urdf import read_urdf

        return read_urdf(path, configuration)
    if configuration:
        raise NotSupportedError("is for URDF files alone", field="configuration")
    from .sdf import read_sdf

    return read_sdf(path)


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
