"""How sure fitted values are: each motion's score as a quadratic about them (the sandwich estimator).

Slopes of the score differ from motion to motion, and its curvature says how far the best values would have
moved for others. Both are differences over steps that are wide enough for the score to curve by several
standard errors: over narrower ones scores by samples are rough. Where the score is no quadratic, how far it
takes to be larger by a standard error counts, if that is more.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ..checks.errors import UncPhysicsError
from .adjustable import Adjustable, Model, with_values
from .objective import Objective

_FIRST, _LARGEST = 0.2, 1.0  # step of differences: the first, and from where on it grows no more
_LOOKS = 5  # at most, for the step of a value
_SURE = 3.0  # standard errors by which a score must curve over a step
_WIDE = 12.0  # standard deviations that a step is at most
_CURVED = 2.0  # standard errors by which a score must curve about a value that is determined
_FARTHEST = 4.0  # from a bound, in an adjustable's steps
_FAILED = 1e3  # score of a model that cannot be simulated
_FLAT = 1e-9  # the least curvature that counts
_LEAST_CURVATURE = 0.1  # of a correlation matrix's eigenvalues, from below


class Estimate(NamedTuple):
    """Values and how sure they are, by the names of what was fitted.

    Attributes
    ----------
    values : dict
    stds : dict
        Standard deviations of the values, as motions differ. Of a value at a bound: the distance from it at
        which the score is larger by one standard error.
    settled : dict
        Whether the score has its minimum there, so that the standard deviation can be relied on.
    """

    values: dict[str, float]
    stds: dict[str, float]
    settled: dict[str, bool]


class _Axis(NamedTuple):
    """The score of each of M motions along one coordinate, about the middle.

    Attributes
    ----------
    step : float
        Where it was looked at beside the middle; negative where a bound is in the way.
    beside : (M,) array
        Scores one step away.
    slope, curvature : (M,) arrays
    """

    step: float
    beside: np.ndarray
    slope: np.ndarray
    curvature: np.ndarray

    @property
    def certainty(self) -> float:
        """The mean curvature over its standard error."""
        return float(self.curvature.mean() / max(_standard_error(self.curvature), 1e-300))

    @property
    def std(self) -> float:
        """Standard deviation of the coordinate alone; infinite where the mean score does not curve."""
        curvature = float(self.curvature.mean())
        return _standard_error(self.slope) / curvature if curvature > 0.0 else math.inf


class _Scores:
    """Scores of motions as functions of scaled values (K,), and differences of them."""

    def __init__(self, objective: Objective, model: Model, adjusted: Sequence[Adjustable], tell):
        self._objective, self._model, self._adjusted, self._tell = objective, model, adjusted, tell
        self.low = np.array([one.scaled(one.low) for one in adjusted])
        self.high = np.array([one.scaled(one.high) for one in adjusted])

    def values(self, x):
        return {one.name: one.unscaled(float(u)) for one, u in zip(self._adjusted, x, strict=True)}

    def at(self, x):
        """(M,)"""
        model = with_values(self._model, self._adjusted, self.values(x))
        try:
            found = self._objective.per_motion(model)
        except UncPhysicsError:  # such as a diverging simulation
            found = np.full(len(self._objective.recorded), _FAILED)
        self._tell(float(found.mean()))
        return found

    def moved(self, x, k, by):
        moved = x.copy()
        moved[k] = np.clip(moved[k] + by, self.low[k], self.high[k])
        return moved

    def at_bound(self, x):
        """(K,) bool"""
        return (x <= self.low) | (x >= self.high)

    def along(self, x, middle, k, step) -> _Axis:
        """Differences along coordinate k; on one side where a bound is on the other."""
        a, b = step, -step
        room = self.high[k] - x[k], x[k] - self.low[k]
        if min(room) < step:
            a = min(step, 0.5 * max(room)) * (1.0 if room[0] > room[1] else -1.0)
            b = 2.0 * a
        first, second = self.at(self.moved(x, k, a)), self.at(self.moved(x, k, b))
        slope = ((first - middle) * b * b - (second - middle) * a * a) / (a * b * (b - a))
        curvature = 2.0 * ((second - middle) * a - (first - middle) * b) / (a * b * (b - a))
        return _Axis(a, first, slope, curvature)


def refining(count: int) -> int:
    """Return about how many models `refine` tries for so many values."""
    return 8 * count + count * (count - 1) // 2 + 3


def refine(
    few: Objective,
    objective: Objective,
    model: Model,
    adjusted: Sequence[Adjustable],
    values: dict[str, float],
    tell: Callable[[float], object],
) -> Estimate:
    """Return the values at which the score is least, from others nearby, and how sure they are.

    Parameters
    ----------
    few : Objective
        Some of the motions, with which steps of differences are found.
    objective : Objective
        All of them.
    model : Model
    adjusted : sequence of Adjustable
    values : dict
        Where it begins, as the search found them.
    tell : callable
        Takes the mean score of each model that is tried.
    """
    rough, scores = _Scores(few, model, adjusted, tell), _Scores(objective, model, adjusted, tell)
    x = np.array([one.scaled(values[one.name]) for one in adjusted])
    x = np.clip(x, scores.low, scores.high)
    x, _ = _without_needless_spreads(rough, adjusted, x, rough.at(x))
    x, steps = _steps_of_differences(rough, x)
    middle = scores.at(x)
    x, middle = _without_needless_spreads(scores, adjusted, x, middle)
    std, axes, at_bound = np.zeros(len(x)), [], scores.at_bound(x)
    for k in range(len(x)):
        axis = None if at_bound[k] else scores.along(x, middle, k, steps[k])
        if axis is not None and axis.certainty > _CURVED:
            axes.append((k, axis))
        else:
            std[k] = _reach(scores, x, middle, k, -_FIRST if x[k] >= scores.high[k] else _FIRST)
    settled = np.isfinite(std)
    free, axes = np.array([k for k, _ in axes], int), [axis for _, axis in axes]
    if len(free):
        slopes = np.array([axis.slope for axis in axes]).T  # (M, F)
        H = _hessian(scores, x, middle, free, axes)
        way = _least_in_box(
            slopes.mean(axis=0),
            H,
            np.maximum(scores.low[free] - x[free], -steps[free]),
            np.minimum(scores.high[free] - x[free], steps[free]),
        )
        for share in (1.0, 0.5):
            closer = x.copy()
            closer[free] += share * way
            found = scores.at(closer)
            if found.mean() < middle.mean():
                x, middle = closer, found
                break
        spread = np.atleast_2d(np.cov(slopes.T)) / len(slopes)
        std[free] = np.sqrt(np.diagonal(np.linalg.solve(H, np.linalg.solve(H, spread).T)))
        for k in free:
            std[k] = max(std[k], _as_far_as_likely(scores, x, middle, k, std[k]))
        settled[free] = [
            abs(by) < steps[k] * (1.0 - 1e-9) and std[k] < 2.0 * steps[k]
            for by, k in zip(way, free, strict=True)
        ]
    return Estimate(
        scores.values(x),
        {one.name: _std_of(one, x[k], std[k]) for k, one in enumerate(adjusted)},
        {one.name: bool(settled[k]) for k, one in enumerate(adjusted)},
    )


def _steps_of_differences(scores, x):
    """Return values at which the score is less, axis by axis, and the steps of differences: each (K,)."""
    middle, steps = scores.at(x), np.full(len(x), _FIRST)
    for k in range(len(x)):
        for _ in range(_LOOKS):
            axis = scores.along(x, middle, k, steps[k])
            x, middle = _closer(scores, x, middle, k, axis)
            if scores.at_bound(x)[k]:
                break
            if axis.certainty < _SURE and steps[k] < _LARGEST:
                steps[k] *= 3.0
            elif axis.certainty >= _SURE and steps[k] > _WIDE * axis.std:
                steps[k] = 0.5 * _WIDE * axis.std
            else:
                break
    return x, steps


def _closer(scores, x, middle, k, axis):
    """Where the parabola along coordinate k is least, if the score is less there; or beside the middle."""
    curvature = axis.curvature.mean()
    by = math.copysign(abs(axis.step), -axis.slope.mean())
    if curvature > 0.0:
        by = float(np.clip(-axis.slope.mean() / curvature, -2.0 * abs(axis.step), 2.0 * abs(axis.step)))
    moved = scores.moved(x, k, by)
    if abs(moved[k] - x[k]) < 0.5 * min(axis.std, abs(axis.step)):
        return x, middle
    found = scores.at(moved)
    return (moved, found) if found.mean() < middle.mean() else (x, middle)


def _without_needless_spreads(scores, adjusted, x, middle):
    """Standard deviations that are 0 unless the score is larger there by a standard error."""
    for k, one in enumerate(adjusted):
        if one.spread and x[k] > scores.low[k]:
            without = x.copy()
            without[k] = scores.low[k]
            found = scores.at(without)
            if (found - middle).mean() < _standard_error(found - middle):
                x, middle = without, found
    return x, middle


def _reach(scores, x, middle, k, by):
    """How far from a value the score is larger by a standard error; infinite if it is nowhere.

    It is looked at ``by`` from the value at first; the sign says on which side.
    """
    last, before = 0.0, 0.0
    farthest = min(_FARTHEST, scores.high[k] - x[k] if by > 0.0 else x[k] - scores.low[k])
    while last < farthest:
        far = min(abs(by), farthest)
        differences = scores.at(scores.moved(x, k, math.copysign(far, by))) - middle
        certainty = float(differences.mean()) / max(_standard_error(differences), 1e-300)
        if certainty >= 1.0:
            return last + (far - last) * (1.0 - before) / (certainty - before)
        last, before, by = far, max(certainty, 0.0), 2.0 * by
    return math.inf


def _as_far_as_likely(scores, x, middle, k, std):
    """Standard deviation of a value by the score on both sides of it, which need not be alike.

    Of a quadratic score it is ``std``: two standard deviations away, the score is larger by one standard
    error of the difference.
    """
    both = np.array([_reach(scores, x, middle, k, side * 2.0 * std) for side in (1.0, -1.0)])
    both = both[np.isfinite(both)]
    return 0.5 * math.sqrt(np.mean(both**2)) if len(both) else std


def _hessian(scores, x, middle, free, axes):
    """(F, F): second derivatives of the mean score by the ``free`` values, made positive definite."""
    H = np.diag([axis.curvature.mean() for axis in axes])
    size = np.sqrt(np.maximum(np.diagonal(H), _FLAT))
    for i, one in enumerate(axes):
        for j, other in enumerate(axes[:i]):
            both = scores.moved(scores.moved(x, free[i], one.step), free[j], other.step)
            mixed = scores.at(both) - one.beside - other.beside + middle
            H[i, j] = H[j, i] = mixed.mean() / (one.step * other.step)
    C = np.clip(H / np.outer(size, size), -1.0, 1.0)
    np.fill_diagonal(C, 1.0)
    values, vectors = np.linalg.eigh(C)
    return (vectors * np.maximum(values, _LEAST_CURVATURE)) @ vectors.T * np.outer(size, size)


def _standard_error(values):
    """Of the mean of (M,)."""
    return float(np.std(values, ddof=1) / math.sqrt(len(values))) if len(values) > 1 else math.inf


def _std_of(one, scaled, std):
    """The standard deviation of a value, from that of the scaled value."""
    value = one.step * std * (one.unscaled(scaled) if one.relative else 1.0)
    return float(min(value, one.high - one.low))


def _least_in_box(slope, hessian, low, high):
    """Where ``slope d + d hessian d / 2`` is least between two corners (K,): axis by axis, from 0."""
    d = np.zeros(len(slope))
    for _ in range(200):
        before = d.copy()
        for k in range(len(d)):
            across = slope[k] + hessian[k] @ d - hessian[k, k] * d[k]
            d[k] = np.clip(-across / hessian[k, k], low[k], high[k])
        if np.abs(d - before).max() < 1e-9:
            break
    return d
