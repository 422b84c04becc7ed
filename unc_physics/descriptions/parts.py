"""What is read of a description file, whatever its format: links with their shapes and masses."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

#: Kinds of shapes that can be packed, and those that are elements of an environment as they are.
SOLIDS = ("box", "sphere", "cylinder", "capsule", "mesh")
PRIMITIVES = ("plane", "box", "sphere", "cylinder", "capsule")


@dataclass(frozen=True, eq=False)
class Shape:
    """One shape of a link.

    Attributes
    ----------
    kind : str
        One of `SOLIDS` or `PRIMITIVES`, or what else the file calls it.
    pose : (4, 4) array
        ``T_link_shape`` [m].
    size : tuple of float
        Of a box its edges, of a sphere its radius, of a cylinder and a capsule radius and length of the
        straight part [m]; of a plane its normal.
    file : Path, optional
        Of a mesh.
    scale : (3,) array
        Of a mesh, along its axes.
    friction, restitution : float, optional
        Of its surface, where the file says something.
    problem : str
        Why it cannot be used, if it cannot.
    """

    kind: str
    pose: np.ndarray
    size: tuple[float, ...] = ()
    file: Path | None = None
    scale: np.ndarray = field(default_factory=lambda: np.ones(3))
    friction: float | None = None
    restitution: float | None = None
    problem: str = ""


@dataclass(frozen=True, eq=False)
class Inertial:
    """Mass properties of a link as the file has them.

    Attributes
    ----------
    mass : float
        [kg]
    pose : (4, 4) array
        ``T_link_inertial``: its origin is the centre of mass (COM) [m].
    inertia : (3, 3) array, optional
        About the COM, axes of ``pose`` [kg m^2]; None where the file has none.
    """

    mass: float
    pose: np.ndarray
    inertia: np.ndarray | None


@dataclass(frozen=True, eq=False)
class Link:
    """One rigid part.

    Attributes
    ----------
    name : str
        As it is told from others in its file.
    pose : (4, 4) array
        ``T_world_link`` [m].
    shapes : tuple of Shape
        What it collides with; what it looks like, where the file has nothing else.
    inertial : Inertial, optional
    moves : str
        What lets it move, as the end of a sentence; nothing for what is fixed.
    free : bool
        Whether it is a body of its own, held by nothing.
    """

    name: str
    pose: np.ndarray
    shapes: tuple[Shape, ...]
    inertial: Inertial | None
    moves: str = ""
    free: bool = False


@dataclass(frozen=True, eq=False)
class Description:
    """All links of a file, and what of it was left out: one line each."""

    path: Path
    links: tuple[Link, ...]
    left_out: tuple[str, ...] = ()
