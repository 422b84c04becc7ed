"""Distance between two distributions given by samples: W1, for positions and for rotations."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import ot
from scipy.spatial.distance import cdist
from scipy.special import rel_entr

from unc_physics.checks.errors import InvalidRequestError, UncPhysicsError
from unc_physics.checks.validation import positive
from unc_physics.physics.layout import POSITION, QUATERNION
from unc_physics.prediction.prediction import Prediction

_PIVOTS = 10_000_000  # of the network simplex; a thousand points take some ten thousand
_SWEEPS = 10_000  # of Sinkhorn's iteration


class Distance(NamedTuple):
    """W1 between two sets of states, for each body.

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
    """Distances (n, m) between points ``x`` (n, 3) and ``y`` (m, 3), in their unit."""
    return cdist(x, y)


def geodesic(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Angles (n, m) [degrees] of the rotations that lead from ``x`` (n, 4) to ``y`` (m, 4), unit quaternions.

    Notes
    -----
    From the chord between the quaternions, the shorter to y or -y, which are one rotation: exact for small
    angles too, where the arc cosine of the scalar product loses half of the digits.
    """
    chord = np.minimum(cdist(x, y), cdist(x, -np.asarray(y)))
    return np.degrees(4.0 * np.arcsin(np.minimum(0.5 * chord, 1.0)))


def geodesic_of_pairs(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Angles (...) [degrees] between unit quaternions ``x`` (..., 4) and ``y``, each with its own."""
    chord = np.minimum(np.linalg.norm(x - y, axis=-1), np.linalg.norm(x + y, axis=-1))
    return np.degrees(4.0 * np.arcsin(np.minimum(0.5 * chord, 1.0)))


def wasserstein(x: np.ndarray, y: np.ndarray, distance: Callable = euclidean) -> float:
    """Exact W1 between two sets of samples of equal weights (network simplex of POT).

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


def sinkhorn_divergence(
    x: np.ndarray, y: np.ndarray, distance: Callable = euclidean, regularization: float = 0.05
) -> float:
    """Debiased entropic approximation of W1: ``S(x, y) - S(x, x) / 2 - S(y, y) / 2``.

    Only for comparison with results obtained by regularization: it takes longer than `wasserstein`, and reads
    less because it forgives differences below the regularization's scale.

    Parameters
    ----------
    x, y, distance
        As in `wasserstein`.
    regularization : float
        Weight of the entropy relative to the mean distance between x and y.

    Notes
    -----
    S is the least of ``<P, M> + eps KL(P | a b^T)`` over the plans P (Feydy et al. 2019).
    """
    _check(x, y)
    relative = positive(regularization, "regularization")
    M = distance(x, y)
    eps = relative * float(np.mean(M))
    if eps == 0.0:
        return 0.0
    return _entropic(M, eps) - 0.5 * _entropic(distance(x, x), eps) - 0.5 * _entropic(distance(y, y), eps)


def state_distance(x: np.ndarray, y: np.ndarray, measure: Callable = wasserstein) -> Distance:
    """Distance between two sets of scene states, body by body.

    Parameters
    ----------
    x : (n, B, 13) array
    y : (m, B, 13) array
    measure : callable
        `wasserstein` or `sinkhorn_divergence`.
    """
    bodies = range(x.shape[1])
    return Distance(
        np.array([measure(x[:, b, POSITION], y[:, b, POSITION], euclidean) for b in bodies]),
        np.array([measure(x[:, b, QUATERNION], y[:, b, QUATERNION], geodesic) for b in bodies]),
    )


def representatives(prediction: Prediction, count: int, rng: np.random.Generator) -> np.ndarray:
    """States (n, B, 13) that stand for a prediction's last belief.

    A propagator with samples is what these are, however few; from any other's belief ``count`` are drawn.
    """
    own = prediction.propagator.own_samples(prediction.carry, prediction.scene)
    return prediction.belief.sample(count, rng) if own is None else own


def _entropic(M, eps):
    plan = ot.sinkhorn([], [], M, eps, numItermax=_SWEEPS, stopThr=1e-7)
    return float(np.sum(plan * M) + eps * np.sum(rel_entr(plan, np.full_like(plan, 1.0 / plan.size))))


def _check(x, y):
    for name, points in (("x", x), ("y", y)):
        if len(points) == 0:
            raise InvalidRequestError("must hold at least one sample", field=name)
        if not np.isfinite(points).all():
            raise InvalidRequestError("must be finite", field=name)
