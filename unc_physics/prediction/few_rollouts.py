"""A few rollouts that tell a spread: what a status compares a prediction with."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..physics.layout import ERR_POSITION, ERR_ROTATION
from ..propagators.balanced_monte_carlo import BalancedMonteCarlo
from .predict import predict

_SEED = 0  # of their draws: the same question has the same status


def rollout_spreads(scene, initial, times, count):
    """(T, M, 2): standard deviations of position [m] and rotation [rad] of some rollouts, at each time."""
    if len(scene.bodies) > 2 and not scene.islands:
        scene = replace(scene, islands=True)  # changes rollouts by nothing that counts here
    propagator = BalancedMonteCarlo(samples=count, seed=_SEED)
    sampled = predict(scene, initial, propagator, None, times=times)
    return np.array([pose_spreads(belief.blocks) for belief in sampled.beliefs])


def pose_spreads(blocks):
    """(M, 2): standard deviations of position [m] and rotation [rad], over all axes together."""
    variances = np.einsum("mii->mi", blocks)
    return np.sqrt(
        np.maximum([variances[:, block].sum(axis=1) for block in (ERR_POSITION, ERR_ROTATION)], 0.0)
    ).T
