"""Read description files; the format follows from the file name."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

from ..checks.errors import InvalidRequestError, NotSupportedError
from .parts import Description
from .sdf import read_sdf
from .urdf import read_urdf

#: Suffixes of description files.
URDF, SDF = (".urdf",), (".sdf", ".world")
_NEEDED = ("manifold3d", "scipy", "trimesh", "yourdfpy")


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
        return read_urdf(path, configuration)
    if configuration:
        raise NotSupportedError("is for URDF files alone", field="configuration")
    return read_sdf(path)
