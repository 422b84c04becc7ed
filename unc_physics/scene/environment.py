"""Fixed, exactly known surroundings of the bodies: solids of simple shapes, without packings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..checks.array_field import Array, array_field
from ..checks.errors import InvalidEnvironmentError
from ..checks.validation import array, number, positive, quaternion
from ..physics import shapes
from ..physics.rotation import rotation_matrix
from .materials import Surface, check_surface


class Element(Surface):
    """What all elements of the environment have beside their `Surface`; each kind is a class of its own.

    Attributes
    ----------
    shape : str
        Name of the shape, one of `physics.shapes.KINDS`.
    name : str
    position : (3,) array
        Origin of the element's frame, world frame [m].
    rotation : (3, 3) array
        ``R_world_element``.
    size_row : (3,) array
        What the shape's file takes for its size [m].
    """

    shape: ClassVar[str]
    name: str
    position: np.ndarray
    orientation: np.ndarray
    size_row: np.ndarray

    @property
    def kind(self) -> int:
        """Number of the shape's kind."""
        return shapes.KINDS[self.shape]

    @property
    def rotation(self) -> np.ndarray:
        """(3, 3): ``R_world_element``."""
        return rotation_matrix(self.orientation)

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest corner, each (3,), in the element's frame [m]; infinite where it has no end."""
        low, high = shapes.bounds(*self._row(), 0)
        return np.array(low), np.array(high)

    @property
    def finite(self) -> bool:
        """Whether the solid ends in every direction."""
        return bool(np.isfinite(self.bounds).all())

    def surface(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Signed distance of points from the surface [m], and its outward normal there; world frame.

        Parameters
        ----------
        points : (..., 3) array

        Returns
        -------
        distance : (...,) array
        normal : (..., 3) array
        """
        points, R = np.asarray(points, float), self.rotation
        local = np.ascontiguousarray(((points - self.position) @ R).reshape(-1, 3))
        distance, normal = shapes.surfaces(*self._row(), 0, local)
        return distance.reshape(points.shape[:-1]), (normal @ R.T).reshape(points.shape)

    def _row(self):
        return np.array([self.kind]), np.array([self.size_row], float)


@dataclass(frozen=True, eq=False)
class Plane(Element):
    """A half-space: floor, table top, wall.

    Attributes
    ----------
    normal : (3,) array
        Points out of the solid, world frame; normalised here.
    offset : float
        The solid is where ``normal . x <= offset`` [m], with the normalised normal.
    name : str
        By default the element's number in the scene says which it is.

    Raises
    ------
    InvalidEnvironmentError, NotFiniteError
    """

    shape = "plane"
    normal: Array = array_field((0.0, 0.0, 1.0))
    offset: float = 0.0
    name: str = ""

    def __post_init__(self):
        normal = array(self.normal, (3,), "normal", InvalidEnvironmentError)
        length = np.linalg.norm(normal)
        if not 1e-12 < length < np.inf:
            raise InvalidEnvironmentError("must have a direction", field="normal", value=normal.tolist())
        object.__setattr__(self, "normal", normal / length)
        object.__setattr__(self, "offset", number(self.offset, "offset", InvalidEnvironmentError))
        check_surface(self, error=InvalidEnvironmentError)

    @property
    def position(self) -> np.ndarray:
        """(3,): the point of the surface that is nearest to the world's origin [m]."""
        return self.offset * self.normal

    @property
    def rotation(self) -> np.ndarray:
        """(3, 3): a rotation matrix whose third column is the normal."""
        helper = np.eye(3)[np.argmin(np.abs(self.normal))]
        first = np.cross(helper, self.normal)
        first /= np.linalg.norm(first)
        return np.column_stack([first, np.cross(self.normal, first), self.normal])

    @property
    def size_row(self) -> np.ndarray:
        """(3,): a half-space has no size."""
        return np.zeros(3)


@dataclass(frozen=True, eq=False)
class Box(Element):
    """A solid box: wall, shelf, bottom of a bin.

    Attributes
    ----------
    size : (3,) array
        Edge lengths [m].
    position : (3,) array
        Of its centre, world frame [m].
    orientation : (4,) array
        Quaternion (x, y, z, w) of ``R_world_box``.
    name : str
        By default the element's number in the scene says which it is.

    Raises
    ------
    InvalidEnvironmentError, NotFiniteError, InvalidOrientationError
    """

    shape = "box"
    size: Array = array_field()
    position: Array = array_field((0.0, 0.0, 0.0))
    orientation: Array = array_field((0.0, 0.0, 0.0, 1.0))
    name: str = ""

    def __post_init__(self):
        size = array(self.size, (3,), "size", InvalidEnvironmentError)
        for k in range(3):
            positive(float(size[k]), f"size[{k}]", InvalidEnvironmentError)
        object.__setattr__(self, "size", size)
        _check_pose(self)

    @property
    def size_row(self) -> np.ndarray:
        """(3,): half the edge lengths [m]."""
        return 0.5 * self.size


@dataclass(frozen=True, eq=False)
class Sphere(Element):
    """A solid ball: a knob, a stone.

    Attributes
    ----------
    radius : float
        [m]
    position : (3,) array
        Of its centre, world frame [m].
    name : str
        By default the element's number in the scene says which it is.

    Raises
    ------
    InvalidEnvironmentError, NotFiniteError
    """

    shape = "sphere"
    orientation: ClassVar[tuple] = (0.0, 0.0, 0.0, 1.0)
    radius: float
    position: Array = array_field((0.0, 0.0, 0.0))
    name: str = ""

    def __post_init__(self):
        object.__setattr__(self, "radius", positive(self.radius, "radius", InvalidEnvironmentError))
        object.__setattr__(self, "position", array(self.position, (3,), "position", InvalidEnvironmentError))
        check_surface(self, error=InvalidEnvironmentError)

    @property
    def size_row(self) -> np.ndarray:
        """(3,): the radius [m]."""
        return np.array([self.radius, 0.0, 0.0])


@dataclass(frozen=True, eq=False)
class Cylinder(Element):
    """A solid cylinder: a post, a pipe, a pot.

    Attributes
    ----------
    radius : float
        [m]
    length : float
        Between its flat ends, along its z axis [m].
    position : (3,) array
        Of its middle, world frame [m].
    orientation : (4,) array
        Quaternion (x, y, z, w) of ``R_world_cylinder``.
    name : str
        By default the element's number in the scene says which it is.

    Raises
    ------
    InvalidEnvironmentError, NotFiniteError, InvalidOrientationError
    """

    shape = "cylinder"
    radius: float
    length: float
    position: Array = array_field((0.0, 0.0, 0.0))
    orientation: Array = array_field((0.0, 0.0, 0.0, 1.0))
    name: str = ""

    def __post_init__(self):
        _check_round(self)

    @property
    def size_row(self) -> np.ndarray:
        """(3,): radius and half the length [m]."""
        return np.array([self.radius, 0.5 * self.length, 0.0])


@dataclass(frozen=True, eq=False)
class Capsule(Element):
    """A cylinder with half a ball on each end: a rail, a robot's arm.

    Attributes
    ----------
    radius : float
        [m]
    length : float
        Of the straight part, along its z axis [m]; with its ends it is longer by two radii.
    position : (3,) array
        Of its middle, world frame [m].
    orientation : (4,) array
        Quaternion (x, y, z, w) of ``R_world_capsule``.
    name : str
        By default the element's number in the scene says which it is.

    Raises
    ------
    InvalidEnvironmentError, NotFiniteError, InvalidOrientationError
    """

    shape = "capsule"
    radius: float
    length: float
    position: Array = array_field((0.0, 0.0, 0.0))
    orientation: Array = array_field((0.0, 0.0, 0.0, 1.0))
    name: str = ""

    def __post_init__(self):
        _check_round(self)

    @property
    def size_row(self) -> np.ndarray:
        """(3,): radius and half the straight part's length [m]."""
        return np.array([self.radius, 0.5 * self.length, 0.0])


#: Class of each kind of element, by the name of its shape.
ELEMENTS = {element.shape: element for element in (Plane, Box, Sphere, Cylinder, Capsule)}


def element_names(environment) -> list[str]:
    """What each element is called: its name, or its shape and its number among all elements, as
    ``plane_0``.
    """
    return [element.name or f"{element.shape}_{k}" for k, element in enumerate(environment)]


def check_element(element, field) -> None:
    """Raise `InvalidEnvironmentError` for what is no element of a shape that the kernels know."""
    if not isinstance(element, Element) or getattr(element, "shape", None) not in shapes.KINDS:
        known = ", ".join(kind.__name__ for kind in ELEMENTS.values())
        raise InvalidEnvironmentError(f"must be one of {known}", field=field, value=element)


def _check_pose(element):
    position = array(element.position, (3,), "position", InvalidEnvironmentError)
    object.__setattr__(element, "position", position)
    object.__setattr__(element, "orientation", quaternion(element.orientation, "orientation"))
    check_surface(element, error=InvalidEnvironmentError)


def _check_round(element):
    for name in ("radius", "length"):
        object.__setattr__(element, name, positive(getattr(element, name), name, InvalidEnvironmentError))
    _check_pose(element)
