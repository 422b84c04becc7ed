"""Content of a description file, independent of its format: links with shapes and masses."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

#: Kinds of shapes that can be packed, and kinds that are elements of an environment.
SOLIDS = ("box", "sphere", "cylinder", "capsule", "mesh")
PRIMITIVES = ("plane", "box", "sphere", "cylinder", "capsule")


@dataclass(frozen=True, eq=False)
class Shape:
    """One shape of a link.

    Attributes
    ----------
    kind : str
        One of `SOLIDS` or `PRIMITIVES`, or another name from the file.
    pose : (4, 4) array
        ``T_link_shape`` [m].
    size : tuple of float
        Edges of a box, radius of a sphere, radius and straight length of a cylinder or capsule [m]; normal of
        a plane.
    file : Path, optional
        File of a mesh.
    scale : (3,) array
        Scale of a mesh along its axes.
    friction, restitution : float, optional
        Surface properties, if the file has them.
    problem : str
        Reason why it cannot be used; empty if it can.
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
    """Mass properties of a link in the file.

    Attributes
    ----------
    mass : float
        [kg]
    pose : (4, 4) array
        ``T_link_inertial``; its origin is the centre of mass (COM) [m].
    inertia : (3, 3) array, optional
        About the COM, axes of ``pose`` [kg m^2]; None if the file has none.
    """

    mass: float
    pose: np.ndarray
    inertia: np.ndarray | None


@dataclass(frozen=True, eq=False)
class Link:
    """Rigid part of a description.

    Attributes
    ----------
    name : str
        Unique in its file.
    pose : (4, 4) array
        ``T_world_link`` [m].
    shapes : tuple of Shape
        Collision shapes, or visual shapes if there are no others.
    inertial : Inertial, optional
    moves : str
        What moves it, as the end of a sentence; empty if fixed.
    free : bool
        Whether it is a free body, not attached to anything.
    """

    name: str
    pose: np.ndarray
    shapes: tuple[Shape, ...]
    inertial: Inertial | None
    moves: str = ""
    free: bool = False


@dataclass(frozen=True, eq=False)
class Description:
    """All links of a file, and its omitted parts, one line each."""

    path: Path
    links: tuple[Link, ...]
    left_out: tuple[str, ...] = ()
