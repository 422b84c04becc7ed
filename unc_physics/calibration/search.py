"""The search for the values under which recorded motions are predicted best."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ..checks.errors import UncPhysicsError
from .adjustable import Adjustable, Model, with_values
from .objective import Objective

_FIRST_STEP, _LAST_STEP = 1.0, 0.1  # of the search, in an adjustable's steps
_PROBE = 0.7  # trust radius with which it goes on, likewise


class Search:
    """A search for the values under which motions are predicted best.

    Parameters
    ----------
    objective : Objective
    model : Model
        Where it begins.
    adjusted : sequence of Adjustable
    tell : callable
        Takes the mean score of each model that is tried.
    """

    def __init__(
        self,
        objective: Objective,
        model: Model,
        adjusted: Sequence[Adjustable],
        tell: Callable[[float], object],
    ):
        self.objective, self.model, self.adjusted, self._tell = objective, model, list(adjusted), tell
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

    @property
    def values(self) -> dict[str, float]:
        """The best values so far, by their names."""
        return self._values(self._best())

    def run(self, evaluations: int) -> None:
        """Try so many models, from the best so far.

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
        self._tell(float(found.mean()))
        return found

    def _least(self):
        return min(float(own.mean()) for own in self._scores)

    def _best(self):
        return self._points[int(np.argmin([own.mean() for own in self._scores]))]

    def _values(self, x):
        return {one.name: one.unscaled(float(v)) for one, v in zip(self.adjusted, x, strict=True)}
