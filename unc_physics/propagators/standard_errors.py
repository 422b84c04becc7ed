"""How far the means of a few rollouts with a surface may be off."""

from __future__ import annotations

import numpy as np

from ..scene.scene import Scene
from ..spatial.layout import ERR_POSITION, ERR_ROTATION, ERROR, QUATERNION
from ..spatial.moments import mean_and_errors, spread_states
from .base import StandardErrors
from .emission import Fit, Runs, fits

#: Standard deviation of a rotation [rad] from which on some turn the shorter way and some the longer, so that
#: its mean is less sure; and in how many parts rollouts are left out to see by how much.
_WIDE, _PARTS = 1.0, 8


def surface_errors(runs: Runs, scene: Scene) -> np.ndarray:
    """(B,): error over variance of the surface that each body is of; 0 where none is needed."""
    result = np.zeros(len(runs.mean))
    for group, fit in fits(runs, scene):
        result[group.bodies] = fit.surface.error
    return result


def standard_errors(runs: Runs, scene: Scene) -> StandardErrors:
    """Standard errors of the means, from what leaving one rollout out shows.

    The mean is that of the surface, known, plus that of what is left besides, of which N rollouts are a
    sample. Without a surface it is Monte Carlo's. A mean of rotations that spread over more than a radian is
    less sure than the mean of what does not wrap around, by what leaving out parts of the rollouts shows (the
    jackknife); ``relative`` does not count that, as no number of rollouts makes such a mean sure.
    """
    count = len(runs.mean)
    errors = StandardErrors(np.zeros(count), np.zeros(count), np.zeros(count))
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
        wide = np.sqrt((spread[:, :, ERR_ROTATION] ** 2).sum(axis=2).mean(axis=0)) > _WIDE
        if wide.any():
            errors.rotation[group.bodies[wide]] *= _wrapping(fit)[wide]
    return errors


def _wrapping(fit: Fit) -> np.ndarray:
    """(m,): standard errors of mean rotations over those of what does not wrap around; at least 1."""
    count, bodies = len(fit.errors), np.arange(len(fit.mean))
    states = spread_states(fit.mean, bodies, fit.errors)
    squares = np.zeros(len(bodies))
    order = np.random.default_rng(0).permutation(count)  # neighbours among quasi-random points lie apart
    for part in range(_PARTS):
        others = np.ascontiguousarray(np.delete(states, order[part::_PARTS], axis=0))
        mean = mean_and_errors(others, bodies)[0]
        cosine = np.abs((mean[:, QUATERNION] * fit.mean[:, QUATERNION]).sum(axis=1))
        squares += (2.0 * np.arccos(np.minimum(cosine, 1.0))) ** 2
    variance = (fit.errors.reshape(count, -1, ERROR)[:, :, ERR_ROTATION] ** 2).sum(axis=2).mean(axis=0)
    return np.sqrt(np.maximum((_PARTS - 1) / _PARTS * squares * count / variance, 1.0))
