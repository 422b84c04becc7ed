"""The search for the values under which recorded motions are predicted best, and how sure these are."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ..checks.errors import UncPhysicsError
from .adjustable import Adjustable, Model, with_values
from .objective import Objective
from .quadratic import Quadratic, fit_quadratic, least_in_box

_FIRST_STEP, _LAST_STEP = 1.0, 0.1  # of the search, in an adjustable's steps
_PROBE = 0.7  # how far from the best values the score is looked at along each axis, likewise
_NEAR = 2.0  # within which tried models tell slopes and curvature, likewise
_LEAST_PROBE = 0.1  # likewise
_FLAT = 1e-6  # the least curvature that counts
_LEAST_SHARE = 1e-3  # of the largest curvature, likewise
_MOST = 0.8  # how far two values may stand in for each other
_SETTLED = 1.0  # how far the best values may lie from where slopes and curvature say, in steps
_RELIABLE = 1.0  # an uncertainty beyond this is further than the score was looked at, likewise


class Estimate(NamedTuple):
    """What a search found, by the names of what is sought.

    Attributes
    ----------
    values : dict
    stds : dict
        Standard deviations of the values, as motions differ.
    settled : dict
        Whether the score has its minimum there, so that the standard deviation can be relied on.
    """

    values: dict[str, float]
    stds: dict[str, float]
    settled: dict[str, bool]


class Search:
    """A search for the values under which motions are predicted best.

    Parameters
    ----------
    objective : Objective
    model : Model
        Where it begins.
    adjusted : sequence of Adjustable
    evaluations : int
        Models that will be tried in all; for the progress.
    progress : callable, optional
        As in `calibrate`.
    """

    def __init__(
        self,
        objective: Objective,
        model: Model,
        adjusted: Sequence[Adjustable],
        evaluations: int,
        progress: Callable[[int, int, float], object] | None = None,
    ):
        self.objective, self.model, self.adjusted = objective, model, list(adjusted)
        self.evaluations, self._progress = evaluations, progress
        self._points: list[np.ndarray] = []
        self._scores: list[np.ndarray] = []
        self._lower = np.array([one.scaled(one.low) for one in self.adjusted])
        self._upper = np.array([one.scaled(one.high) for one in self.adjusted])

    @property
    def tried(self) -> int:
        """Number of models tried."""
        return len(self._points)

    def approach(self) -> None:
        """Go a step along each axis, back where that is worse; then on along all of them while it is better.

        From a poor beginning it gets as far with half the models as the search that follows it.
        """
        origin = self._best() if self._points else self._begin()
        self._try(origin)
        for k in range(len(origin)):
            center, before = self._best(), self._least()
            for side in (_FIRST_STEP, -_FIRST_STEP):
                self._try(self._probe(center, k, side))
                if self._least() < before:
                    break
        while True:
            way, before = self._best() - origin, self._least()
            origin = self._best()
            self._try(np.clip(origin + way, self._lower, self._upper))
            if self._least() >= before:
                break

    def run(self, evaluations: int) -> dict[str, float]:
        """The best values after so many models, from the best so far.

        SciPy's COBYQA: quadratic models in a trust region, without derivatives, within bounds. Scores by
        samples are rough at small steps, so it ends before it sees them.
        """
        from scipy.optimize import minimize

        tried = self.tried
        minimize(
            lambda x: float(self._try(x).mean()),
            self._best() if self._points else self._begin(),
            method="COBYQA",
            bounds=list(zip(self._lower, self._upper, strict=True)),
            options={
                "maxfev": evaluations,
                "initial_tr_radius": _FIRST_STEP if not tried else _PROBE,
                "final_tr_radius": _LAST_STEP,
                "scale": False,
            },
        )
        return self._values(self._best())

    def settle(self, evaluations: int) -> None:
        """Look around the best values with so many more models, and go to where the score is least.

        Two models for each value show slopes and curvature, from the best so far each time. What is left goes
        to where a quadratic through all models nearby is least, nearer each time that this is no better.
        """
        end, count = self.tried + evaluations, len(self.adjusted)
        if not self._points:
            self._try(self._begin())
        for k in range(count):
            center = self._best()
            for side in (-_PROBE, _PROBE):
                if self.tried < end:
                    self._try(self._probe(center, k, side))
        radius, aside = _PROBE, 0
        while self.tried < end:
            center, before = self._best(), self._least()
            model = self._model_at(center).mean
            low = np.maximum(self._lower - center, -radius)
            high = np.minimum(self._upper - center, radius)
            step = least_in_box(model.slope[0], model.hessian[0], low, high)
            if radius < _LEAST_PROBE or np.abs(step).max() < _LEAST_PROBE:
                # it is there; what is left makes slopes and curvature surer, nearer by
                k, side = divmod(aside, 2)
                step = self._probe(center, k % count, (-0.5, 0.5)[side] * _PROBE) - center
                aside += 1
            self._try(center + step)
            radius = radius if self._least() < before else 0.6 * radius
            if self._least() < before and radius < 0.5 * _PROBE:
                radius = 0.5 * _PROBE

    def estimate(self) -> Estimate:
        """The best values, how sure they are, and whether the score has its minimum there.

        Slopes of the score differ from motion to motion, and its curvature says how far the best values would
        have moved for others (the sandwich estimator).
        """
        best = self._best()
        models = self._model_at(best)
        slope, raw = models.mean.slope[0], models.mean.hessian[0]
        H = _curving(raw)
        spread = np.atleast_2d(np.cov(models.slope.T)) / len(models.slope)
        std = np.sqrt(np.diagonal(np.linalg.solve(H, np.linalg.solve(H, spread).T)))
        low, high = np.maximum(self._lower - best, -_NEAR), np.minimum(self._upper - best, _NEAR)
        off = least_in_box(slope, H, low, high)
        curvature = np.diagonal(models.hessian, axis1=1, axis2=2)
        error = curvature.std(axis=0) / math.sqrt(len(curvature))
        curves = curvature.mean(axis=0) > np.maximum(2.0 * error, _LEAST_SHARE * curvature.mean(axis=0).max())
        settled = curves & (np.abs(off) < _SETTLED) & (std < _RELIABLE)
        std = np.minimum(std, (self._upper - self._lower) / math.sqrt(12.0))  # of what could be anything
        names = [one.name for one in self.adjusted]
        stds = [
            float(one.step * s * (one.unscaled(x) if one.relative else 1.0))
            for one, s, x in zip(self.adjusted, std, best, strict=True)
        ]
        return Estimate(
            self._values(best),
            dict(zip(names, stds, strict=True)),
            dict(zip(names, map(bool, settled), strict=True)),
        )

    def _begin(self):
        begin = np.array([one.scaled(one.get(self.model)) for one in self.adjusted])
        return np.clip(begin, self._lower, self._upper)

    def _probe(self, center, k, side):
        """A point beside another along an axis; on its other side where a bound is in the way."""
        x = center.copy()
        x[k] = np.clip(x[k] + side, self._lower[k], self._upper[k])
        if x[k] == center[k]:
            x[k] = np.clip(center[k] - 0.5 * side, self._lower[k], self._upper[k])
        return x

    def _model_at(self, center) -> Quadratic:
        """Of the score of each motion."""
        return fit_quadratic(np.array(self._points), np.array(self._scores), center, _NEAR)

    def _try(self, x):
        """Scores (M,) of the motions at scaled values; remembered."""
        try:
            model = with_values(self.model, self.adjusted, self._values(x))
            found = self.objective.per_motion(model)
        except UncPhysicsError:
            if not self._scores:
                raise
            found = self._scores[0] * 10.0  # such as a diverging simulation: no candidate
        self._points.append(np.array(x))
        self._scores.append(found)
        if self._progress is not None:
            self._progress(self.tried, self.evaluations, self._least())
        return found

    def _least(self):
        return min(float(own.mean()) for own in self._scores)

    def _best(self):
        return self._points[int(np.argmin([own.mean() for own in self._scores]))]

    def _values(self, x):
        return {one.name: one.unscaled(float(v)) for one, v in zip(self.adjusted, x, strict=True)}


def _curving(hessian):
    """A matrix of second derivatives made positive definite.

    What would hardly curve is let curve up a little, which gives wide uncertainties.
    """
    size = np.sqrt(np.maximum(np.diagonal(hessian), _FLAT))
    C = np.clip(hessian / np.outer(size, size), -_MOST, _MOST)
    np.fill_diagonal(C, 1.0)
    values, vectors = np.linalg.eigh(C)
    return (vectors * np.maximum(values, 1.0 - _MOST)) @ vectors.T * np.outer(size, size)
