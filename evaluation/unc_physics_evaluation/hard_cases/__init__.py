"""The catalogue of hard cases: scene files at which a predictor is likely to fail, one folder of package
data.

Each file begins with a comment that says what is hard about it and what should come out.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import NamedTuple

from unc_physics.checks.errors import InvalidOptionError
from unc_physics.scene.belief import Belief
from unc_physics.scene.scene import Scene
from unc_physics.scene.scene_file import load_scene

FOLDER = Path(__file__).parent
SUFFIX = ".yaml"


class HardCase(NamedTuple):
    """A case of the catalogue.

    Attributes
    ----------
    scene : Scene
    belief : Belief
    horizon : float
        [s]
    about : str
        What is hard, and what should come out.
    """

    scene: Scene
    belief: Belief
    horizon: float
    about: str


def names() -> list[str]:
    """Names of all cases."""
    return sorted(path.stem for path in FOLDER.glob(f"*{SUFFIX}"))


def load(name: str) -> HardCase:
    """A case by its name.

    Raises
    ------
    InvalidOptionError
        If there is none.
    """
    path = _path(name)
    loaded = load_scene(path)
    return HardCase(loaded.scene, loaded.belief, loaded.horizon, _comment(path))


def digest(name: str) -> str:
    """Text that changes with the case's file."""
    return "file-" + hashlib.sha256(_path(name).read_bytes()).hexdigest()[:8]


def _path(name):
    path = FOLDER / f"{name}{SUFFIX}"
    if name not in names():
        raise InvalidOptionError("is no case of the catalogue", field="case", value=name)
    return path


def _comment(path):
    """The comment that the file begins with."""
    lines = []
    for line in path.read_text(encoding="utf-8").splitlines():
        if not line.startswith("#"):
            break
        lines.append(line.lstrip("# "))
    return " ".join(lines)
