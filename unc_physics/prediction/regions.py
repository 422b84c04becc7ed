"""Boxes in space to ask about: how probable is it that a body ends up inside?"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ..checks.array_field import Array, array_field
from ..checks.errors import DuplicateIdError, InvalidEnvironmentError, InvalidRequestError
from ..checks.validation import array, instance, positive, quaternion
from ..physics.rotation import rotation_matrix


@dataclass(frozen=True, eq=False)
class BoxRegion:
    """A box in space to ask about.

    Attributes
    ----------
    name : str
    size : (3,) array
        Edge lengths [m].
    position : (3,) array
        Of its centre, world frame [m].
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
        """(...,) bool: which points (..., 3) [m], world frame, lie in the box or on its surface."""
        R = rotation_matrix(self.orientation)
        return (np.abs((points - self.position) @ R) <= 0.5 * self.size).all(axis=-1)


def checked_regions(regions: BoxRegion | Iterable[BoxRegion]) -> tuple[BoxRegion, ...]:
    """Regions as a tuple; their names must differ."""
    try:
        regions = (regions,) if isinstance(regions, BoxRegion) else tuple(regions)
    except TypeError:
        raise InvalidRequestError("must be a sequence of BoxRegion", field="regions", value=regions) from None
    names = []
    for k, region in enumerate(regions):
        instance(region, BoxRegion, f"regions[{k}]")
        if region.name in names:
            raise DuplicateIdError(
                "is the name of two regions", field=f"regions[{k}].name", value=region.name
            )
        names.append(region.name)
    return regions
