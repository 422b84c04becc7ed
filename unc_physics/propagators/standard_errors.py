"""Standard errors of means and spreads from a few rollouts with a response surface."""

from __future__ import annotations

import numpy as np

from ..scene.scene import Scene
from ..spatial.layout import ERR_POSITION, ERR_ROTATION, ERROR, QUATERNION
from ..spatial.moments import mean_and_errors, spread_states
from .base import StandardErrors
from .emission import SPREAD_FLOORS, Moments, Runs, moments

#: Standard deviation of a rotation [rad] above which rotation vectors wrap around, which makes its mean less
#: certain; and the number of groups of a jackknife that then estimates the standard error.
_WIDE, _PARTS = 1.0, 8


def standard_errors(runs: Runs, scene: Scene) -> StandardErrors:
    """Return standard errors of means and standard deviations, from leaving one rollout out.

    A mean or a variance is the sum of a known part from the surface, and a part from the residuals, of which
    N rollouts are a sample. Without a surface, the errors are those of Monte Carlo. Rotations count as if
    they did not wrap around (`wrapped_errors`).
    """
    count = len(runs.mean)
    errors = StandardErrors(*(np.zeros(count) for _ in StandardErrors._fields))
    for found in moments(runs, scene):
        bodies, number = found.group.bodies, len(found.errors)
        of_mean = errors.position, errors.rotation
        of_spread = errors.position_spread, errors.rotation_spread
        own = found.errors.reshape(number, -1, ERROR)
        left = found.left_out.reshape(len(found.left_out), -1, ERROR)
        for block, mean, spread, nothing in zip(
            (ERR_POSITION, ERR_ROTATION), of_mean, of_spread, SPREAD_FLOORS, strict=True
        ):
            squares = (own[:, :, block] ** 2).sum(axis=2)
            variance = squares.mean(axis=0)
            rest = (left[:, :, block] ** 2).sum(axis=2).mean(axis=0)
            mean[bodies] = np.sqrt(np.minimum(rest, variance) / number)
            share = mean[bodies] / np.maximum(np.sqrt(variance), nothing)
            errors.relative[bodies] = np.maximum(errors.relative[bodies], share)
            unknown = squares - variance
            if found.has_surface:
                some = own[: len(left)]
                through = ((some - left)[:, :, block] ** 2).sum(axis=2)
                by_surface = squares[: len(left)] - through
                by_surface = by_surface - by_surface.mean(axis=0)
                fewer = by_surface.var(axis=0) < unknown.var(axis=0)
                unknown = np.where(fewer, by_surface, unknown[: len(left)])
            share = np.sqrt(unknown.var(axis=0) / number) / (2.0 * np.maximum(variance, nothing**2))
            spread[bodies] = share
    return errors


def wrapped_errors(runs: Runs, scene: Scene, errors: StandardErrors) -> StandardErrors:
    """Return `standard_errors` with larger errors of mean rotations that wrap around.

    The mean of rotations that spread over more than a radian has a larger error than the mean of numbers with
    that spread. The jackknife estimates it. ``relative`` ignores this, as no number of rollouts reduces it.
    """
    rotation = errors.rotation.copy()
    for found in moments(runs, scene):
        bodies, own = found.group.bodies, found.errors.reshape(len(found.errors), -1, ERROR)
        wide = np.sqrt((own[:, :, ERR_ROTATION] ** 2).sum(axis=2).mean(axis=0)) > _WIDE
        if wide.any():
            rotation[bodies[wide]] *= _wrapping(found)[wide]
    return errors._replace(rotation=rotation)


def _wrapping(found: Moments) -> np.ndarray:
    """Return the factors (m,), at least 1, on standard errors of mean rotations that wrap around."""
    count, bodies = len(found.errors), np.arange(len(found.mean))
    states = spread_states(found.mean, bodies, found.errors)
    squares = np.zeros(len(bodies))
    order = np.random.default_rng(0).permutation(count)  # neighbours among quasi-random points lie apart
    for part in range(_PARTS):
        others = np.ascontiguousarray(np.delete(states, order[part::_PARTS], axis=0))
        mean = mean_and_errors(others, bodies)[0]
        cosine = np.abs((mean[:, QUATERNION] * found.mean[:, QUATERNION]).sum(axis=1))
        squares += (2.0 * np.arccos(np.minimum(cosine, 1.0))) ** 2
    variance = (found.errors.reshape(count, -1, ERROR)[:, :, ERR_ROTATION] ** 2).sum(axis=2).mean(axis=0)
    return np.sqrt(np.maximum((_PARTS - 1) / _PARTS * squares * count / variance, 1.0))
