"""Boxes in space, for the probability that a body ends up inside."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..checks.array_field import Array, array_field
from ..checks.errors import InvalidEnvironmentError, InvalidRequestError
from ..checks.validation import array, positive, quaternion
from ..spatial.rotation import rotation_matrix


@dataclass(frozen=True, eq=False)
class BoxRegion:
    """Box in space, for the probability that a body ends up inside.

    Attributes
    ----------
    name : str
    size : (3,) array
        Edge lengths [m].
    position : (3,) array
        Centre, world frame [m].
    orientation : (4,) array
        Quaternion (x, y, z, w) of ``R_world_region``.

    Raises
    ------
    InvalidRequestError, InvalidEnvironmentError, NotFiniteError, InvalidOrientationError
    """

    name: str
    size: Array = array_field()
    position: Array = array_field((0.0, 0.0, 0.0))
    orientation: Array = array_field((0.0, 0.0, 0.0, 1.0))

    def __post_init__(self):
        if not isinstance(self.name, str) or not self.name:
            raise InvalidRequestError("must be a non-empty text", field="name of region", value=self.name)
        of = f"of region '{self.name}'"
        size = array(self.size, (3,), f"size {of}", InvalidEnvironmentError)
        for k in range(3):
            positive(size[k], f"size[{k}] {of}", InvalidEnvironmentError)
        object.__setattr__(self, "size", size)
        object.__setattr__(
            self, "position", array(self.position, (3,), f"position {of}", InvalidEnvironmentError)
        )
        object.__setattr__(self, "orientation", quaternion(self.orientation, f"orientation {of}"))

    def contains(self, points: np.ndarray) -> np.ndarray:
        """Return which points (..., 3) [m], world frame, lie in the box or on its surface."""
        return self.depths(points) >= 0.0

    def depths(self, points: np.ndarray) -> np.ndarray:
        """Return distances of points (..., 3) [m], world frame, from the nearest side; negative outside."""
        R = rotation_matrix(self.orientation)
        return (0.5 * self.size - np.abs((points - self.position) @ R)).min(axis=-1)
