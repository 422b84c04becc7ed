"""Fixed, exactly known surroundings of the bodies: half-spaces and boxes, without packings."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from .errors import InvalidEnvironmentError
from .materials import Surface, check_surface
from .validation import array, number, positive, quaternion


@dataclass(frozen=True, eq=False)
class Plane(Surface):
    """A half-space: floor, table top, wall; friction and restitution are those of a `Surface`.

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

    normal: np.ndarray = (0.0, 0.0, 1.0)
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


@dataclass(frozen=True, eq=False)
class Box(Surface):
    """A solid box: wall, shelf, bottom of a bin; friction and restitution are those of a `Surface`.

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

    size: np.ndarray
    position: np.ndarray = (0.0, 0.0, 0.0)
    orientation: np.ndarray = field(default=(0.0, 0.0, 0.0, 1.0))
    name: str = ""

    def __post_init__(self):
        size = array(self.size, (3,), "size", InvalidEnvironmentError)
        for k in range(3):
            positive(size[k], f"size[{k}]", InvalidEnvironmentError)
        object.__setattr__(self, "size", size)
        object.__setattr__(self, "position", array(self.position, (3,), "position", InvalidEnvironmentError))
        object.__setattr__(self, "orientation", quaternion(self.orientation, "orientation"))
        check_surface(self, error=InvalidEnvironmentError)


def element_names(environment) -> list[str]:
    """What each element is called: its own name, or ``plane_K`` or ``box_K`` by its number among all elements."""
    return [element.name or f"{type(element).__name__.lower()}_{k}" for k, element in enumerate(environment)]
