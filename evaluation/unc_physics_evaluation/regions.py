"""Smallest regions with a share of a prediction's samples, and their shares of outcomes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from unc_physics.propagators.modes import Mode
from unc_physics.spatial.layout import ERR_POSITION, ERR_ROTATION, POSITION, QUATERNION
from unc_physics.spatial.quaternions import inverse, product, rotation_vectors

#: What a region is of: columns of a pose's error [dp, dtheta].
PARTS = {"position": slice(0, 3), "rotation": slice(3, 6), "pose": slice(0, 6)}
#: Standard deviations added to each, as contacts give way by so much [m], [rad].
_GIVES = np.repeat([5e-5, 1e-3], 3)


def held(modes: Sequence[Mode], samples: np.ndarray, outcomes: np.ndarray, level: float) -> dict[str, float]:
    """Return the share of outcomes in the region with a share ``level`` of the samples, for each of `PARTS`.

    Parameters
    ----------
    modes : sequence of Mode
        Modes of the body's state. With one mode, the region is an ellipsoid of equal Mahalanobis distance;
        with several, its boundary has equal density.
    samples, outcomes : (S, 13), (N, 13) arrays
        States of the body.
    level : float
        Share of the samples, such as 0.9.
    """
    shares = {}
    for name, part in PARTS.items():
        limit = np.quantile(_log_density(modes, samples, part), 1.0 - level)
        shares[name] = float(np.mean(_log_density(modes, outcomes, part) >= limit))
    return shares


def _log_density(modes, states, part):
    """Return the mixture's log density (N,) at states (N, 13)."""
    whole = np.full(len(states), -np.inf)
    for mode in modes:
        turned = rotation_vectors(product(inverse(mode.mean[QUATERNION]), states[:, QUATERNION]))
        errors = np.concatenate([states[:, POSITION] - mode.mean[POSITION], turned], axis=1)[:, part]
        own = np.r_[ERR_POSITION, ERR_ROTATION][part]
        P = mode.covariance[np.ix_(own, own)] + np.diag(_GIVES[part] ** 2)
        root = np.linalg.cholesky(P)
        distances = np.sum(np.linalg.solve(root, errors.T) ** 2, axis=0)
        one = np.log(mode.weight) - np.log(np.diag(root)).sum() - 0.5 * distances
        whole = np.logaddexp(whole, one)
    return whole
