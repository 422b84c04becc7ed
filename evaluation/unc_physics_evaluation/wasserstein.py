"""W1 distance between samples of two distributions, for positions and for rotations."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import ot
from scipy.spatial.distance import cdist

from unc_physics.checks.errors import InvalidRequestError, UncPhysicsError
from unc_physics.spatial.layout import POSITION, QUATERNION

_PIVOTS = 10_000_000  # of the network simplex; a thousand points take some ten thousand


class Distance(NamedTuple):
    """W1 between two sets of states for each body.

    Attributes
    ----------
    position : (B,) array
        [m]
    rotation : (B,) array
        Geodesic [degrees].
    """

    position: np.ndarray
    rotation: np.ndarray


def euclidean(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return distances (n, m) between points ``x`` (n, 3) and ``y`` (m, 3)."""
    return cdist(x, y)


def geodesic(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return angles (n, m) [degrees] of the rotations from ``x`` (n, 4) to ``y`` (m, 4), unit quaternions.

    Notes
    -----
    They are computed from the shorter chord to y or -y, which are the same rotation. This is also exact for
    small angles, where the arc cosine of the scalar product loses half of the digits.
    """
    chord = np.minimum(cdist(x, y), cdist(x, -np.asarray(y)))
    return np.degrees(4.0 * np.arcsin(np.minimum(0.5 * chord, 1.0)))


def geodesic_of_pairs(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return elementwise angles (...) [degrees] between unit quaternions ``x`` and ``y`` (..., 4)."""
    chord = np.minimum(np.linalg.norm(x - y, axis=-1), np.linalg.norm(x + y, axis=-1))
    return np.degrees(4.0 * np.arcsin(np.minimum(0.5 * chord, 1.0)))


def wasserstein(x: np.ndarray, y: np.ndarray, distance: Callable = euclidean) -> float:
    """Return the exact W1 between two sets of samples of equal weights (network simplex of POT).

    Parameters
    ----------
    x : (n, k) array
    y : (m, k) array
    distance : callable
        `euclidean` or `geodesic`; its unit is that of the result.

    Raises
    ------
    InvalidRequestError
        If a set is empty or not finite.
    """
    _check(x, y)
    value, log = ot.emd2([], [], distance(x, y), numItermax=_PIVOTS, log=True)
    if log["warning"] is not None:
        raise UncPhysicsError(f"optimal transport failed: {log['warning']}")
    return float(value)


def state_distance(x: np.ndarray, y: np.ndarray) -> Distance:
    """Return the distance between two sets of scene states for each body.

    Parameters
    ----------
    x : (n, B, 13) array
    y : (m, B, 13) array
    """
    bodies = range(x.shape[1])
    return Distance(
        np.array([wasserstein(x[:, b, POSITION], y[:, b, POSITION], euclidean) for b in bodies]),
        np.array([wasserstein(x[:, b, QUATERNION], y[:, b, QUATERNION], geodesic) for b in bodies]),
    )


def _check(x, y):
    for name, points in (("x", x), ("y", y)):
        if len(points) == 0:
            raise InvalidRequestError("must hold at least one sample", field=name)
        if not np.isfinite(points).all():
            raise InvalidRequestError("must be finite", field=name)
