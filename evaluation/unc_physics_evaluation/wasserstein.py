"""Distances between samples of two distributions, for positions and for rotations.

They are the exact W1, and the paper's metric: a Sinkhorn divergence of Python Optimal Transport (POT).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import ot
from scipy.spatial.distance import cdist

from unc_physics.checks.errors import InvalidRequestError, UncPhysicsError
from unc_physics.spatial.layout import POSITION, QUATERNION

#: Regularisations of the paper's metric [m], [degrees]. The paper does not give them; these reproduce its
#: Table 2 (``evaluation/notes/propagator_attempts.md``).
REGULARISATION = 0.1, 180.0
_PIVOTS = 10_000_000  # of the network simplex; a thousand points take some ten thousand
_CONVERGED = 1e-5  # norm of the error of Sinkhorn's marginals, which sum up to 1


class Distance(NamedTuple):
    """Distance between two sets of states for each body.

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


_PARTS = (POSITION, euclidean), (QUATERNION, geodesic)


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
    """Return the exact W1 between two sets of scene states for each body.

    Parameters
    ----------
    x : (n, B, 13) array
    y : (m, B, 13) array
    """
    bodies = range(x.shape[1])
    return Distance(
        *(
            np.array([wasserstein(x[:, b, part], y[:, b, part], distance) for b in bodies])
            for part, distance in _PARTS
        )
    )


class SinkhornDivergence:
    """The paper's metric: distances from one set of samples of equal weights, regularised and debiased.

    Parameters
    ----------
    x : (n, k) array
    distance : callable
        `euclidean` or `geodesic`; its unit is that of the result.
    regularisation : float
        In the same unit. The divergence is W1 if it is small, and half of the energy distance if it is large.
    """

    def __init__(self, x: np.ndarray, distance: Callable, regularisation: float):
        self.x, self.distance, self.regularisation = x, distance, regularisation
        self.own = self._cost(x, x)

    def to(self, y: np.ndarray) -> float:
        """Return the divergence to samples (m, k)."""
        _check(self.x, y)
        return max(0.0, self._cost(self.x, y) - 0.5 * (self.own + self._cost(y, y)))

    def _cost(self, x, y):
        cost = self.distance(x, y)
        # a sum of a row's and a column's numbers leaves the plan alone, and keeps exp(-cost) above zero
        shifted = cost - cost.min(axis=1, keepdims=True)
        shifted -= shifted.min(axis=0)
        plan = ot.sinkhorn([], [], shifted, self.regularisation, stopThr=_CONVERGED, warn=False)
        return float(np.sum(plan * cost))


class RegularisedDistance:
    """The paper's metric from one set of scene states (n, B, 13), as `state_distance` for W1."""

    def __init__(self, x: np.ndarray):
        self._divergences = [
            [
                SinkhornDivergence(x[:, b, part], distance, regularisation)
                for (part, distance), regularisation in zip(_PARTS, REGULARISATION, strict=True)
            ]
            for b in range(x.shape[1])
        ]

    def to(self, y: np.ndarray) -> Distance:
        """Return the distance to states (m, B, 13) for each body."""
        found = [
            [divergence.to(y[:, b, part]) for (part, _), divergence in zip(_PARTS, own, strict=True)]
            for b, own in enumerate(self._divergences)
        ]
        return Distance(*np.transpose(found))


def _check(x, y):
    for name, points in (("x", x), ("y", y)):
        if len(points) == 0:
            raise InvalidRequestError("must hold at least one sample", field=name)
        if not np.isfinite(points).all():
            raise InvalidRequestError("must be finite", field=name)
