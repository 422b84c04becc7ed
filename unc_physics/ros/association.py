"""Association of observations with tracked objects of the same model, by their distances."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..checks.errors import NotSupportedError

_FORBIDDEN = 1e9  # cost of a pair that cannot be


class Place(NamedTuple):
    """Where an object is expected, or was observed.

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
