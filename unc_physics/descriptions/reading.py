"""Read description files; the format follows from the file name."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

from ..checks.errors import InvalidRequestError, NotSupportedError
from .mjcf import read_mjcf
from .parts import FORMATS, Description, read_xml
from .sdf import read_sdf
from .urdf import read_urdf

#: Suffixes of description files. The format of ``.xml`` follows from its root.
URDF, SDF, MJCF, XML = (".urdf",), (".sdf", ".world"), (".mjcf",), (".xml",)
_NEEDED = ("manifold3d", "scipy", "trimesh", "yourdfpy")


def is_description(path) -> bool:
    """Return whether a file is read as URDF, SDF or MJCF, by its suffix."""
    return Path(path).suffix.lower() in (*URDF, *SDF, *MJCF, *XML)


def require_libraries(*more: str) -> None:
    """Raise `NotSupportedError` if a library for descriptions and meshes is missing, or another one."""
    missing = [name for name in (*_NEEDED, *more) if find_spec(name) is None]
    if missing:
        extra = "mjcf" if "mujoco" in missing else "descriptions"
        raise NotSupportedError(
            f"URDF, SDF and MJCF need {' and '.join(missing)}: install the extra '{extra}', or pip install"
            f" {' '.join(missing)}"
        )


def read_description(path, configuration=None) -> Description:
    """Read the links of a URDF, SDF or MJCF file.

    Parameters
    ----------
    path : path-like
    configuration : mapping of str to float, optional
        Positions of joints [rad or m], by name. By default links behind a joint of a URDF count as moving,
        and joints of an MJCF stay at their start.

    Raises
    ------
    InvalidRequestError, LimitExceededError, NotSupportedError
        If the file cannot be read, is too large, or is not a description, or a library is missing.
    """
    path = Path(path)
    if not is_description(path):
        raise InvalidRequestError(
            f"must end in one of {', '.join((*URDF, *SDF, *MJCF, *XML))}",
            field="description",
            value=str(path),
        )
    suffix = path.suffix.lower()
    if suffix in XML:
        root = read_xml(path).tag
        suffix = f".{FORMATS.get(root, 'xml').lower()}"
        if suffix in XML:
            raise InvalidRequestError(
                "must have the root <robot> (URDF), <sdf> or <mujoco> (MJCF)",
                field=f"description {path}",
                value=root,
            )
    require_libraries(*(["mujoco"] if suffix in MJCF else []))
    if suffix in URDF:
        return read_urdf(path, configuration)
    if suffix in MJCF:
        return read_mjcf(path, configuration)
    if configuration:
        raise NotSupportedError("is for URDF and MJCF files", field="configuration")
    return read_sdf(path)
