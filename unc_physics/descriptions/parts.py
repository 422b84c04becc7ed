"""What URDF, SDF and MJCF have in common: links with shapes and masses, XML, and referenced files."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from ..checks.errors import InvalidRequestError, LimitExceededError, UncPhysicsError
from ..checks.shown import counted

#: Kinds of shapes that can be packed, and kinds that are elements of an environment.
SOLIDS = ("box", "sphere", "cylinder", "capsule", "ellipsoid", "cone", "mesh")
PRIMITIVES = ("plane", "box", "sphere", "cylinder", "capsule")
#: Formats by the root of their files.
FORMATS = {"robot": "URDF", "sdf": "SDF", "mujoco": "MJCF"}
#: Keys of sizes in a URDF or SDF, and how many numbers each has.
_ROUND = (("radius", 1), ("length", 1))
_SIZES = {
    "box": (("size", 3),),
    "sphere": _ROUND[:1],
    "ellipsoid": (("radii", 3),),
    "plane": (("normal", 3),),
}
_SIZES |= dict.fromkeys(("cylinder", "capsule", "cone"), _ROUND)

_BYTES = 50_000_000  # largest size of a file
#: Environment variables with folders of packages and models.
_SEARCHED = ("AMENT_PREFIX_PATH", "ROS_PACKAGE_PATH", "GZ_SIM_RESOURCE_PATH", "GAZEBO_MODEL_PATH")


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
        Edges of a box, radius of a sphere, radius and straight length of a cylinder or capsule, radii of an
        ellipsoid, radius and length of a cone with its tip up [m]; normal of a plane.
    file : Path, optional
        File of a mesh.
    scale : (3,) array
        Scale of a mesh along its axes.
    convex : bool
        Whether a mesh stands for its convex hull.
    points : (n, 3) array, optional
        Points of a convex mesh without a file [m].
    friction, restitution : float, optional
        Surface properties, if the file has them.
    density : float, optional
        [kg/m^3], for a link whose mass comes from its shapes.
    problem : str
        Reason why it cannot be used; empty if it can.
    """

    kind: str
    pose: np.ndarray
    size: tuple[float, ...] = ()
    file: Path | None = None
    scale: np.ndarray = field(default_factory=lambda: np.ones(3))
    convex: bool = False
    points: np.ndarray | None = None
    friction: float | None = None
    restitution: float | None = None
    density: float | None = None
    problem: str = ""


@dataclass(frozen=True, eq=False)
class Inertial:
    """Mass properties of a link in the file.

    Attributes
    ----------
    mass : float, optional
        [kg]; None if it follows from densities.
    pose : (4, 4) array, optional
        ``T_link_inertial``; its origin is the centre of mass (COM) [m]. None if the shape has it.
    inertia : (3, 3) array, optional
        About the COM, axes of ``pose`` [kg m^2]; None if the shape has it.
    density : float, optional
        Of shapes without one, if mass, COM and inertia are those of the shapes [kg/m^3].
    """

    mass: float | None
    pose: np.ndarray | None = None
    inertia: np.ndarray | None = None
    density: float | None = None


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
    """All links of a file, its omitted parts, and how ambiguous parts are read, one line each."""

    path: Path
    links: tuple[Link, ...]
    left_out: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


def read_xml(path: Path, tag: str | None = None) -> ElementTree.Element:
    """Return the root of an XML file, which must not define entities; its tag is one of `FORMATS` if given.

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
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, RecursionError) as error:
        raise InvalidRequestError(f"is no XML: {error}", field=place) from None
    if tag is not None and root.tag != tag:
        raise InvalidRequestError(
            f"is no {FORMATS[tag]}: its root is not <{tag}>", field=place, value=root.tag
        )
    return root


def primitive_shape(kind: str, pose: np.ndarray, text_of: Callable[[str], str], **about) -> Shape:
    """Return a shape with sizes in a file; ``text_of`` returns the text of a key."""
    size = [read_numbers(text_of(key), count, f"{kind}/{key}") for key, count in _SIZES.get(kind, ())]
    return Shape(kind, pose, tuple(np.concatenate([np.zeros(0), *size]).tolist()), **about)


def mesh_shape(pose: np.ndarray, uri: str, base: Path, scale: str, problem: str = "", **about) -> Shape:
    """Return the shape of a mesh with a URI and the text of a scale; a URI that is not found is a problem."""
    file = referred(uri, base)
    factors = np.ones(3) * read_numbers(scale or "1", 1 if len(scale.split()) < 2 else 3, "mesh/scale")
    problem = problem or ("" if file else f"the mesh {uri} is not found")
    return Shape("mesh", pose, file=file, scale=factors, problem=problem, **about)


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


def read_numbers(text: str, count: int, field: str) -> np.ndarray:
    """Return finite numbers from a text; raise `InvalidRequestError` unless there are ``count``."""
    try:
        values = np.array([float(word) for word in text.split()])
    except ValueError:
        values = np.empty(0)
    if len(values) != count or not np.isfinite(values).all():
        finite = "" if np.isfinite(values).all() else ", finite"
        raise InvalidRequestError(f"must be {counted(count, 'number')}{finite}", field=field, value=text)
    return values


def transform(position, rotation) -> np.ndarray:
    """Return a transform (4, 4) of a position (3,) and a rotation matrix (3, 3) or (9,)."""
    T = np.eye(4)
    T[:3, 3], T[:3, :3] = position, np.reshape(rotation, (3, 3))
    return T


def matrix_of_quaternion(q, field) -> np.ndarray:
    """Return the matrix of a quaternion (x, y, z, w); raise `InvalidRequestError` if it is zero."""
    from scipy.spatial.transform import Rotation

    if not np.linalg.norm(q) > 0.0:
        raise InvalidRequestError("must not be zero", field=field, value=" ".join(f"{x:g}" for x in q))
    return Rotation.from_quat(q).as_matrix()
