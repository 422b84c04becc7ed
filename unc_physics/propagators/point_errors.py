"""Errors of points about the one that began at the mean, for points in opposite pairs."""

from __future__ import annotations

import numpy as np

from ..compiler import kernel
from ..compiler.arrays import empty
from ..spatial.layout import ERROR
from ..spatial.moments import boxminus


def opposite_points(points: np.ndarray, moving: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the errors of points about the middle one, and those of the opposite points.

    Parameters
    ----------
    points : (2 n + 1, B, 13) array
        States, as from `PointPairs.point_states`.
    moving : (M,) int array
        Indices of the moving bodies.

    Returns
    -------
    errors, opposite : (n, M, 12) array
    """
    errors = errors_about_first(points).reshape(len(points), -1, ERROR)[:, moving]
    count = len(points) // 2
    return errors[1 : count + 1], errors[count + 1 :]


@kernel
def errors_about_first(states):
    """Return the errors (N, 12 B) of all states (N, B, 13) about the first."""
    count, bodies = states.shape[0], states.shape[1]
    errors = empty((count, ERROR * bodies))
    for n in range(count):
        for i in range(bodies):
            boxminus(states[n, i], states[0, i], errors[n, ERROR * i : ERROR * (i + 1)])
    return errors
