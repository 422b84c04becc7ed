"""Uncertainty of fitted values by the sandwich estimator: the penalised score is a quadratic about them.

The slopes of the score differ between motions. With its curvature they give the spread of the best values.
Slopes and curvature are differences over steps over which the score curves by several standard errors, as
scores from samples are noisy over shorter steps. Where the score is no quadratic, the distance at which it is
larger by a standard error counts, if it is larger. While one value moves, the other values follow on the line
of least scores. The prior adds its curvature and the error of its median.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from .posterior import PRIOR_WEIGHT, Posterior

_FIRST, _LARGEST = 0.7, 1.4  # steps of differences, in standard deviations of the priors
_CLOSE = 0.3  # share of a step; nearer bounds make the difference one-sided
_LOOKS = 3  # attempts, at most, to find the step of a value
_SURE = 3.0  # standard errors by which a score must curve over a step
_WIDE = 12.0  # standard deviations of a value that a step is at most
_NARROWER = 0.8  # standard deviation over that of the prior, below which a value is determined
_LIKE_LIKELIHOOD = 4.0  # motions that count as if the score were a log likelihood over the weight
_LEAST_CURVATURE = 0.1  # of a correlation matrix's eigenvalues, from below


class Estimate(NamedTuple):
    """Fitted values in standard deviations of their priors, with their uncertainty: (K,) arrays."""

    x: np.ndarray
    stds: np.ndarray  # standard deviations, at most those of the priors
    determined: np.ndarray  # whether the standard deviation is clearly below that of the prior


class _Axis(NamedTuple):
    """The score of each of M motions along one coordinate, about the middle."""

    step: float  # distance of the first point from the middle; negative if a bound is too near above
    opposite: float  # distance of the second point: on the other side, or twice as far near a bound
    #: beside, beyond: (M,): scores at the first and the second point
    beside: np.ndarray
    beyond: np.ndarray
    #: slope, curvature: (M,)
    slope: np.ndarray
    curvature: np.ndarray


def refining(count: int) -> int:
    """Return about how many models `refine` tries for ``count`` values."""
    return 5 * count + count * (count - 1) // 3 + 2


def refine(posterior: Posterior, x: np.ndarray) -> Estimate:
    """Return the values that minimize the penalised score, with their uncertainty.

    The posterior is that of all motions; ``x`` (K,) are the scaled values that the search found.
    """
    from scipy.optimize import lsq_linear

    x = np.clip(x, posterior.low, posterior.high)
    middle = posterior.at(x)
    axes = [_axis(posterior, x, middle, k) for k in range(len(x))]
    alone = np.array([_std_alone(posterior, axis) for axis in axes])
    back = np.linalg.inv(posterior.directions(x))  # from derivatives along directions to those by values
    H = back.T @ _hessian(posterior, x, middle, axes, alone) @ back
    slopes = np.array([axis.slope for axis in axes]).T @ back  # (M, K)
    steps = np.array([abs(axis.step) for axis in axes])
    # the least of the quadratic within the steps and the bounds
    root, box = np.linalg.cholesky(H), np.clip([x - steps, x + steps], posterior.low, posterior.high) - x
    way = lsq_linear(root.T, -np.linalg.solve(root, slopes.mean(axis=0)), box, method="bvls").x
    for share in (1.0, 0.5):
        closer = x + share * way
        found = posterior.at(closer)
        if found.mean() < middle.mean():
            x, middle = closer, found
            break
    # a prior's median errs by its standard deviation, 1: so does the slope of the penalty by its curvature
    prior = posterior.curvature * np.eye(len(x))
    spread = _spread(slopes, H - prior) / len(slopes) + prior @ prior
    inverse = np.linalg.inv(H)
    stds = np.sqrt(np.diagonal(inverse @ spread @ inverse))
    for k in np.flatnonzero(stds < _NARROWER):
        along = inverse[k] / inverse[k, k]  # the least scores for each change of value k, if quadratic
        stds[k] = max(stds[k], _std_from_increase(posterior, x, middle, k, along, stds[k]))
    stds = np.minimum(stds, 1.0)
    return Estimate(x, stds, stds < _NARROWER)


def _axis(posterior, x, middle, k) -> _Axis:
    """Return the differences along coordinate k, over a step whose curvature exceeds the noise."""
    step = _FIRST
    for _ in range(_LOOKS):
        axis = _along(posterior, x, middle, k, step)
        certainty = float(axis.curvature.mean()) / max(_standard_error(axis.curvature), 1e-300)
        alone = _std_alone(posterior, axis)
        if certainty < _SURE and step < _LARGEST:
            step = min(2.0 * step, _LARGEST)
        elif certainty >= _SURE and step > _WIDE * alone:
            step = 0.5 * _WIDE * alone
        else:
            break
    return axis


def _along(posterior, x, middle, k, step) -> _Axis:
    """Return the differences along coordinate k, over shorter steps or on one side only near a bound."""
    room = posterior.high[k] - x[k], x[k] - posterior.low[k]
    a, b = min(step, room[0]), -min(step, room[1])
    if min(a, -b) < _CLOSE * step:
        a = min(step, 0.5 * max(room)) * (1.0 if room[0] > room[1] else -1.0)
        b = 2.0 * a
    first, second = posterior.at(posterior.moved(x, k, a)), posterior.at(posterior.moved(x, k, b))
    slope = ((first - middle) * b * b - (second - middle) * a * a) / (a * b * (b - a))
    curvature = 2.0 * ((second - middle) * a - (first - middle) * b) / (a * b * (b - a))
    return _Axis(a, b, first, second, slope, curvature)


def _curvature(posterior, axis):
    """Return the curvature of the mean score, at least that of the penalty."""
    return max(float(axis.curvature.mean()), posterior.curvature)


def _std_alone(posterior, axis):
    """Return the standard deviation of a value if all other values were known."""
    curvature = _curvature(posterior, axis)
    spread = _spread(axis.slope[:, None], curvature - posterior.curvature) / len(axis.slope)
    return math.sqrt(float(spread[0, 0]) + posterior.curvature**2) / curvature


def _hessian(posterior, x, middle, axes, alone):
    """Return the second derivatives of the mean score (K, K), made positive definite.

    Mixed derivatives are computed only for pairs of determined values.
    """
    H = np.diag([_curvature(posterior, axis) for axis in axes])
    size = np.sqrt(np.diagonal(H))
    for i, one in enumerate(axes):
        for j, other in enumerate(axes[:i]):
            if max(alone[i], alone[j]) < _NARROWER:
                H[i, j] = H[j, i] = _mixed(posterior, x, middle, (i, one), (j, other))
    C = np.clip(H / np.outer(size, size), -1.0, 1.0)
    np.fill_diagonal(C, 1.0)
    values, vectors = np.linalg.eigh(C)
    return (vectors * np.maximum(values, _LEAST_CURVATURE)) @ vectors.T * np.outer(size, size)


def _mixed(posterior, x, middle, first, second):
    """Return the second derivative of the mean score by two values; each is a coordinate and its `_Axis`.

    It is the mean over two corners. One corner alone does not show that values make up for each other: the
    score saturates where their effects add up.
    """
    (i, one), (j, other) = first, second
    aside = posterior.moved(x, i, one.step)
    found = [
        (posterior.at(posterior.moved(aside, j, step)) - one.beside - scores + middle) / (one.step * step)
        for step, scores in ((other.step, other.beside), (other.opposite, other.beyond))
    ]
    return float(np.mean(found))


def _spread(slopes, hessian):
    """Return the covariance (K, K) of the slopes (M, K) of motions.

    For few motions it is shrunk towards the covariance that holds for a log likelihood.
    """
    count, own = len(slopes), slopes - slopes.mean(axis=0)
    return (own.T @ own + _LIKE_LIKELIHOOD * PRIOR_WEIGHT * hessian) / (count - 1 + _LIKE_LIKELIHOOD)


def _std_from_increase(posterior, x, middle, k, along, std):
    """Return the standard deviation of value k from the increase of the score on both sides of it.

    ``along`` (K,) is the change of all values for a unit change of value k. For a quadratic score the result
    is ``std``: two standard deviations away, the score is larger by one standard error of the difference.
    """
    both = np.array([_reach(posterior, x, middle, k, side * along, 2.0 * std) for side in (1.0, -1.0)])
    return 0.5 * math.sqrt(np.mean(both**2))


def _reach(posterior, x, middle, k, along, by):
    """Return the distance from value k at which the score is larger by a standard error; first try ``by``."""
    last, before = 0.0, 0.0
    farthest = min(2.0, posterior.high[k] - x[k] if along[k] > 0.0 else x[k] - posterior.low[k])
    while last < farthest:
        far = min(by, farthest)
        moved = np.clip(x + far * along, posterior.low, posterior.high)
        differences = posterior.at(moved) - middle
        certainty = float(differences.mean()) / max(_standard_error(differences), 1e-300)
        if certainty >= 1.0:
            return last + (far - last) * (1.0 - before) / (certainty - before)
        last, before, by = far, max(certainty, 0.0), 2.0 * by
    return farthest


def _standard_error(values):
    """Return the standard error of the mean of values (M,); infinite for one value."""
    return float(np.std(values, ddof=1) / math.sqrt(len(values))) if len(values) > 1 else math.inf
