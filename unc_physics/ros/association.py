"""Association of observations with tracked objects."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from unc_physics_msgs.msg import ObjectState

from ..checks.errors import NotSupportedError
from ..spatial.layout import POSITION
from ..tracking.measurements import PoseMeasurement
from .detected import smallest_extent
from .models import ModelLibrary

_CONFIRMATION_TIME = 1.0  # s, within which a second observation confirms a new object without an id
_REMEMBERED = 2000  # observations that are recognized when they arrive again
_FORBIDDEN = 1e9  # cost of an impossible pair
#: Part of a pose covariance.
OF_POSITION = slice(0, 3)


class Place(NamedTuple):
    """Expected or observed place of an object.

    Attributes
    ----------
    model : str
    position : (3,) array
        World frame [m].
    covariance : (3, 3) array
        [m^2]
    """

    model: str
    position: np.ndarray
    covariance: np.ndarray

    @classmethod
    def of(cls, model: str, measurement: PoseMeasurement) -> Place:
        """Return the place of a measured pose."""
        covariance = measurement.covariance[OF_POSITION, OF_POSITION]
        return cls(model, measurement.pose[POSITION], covariance)


class ObservationMemory:
    """Earlier observations: those that may arrive again, and those of unconfirmed objects.

    Parameters
    ----------
    library : ModelLibrary
    """

    def __init__(self, library: ModelLibrary):
        self._library = library
        self._known: OrderedDict[tuple, None] = OrderedDict()
        self._candidates: list[tuple[Place, int]] = []  # first observations, and their stamps [ns]

    def new(
        self, stamp: int, observations: Sequence[tuple[ObjectState, PoseMeasurement]]
    ) -> list[tuple[ObjectState, PoseMeasurement]]:
        """Return the observations, of a stamp [ns], that have not arrived before."""
        found = []
        for state, measurement in observations:
            key = stamp, state.id, state.model, measurement.pose.tobytes()
            if key in self._known:
                continue
            self._known[key] = None
            if len(self._known) > _REMEMBERED:
                self._known.popitem(last=False)
            found.append((state, measurement))
        return found

    def same_object(self, place: Place, others: Mapping[str, Place]) -> str | None:
        """Return the id of the object of the same model that is too close to be another one."""
        shape = self._library.shape(place.model)
        nearest = 0.5 * smallest_extent(shape)
        for name, other in others.items():
            apart = float(np.linalg.norm(place.position - other.position))
            if place.model == other.model and apart < nearest:
                return name
        return None

    def confirms(self, place: Place, stamp: int, farthest: float) -> bool:
        """Return whether an observation confirms a new object; otherwise keep it as the first one.

        ``stamp`` is in ns, and ``farthest`` is the largest distance from the first observation [m].
        """
        self._candidates = [one for one in self._candidates if abs(stamp - one[1]) < 1e9 * _CONFIRMATION_TIME]
        for k, (other, first) in enumerate(self._candidates):
            apart = np.linalg.norm(place.position - other.position)
            if other.model == place.model and first != stamp and apart <= farthest:
                del self._candidates[k]
                return True
        self._candidates.append((place, stamp))
        return False


def assign(expected: Sequence[Place], observed: Sequence[Place], farthest: float) -> list[tuple[int, int]]:
    """Return the most likely pairs of an expected place and an observed one, as indices.

    Parameters
    ----------
    expected, observed : sequence of Place
    farthest : float
        Largest distance of a pair [m].

    Raises
    ------
    NotSupportedError
        Without SciPy.

    Notes
    -----
    As many pairs as possible are found. Among them, the sum of ``d^2 + log det S`` is least, where ``d`` is
    the Mahalanobis distance and ``S`` the sum of both covariances (the Hungarian method).
    """
    if not expected or not observed:
        return []
    costs = np.full((len(expected), len(observed)), _FORBIDDEN)
    for i, own in enumerate(expected):
        for j, other in enumerate(observed):
            apart = own.position - other.position
            if own.model == other.model and np.linalg.norm(apart) <= farthest:
                S = own.covariance + other.covariance
                costs[i, j] = apart @ np.linalg.solve(S, apart) + np.linalg.slogdet(S)[1]
    try:
        from scipy.optimize import linear_sum_assignment
    except ImportError:
        raise NotSupportedError("by distance needs SciPy: pip install scipy", field="association") from None
    rows, columns = linear_sum_assignment(costs)
    return [(int(i), int(j)) for i, j in zip(rows, columns, strict=True) if costs[i, j] < _FORBIDDEN]
