"""Environment: fixed, exactly known solids of simple shapes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import cache, partial
from typing import Annotated, Any, ClassVar, get_type_hints

import numpy as np

from ..checks.array_field import Array, OptionalArray, array_field
from ..checks.errors import InvalidEnvironmentError, InvalidRequestError, LimitExceededError
from ..checks.names import with_named_arguments
from ..checks.validation import FARTHEST, array, non_negative, number, point, positive, quaternion
from ..physics.paper import solids
from ..shapes.pieces import HalfSpace, Piece
from ..shapes.primitive_models import SIZES, primitive_pieces
from ..spatial.rotation import rotation_matrix
from .materials import Surface, check_surface


def _length(value, field):
    length = positive(value, field, InvalidEnvironmentError)
    if length > FARTHEST:
        raise LimitExceededError(f"must be at most {FARTHEST:g} m", field=field, value=length)
    return length


def _lengths(value, field):
    found = array(value, (3,), field, InvalidEnvironmentError)
    for k, length in enumerate(found.tolist()):
        _length(length, f"{field}[{k}]")
    return found


def _direction(value, field):
    found = array(value, (3,), field, InvalidEnvironmentError)
    with np.errstate(over="ignore"):
        length = np.linalg.norm(found)
    if length == np.inf:  # its square overflows
        return _direction(found / np.abs(found).max(), field)
    if not length > 1e-12:
        raise InvalidEnvironmentError("must have a direction", field=field, value=found.tolist())
    return found / length


#: Types of an element's numeric fields with their checks. A check takes a value and the field's name, and
#: returns the value to store, or raises `InvalidEnvironmentError`.
Number = Annotated[float, partial(number, error=InvalidEnvironmentError)]
Length = Annotated[float, _length]
Lengths = Annotated[Array, _lengths]
Point = Annotated[Array, partial(point, error=InvalidEnvironmentError)]
Direction = Annotated[Array, _direction]
Orientation = Annotated[Array, quaternion]

_MOST_TILT = 0.5  # rad
#: Name that stands for any element of the environment.
ENVIRONMENT = "environment"
#: Distance from a solid, over its size, at which its nearest point is outermost, to 1e-7 of the size.
_FAR = 1e7
_ORIGIN, _UNTURNED = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)

#: Class of each kind of element by the name of its shape; subclasses register themselves.
ELEMENTS: dict[str, type[Element]] = {}


class ElementAttributes:
    """Attributes that every element has, as a field or as a property."""

    name: str
    position: np.ndarray
    orientation: np.ndarray
    size_row: np.ndarray


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Element(ElementAttributes, Surface):
    """Base class of all elements of the environment.

    Fields annotated with a check are checked on construction and are keys of scene files.

    Attributes
    ----------
    shape : str
        Name of the shape, one of `physics.paper.solids.KINDS`.
    name : str
        By default, shape and index in the scene identify the element.
    position : (3,) array
        Origin of the element's frame, world frame [m].
    rotation : (3, 3) array
        ``R_world_element``.
    size_row : (3,) array
        Size parameters [m], as defined in the shape's module.
    surface_tilt_std : float
        Standard deviation of the tilt of its z axis, or its normal, about each of two perpendicular axes
        [rad]. The position is fixed. Needs the implicit integrator.
    surface_velocity, surface_angular_velocity : (3,) array
        Velocity of its surface, as of a conveyor belt [m/s] or of a turntable [rad/s] about
        ``surface_center``, world frame. The element itself does not move; only the tangential part counts.
        Needs the implicit integrator.
    surface_center : (3,) array
        World frame [m]; by default the element's own position.

    Raises
    ------
    InvalidEnvironmentError, NotFiniteError, InvalidOrientationError
        If a field fails the check of its type.
    """

    shape: ClassVar[str]
    surface_tilt_std: float = 0.0
    surface_velocity: Array = array_field((0.0, 0.0, 0.0))
    surface_angular_velocity: Array = array_field((0.0, 0.0, 0.0))
    surface_center: OptionalArray = array_field(None)

    def __init_subclass__(cls):
        if "shape" in vars(cls) and cls.shape in solids.KINDS:
            ELEMENTS[cls.shape] = cls

    def __post_init__(self):
        for name, check in quantities(type(self)).items():
            object.__setattr__(self, name, check(getattr(self, name), name))
        check_surface(self, error=InvalidEnvironmentError)
        tilt = surface_tilt_std(self.surface_tilt_std, "surface_tilt_std")
        object.__setattr__(self, "surface_tilt_std", tilt)
        for name in ("surface_velocity", "surface_angular_velocity", "surface_center"):
            value = getattr(self, name)
            if name == "surface_center" and value is None:
                value = getattr(self, "position", (0.0, 0.0, 0.0))  # a plane has no position field
            object.__setattr__(self, name, array(value, (3,), name, InvalidEnvironmentError))

    @property
    def kind(self) -> int:
        """Index of the shape."""
        return solids.KINDS[self.shape]

    @property
    def rotation(self) -> np.ndarray:
        """(3, 3): ``R_world_element``."""
        return rotation_matrix(self.orientation)

    @property
    def pieces(self) -> tuple[Piece, ...]:
        """The solid as convex pieces, world frame."""
        own = primitive_pieces(self.shape, [getattr(self, name) for name in SIZES[self.shape]])
        return tuple(piece.moved(self.position, self.rotation) for piece in own)

    @property
    def moving_surface(self) -> np.ndarray:
        """Surface velocity at the world's origin [m/s] and angular velocity [rad/s], (6,)."""
        omega = self.surface_angular_velocity
        return np.concatenate([self.surface_velocity - np.cross(omega, self.surface_center), omega])

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest corner, each (3,), in the element's frame [m]; infinite where unbounded."""
        low, high = solids.bounds(*self._row(), 0)
        return np.array(low), np.array(high)

    @property
    def finite(self) -> bool:
        """Whether the solid is bounded in every direction."""
        return bool(np.isfinite(self.bounds).all())

    def outermost(self, directions: np.ndarray) -> np.ndarray:
        """Return the outermost points (n, 3) of a finite solid in given directions, world frame [m].

        Parameters
        ----------
        directions : (n, 3) array
            Unit vectors, world frame.
        """
        (low, high), R = self.bounds, self.rotation
        far = np.ascontiguousarray(_FAR * np.linalg.norm(high - low) * (directions @ R))
        distance, normal = solids.surfaces(*self._row(), 0, far)
        return (far - distance[:, None] * normal) @ R.T + self.position

    def surface(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the signed distance of points from the surface [m] and its outward normal, world frame.

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
        distance, normal = solids.surfaces(*self._row(), 0, local)
        return distance.reshape(points.shape[:-1]), (normal @ R.T).reshape(points.shape)

    def _row(self):
        return np.array([self.kind]), np.array([self.size_row], float)


def surface_tilt_std(value, field) -> float:
    """Return the number [rad], or raise `InvalidEnvironmentError` or `NotFiniteError` if it is invalid."""
    std = non_negative(value, field, InvalidEnvironmentError)
    if std > _MOST_TILT:
        raise InvalidEnvironmentError(f"must not exceed {_MOST_TILT:g} rad", field=field, value=std)
    return std


@cache
def quantities(kind: type[Element]) -> dict[str, Callable[[Any, str], Any]]:
    """Return the numeric fields of a kind of element, with their checks."""
    hints = get_type_hints(kind, include_extras=True)
    types = {spec.name: hints[spec.name] for spec in fields(kind)}
    return {name: hint.__metadata__[0] for name, hint in types.items() if hasattr(hint, "__metadata__")}


@with_named_arguments
@dataclass(frozen=True, eq=False, repr=False)
class Plane(Element):
    """A half-space: floor, table top, wall.

    Attributes
    ----------
    normal : (3,) array
        Outward normal, world frame; normalized on construction.
    offset : float
        The solid is the set ``normal . x <= offset`` [m], with the normalized normal.
    name : str
    """

    shape = "plane"
    normal: Direction = array_field((0.0, 0.0, 1.0))
    offset: Number = 0.0
    name: str = ""

    @property
    def position(self) -> np.ndarray:
        """Point of the surface nearest to the world's origin [m], (3,)."""
        return self.offset * self.normal

    @property
    def rotation(self) -> np.ndarray:
        """Rotation matrix (3, 3) whose third column is the normal."""
        helper = np.eye(3)[np.argmin(np.abs(self.normal))]
        first = np.cross(helper, self.normal)
        first /= np.linalg.norm(first)
        return np.column_stack([first, np.cross(self.normal, first), self.normal])

    @property
    def size_row(self) -> np.ndarray:
        """Zeros (3,): a half-space has no size."""
        return np.zeros(3)

    @property
    def pieces(self) -> tuple[Piece, ...]:
        """The solid as a half-space, world frame."""
        return (HalfSpace(self.position, self.normal),)


@with_named_arguments
@dataclass(frozen=True, eq=False, repr=False)
class Box(Element):
    """A solid box: wall, shelf, bottom of a bin.

    Attributes
    ----------
    size : (3,) array
        Edge lengths [m].
    position : (3,) array
        Position of its centre, world frame [m].
    orientation : (4,) array
        Quaternion (x, y, z, w) of ``R_world_box``.
    name : str
    """

    shape = "box"
    size: Lengths = array_field()
    position: Point = array_field(_ORIGIN)
    orientation: Orientation = array_field(_UNTURNED)
    name: str = ""

    @property
    def size_row(self) -> np.ndarray:
        """Half the edge lengths [m], (3,)."""
        return 0.5 * self.size


@with_named_arguments
@dataclass(frozen=True, eq=False, repr=False)
class Sphere(Element):
    """A solid ball.

    Attributes
    ----------
    radius : float
        [m]
    position : (3,) array
        Position of its centre, world frame [m].
    name : str
    """

    shape = "sphere"
    orientation: ClassVar[tuple] = _UNTURNED
    radius: Length
    position: Point = array_field(_ORIGIN)
    name: str = ""

    @property
    def size_row(self) -> np.ndarray:
        """Radius [m] and zeros, (3,)."""
        return np.array([self.radius, 0.0, 0.0])


@with_named_arguments
@dataclass(frozen=True, eq=False, repr=False)
class _AlongAxis(Element):
    """Element that is round about its z axis, with a straight part of ``length`` along it."""

    radius: Length
    length: Length
    position: Point = array_field(_ORIGIN)
    orientation: Orientation = array_field(_UNTURNED)
    name: str = ""

    @property
    def size_row(self) -> np.ndarray:
        """Radius and half the length [m], (3,)."""
        return np.array([self.radius, 0.5 * self.length, 0.0])


class Cylinder(_AlongAxis):
    """A solid cylinder: a post, a pipe, a pot.

    Attributes
    ----------
    radius : float
        [m]
    length : float
        Distance of its flat ends, along its z axis [m].
    position : (3,) array
        Position of its centre, world frame [m].
    orientation : (4,) array
        Quaternion (x, y, z, w) of ``R_world_cylinder``.
    name : str
    """

    shape = "cylinder"


class Capsule(_AlongAxis):
    """A cylinder with hemispherical ends: a rail, a robot's arm.

    Attributes
    ----------
    radius : float
        [m]
    length : float
        Length of the straight part along its z axis [m], without the hemispheres.
    position : (3,) array
        Position of its centre, world frame [m].
    orientation : (4,) array
        Quaternion (x, y, z, w) of ``R_world_capsule``.
    name : str
    """

    shape = "capsule"


def check_not_reserved(name: str, field: str) -> None:
    """Raise `InvalidRequestError` for the name that stands for all elements of an environment."""
    if name == ENVIRONMENT:
        raise InvalidRequestError(
            "is reserved for all elements of the environment together; choose another name",
            field=field,
            value=name,
        )


def element_names(environment) -> list[str]:
    """Return the name of each element, by default its shape and index, as in ``plane_0``."""
    return [element.name or f"{element.shape}_{k}" for k, element in enumerate(environment)]


def thing_names(scene) -> list[str]:
    """Return the names of a scene's bodies, then of its elements."""
    return [body.name for body in scene.bodies] + element_names(scene.environment)


def check_element(element, field) -> None:
    """Raise `InvalidEnvironmentError` unless ``element`` has a shape that the kernels support."""
    if not isinstance(element, Element) or getattr(element, "shape", None) not in solids.KINDS:
        known = ", ".join(kind.__name__ for kind in ELEMENTS.values())
        raise InvalidEnvironmentError(f"must be one of {known}", field=field, value=element)
