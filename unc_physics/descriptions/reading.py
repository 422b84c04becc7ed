"""Reading of description files: their text, what they refer to, and the format by the file's name."""

from __future__ import annotations

import os
import re
from importlib.util import find_spec
from pathlib import Path
from xml.etree import ElementTree

from ..checks.errors import InvalidRequestError, LimitExceededError, NotSupportedError, UncPhysicsError
from .parts import Description

#: Endings of files that are read as descriptions.
URDF, SDF = (".urdf",), (".sdf", ".world")
_BYTES = 50_000_000  # most of a file
_NEEDED = ("manifold3d", "scipy", "trimesh", "yourdfpy")
#: Environment variables with folders in which packages and models of that name are looked for.
_SEARCHED = ("AMENT_PREFIX_PATH", "ROS_PACKAGE_PATH", "GZ_SIM_RESOURCE_PATH", "GAZEBO_MODEL_PATH")


def is_description(path) -> bool:
    """Whether a file is read as URDF or SDF, by its ending."""
    return Path(path).suffix.lower() in (*URDF, *SDF)


def require_libraries() -> None:
    """Raise `NotSupportedError` where a library that reads descriptions and meshes is missing."""
    missing = [name for name in _NEEDED if find_spec(name) is None]
    if missing:
        raise NotSupportedError(
            f"URDF and SDF need {' and '.join(missing)}: install the extra 'descriptions', or pip install"
            f" {' '.join(missing)}"
        )


def read_description(path, configuration=None) -> Description:
    """The links of a URDF or SDF file.

    Parameters
    ----------
    path : path-like
    configuration : mapping of str to float, optional
        Positions of a URDF's joints [rad or m], by their names; by default links behind a joint count as
        moving.

    Raises
    ------
    InvalidRequestError, LimitExceededError, NotSupportedError
        For a file that cannot be read, is too large, or is no description, and for missing libraries.
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
    """Text and root of an XML file, which must define no entities.

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
    """The file that a description names, or None where it is not found.

    ``package://NAME/...`` and ``model://NAME/...`` are looked for in a folder NAME around the description,
    and in those of the environment variables of ROS and Gazebo; other paths start at its own folder.
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
