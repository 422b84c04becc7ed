"""How far the means of a few rollouts with a surface may be off."""

from __future__ import annotations

import numpy as np

from ..physics.layout import ERR_POSITION, ERR_ROTATION, ERROR
from ..scene.scene import Scene
from .base import Errors
from .emission import Runs, fits


def surface_errors(runs: Runs, scene: Scene) -> np.ndarray:
    """(B,): error over variance of the surface that each body is of; 0 where none is needed."""
    result = np.zeros(len(runs.mean))
    for group, fit in fits(runs, scene):
        result[group.bodies] = fit.surface.error
    return result


def standard_errors(runs: Runs, scene: Scene) -> Errors:
    """Standard errors of the means, from what leaving one rollout out shows.

    The mean is that of the surface, known, plus that of what is left besides, of which N rollouts are a
    sample. Without a surface it is Monte Carlo's.
    """
    count = len(runs.mean)
    errors = Errors(np.zeros(count), np.zeros(count), np.zeros(count))
    for group, fit in fits(runs, scene):
        left = np.divide(
            fit.surface.left_out,
            fit.weights,
            out=np.zeros_like(fit.surface.left_out),
            where=fit.weights > 0.0,
        )
        left, spread = (values.reshape(len(values), -1, ERROR) for values in (left, fit.errors))
        for block, found in ((ERR_POSITION, errors.position), (ERR_ROTATION, errors.rotation)):
            std = np.sqrt((spread[:, :, block] ** 2).sum(axis=2).mean(axis=0))
            rest = np.sqrt((left[:, :, block] ** 2).sum(axis=2).mean(axis=0))
            found[group.bodies] = np.minimum(rest, std) / np.sqrt(len(spread))
            share = np.divide(found[group.bodies], std, out=np.zeros_like(std), where=std > 0.0)
            errors.relative[group.bodies] = np.maximum(errors.relative[group.bodies], share)
    return errors
