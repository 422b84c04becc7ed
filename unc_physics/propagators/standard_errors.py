"""Standard errors of means and spreads from a few rollouts with a response surface."""

from __future__ import annotations

import numpy as np

from ..scene.scene import Scene
from ..shapes.revolution import turns
from ..spatial.layout import ERR_POSITION, ERR_ROTATION, ERROR, QUATERNION
from ..spatial.moments import mean_and_errors, spread_states
from .base import StandardErrors
from .emission import SPREAD_FLOORS, CloudCarry, Moments, moments

#: Standard deviation of a rotation [rad] above which rotation vectors wrap around, which makes its mean less
#: certain; and the number of groups of a jackknife that then estimates the standard error.
_WIDE, _PARTS = 1.0, 8
_ROUND = 1e-6  # difference of moments of inertia, over the largest, that is round-off


def standard_errors(runs: CloudCarry, scene: Scene) -> StandardErrors:
    """Return standard errors of means and standard deviations, from leaving one rollout out.

    A mean or a variance is the sum of a known part from the surface, and a part from the residuals, of which
    N rollouts are a sample. Without a surface, the errors are those of Monte Carlo. Rotations count as if
    they did not wrap around (`wrapped_errors`).
    """
    count = len(runs.mean)
    errors = StandardErrors(*(np.zeros(count) for _ in StandardErrors._fields))
    turning = np.array([_turns(body) for body in scene.bodies])
    for found in moments(runs, scene):
        bodies = found.group.bodies
        parts = [part.reshape(len(part), -1, ERROR) for part in (found.errors, found.left_out)]
        of_means, of_spreads = errors[:2], errors[3:]
        for block, mean, spread, nothing in zip(
            (ERR_POSITION, ERR_ROTATION), of_means, of_spreads, SPREAD_FLOORS, strict=True
        ):
            own, left = (part[:, :, block] for part in parts)
            variance = np.maximum((own**2).sum(axis=2).mean(axis=0), nothing**2)
            mean[bodies] = _of_mean(own, left)
            if block == ERR_ROTATION and turning[bodies].any():
                own, left = (part - np.einsum("mij,nmj->nmi", turning[bodies], part) for part in (own, left))
            share = _of_mean(own, left) / np.sqrt(variance)
            errors.relative[bodies] = np.maximum(errors.relative[bodies], share)
            spread[bodies] = _of_variance(own, left, found.has_surface) / (2.0 * variance)
    return errors


def _of_mean(own, left):
    """Return standard errors (m,) of means; see `_of_variance`."""
    variance, rest = ((part**2).sum(axis=2).mean(axis=0) for part in (own, left))
    return np.sqrt(np.minimum(rest, variance) / len(own))


def _of_variance(own, left, has_surface):
    """Return standard errors (m,) of variances.

    ``own`` (N, m, 3) are errors of rollouts, and ``left`` (n, m, 3) those of leaving out the first ones.
    """
    squares = (own**2).sum(axis=2)
    unknown = squares - squares.mean(axis=0)
    if has_surface:
        through = ((own[: len(left)] - left) ** 2).sum(axis=2)
        by_surface = squares[: len(left)] - through
        by_surface = by_surface - by_surface.mean(axis=0)
        fewer = by_surface.var(axis=0) < unknown.var(axis=0)
        unknown = np.where(fewer, by_surface, unknown[: len(left)])
    return np.sqrt(unknown.var(axis=0) / len(own))


def wrapped_errors(runs: CloudCarry, scene: Scene, errors: StandardErrors) -> StandardErrors:
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


def _turns(body):
    """Return the projection (3, 3) of rotations onto those that leave shape and inertia unchanged."""
    found, inertia = turns(body.model.pieces), body.unit_inertia
    rank, along = round(found.trace()), (found * inertia).sum()
    across = (inertia.trace() - along) / max(3 - rank, 1)
    symmetric = along / max(rank, 1) * found + across * (np.eye(3) - found)
    return found if np.abs(symmetric - inertia).max() < _ROUND * along else np.zeros((3, 3))


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
