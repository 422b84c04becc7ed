"""Outcomes that few rollouts miss, estimated from rollouts of a wider belief."""

from __future__ import annotations

import math

import numpy as np

from ..propagators.balanced_monte_carlo import WIDE
from ..propagators.emission import SPREAD_FLOORS
from ..propagators.sobol import quantile
from ..scene.belief import Belief
from ..scene.scene import Scene
from ..spatial.layout import POSITION, QUATERNION
from ..spatial.moments import pose_spreads

#: Rollouts of a wider belief in the search for rare outcomes; at most as many as the prediction has.
WIDE_ROLLOUTS = 24
#: Factor on a standard deviation from which on rare outcomes count.
MATTER = 1.4
_FAR = 8.0  # standard deviations; wide rollouts of a linear response stay below


def tail_factors(scene: Scene, belief: Belief, wide: np.ndarray) -> np.ndarray:
    """Return factors (B, 2) by which far outcomes widen the standard deviations of position and rotation.

    ``wide`` (R, B, 13) are states at the same time, of rollouts that began with `balanced_monte_carlo.WIDE`
    times the spread.
    """
    spreads = np.maximum(pose_spreads(belief.blocks), SPREAD_FLOORS)
    result = np.ones((len(scene.bodies), 2))
    for k, body in enumerate(scene.moving.tolist()):
        states, mean = wide[:, body], belief.mean[body]
        distance = np.linalg.norm(states[:, POSITION] - mean[POSITION], axis=1)
        cosine = np.abs(states[:, QUATERNION] @ mean[QUATERNION])
        angle = 2.0 * np.arccos(np.minimum(cosine, 1.0))
        result[body] = _widened(distance / spreads[k, 0]), _widened(angle / spreads[k, 1])
    return result


def _widened(distances):
    """Return the factor on a standard deviation, from distances (R,) of wide rollouts in units of it.

    Squares of far distances are summed, weighted by the tail probabilities between them. The tail of the k-th
    largest of R begins at the threshold that a share (k - 1/2) / R of wide rollouts exceeds.
    """
    far = np.sort(distances)[::-1]
    far = far[far > _FAR]
    shares = np.minimum((np.arange(1, len(far) + 1) - 0.5) / len(distances), 0.5)
    # the probability that a standard normal number exceeds the threshold
    beyond = np.array([0.5 * math.erfc(WIDE * -quantile(share) / math.sqrt(2.0)) for share in shares])
    steps = np.diff(beyond, prepend=0.0)
    return float(np.sqrt(1.0 + (steps * far**2).sum()))
