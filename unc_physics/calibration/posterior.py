"""Penalised score of a model: proper scores of motions, and a penalty for values far from their priors."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ..checks.errors import DivergedError
from .adjustable import Adjustable, Model, directions, with_values
from .objective import Objective

#: Weight of the priors for many motions: all motions together must improve by half of it for a value one
#: standard deviation from its prior's median.
PRIOR_WEIGHT = 0.5
#: Number of motions at which the weight of the prior is twice that.
FEW_MOTIONS = 8
_FAILED = 1e3  # score of a model that cannot be simulated


def prior_weight(motions: int) -> float:
    """Return the weight of the priors, of which each motion has an equal share.

    The mean slope of few motions is mostly noise, and differs by more than their slopes show. So their prior
    counts more, and values of two or three motions hardly leave it.
    """
    return PRIOR_WEIGHT * (1.0 + (FEW_MOTIONS / motions) ** 2)


class Posterior:
    """Penalised scores of motions as functions of values in standard deviations of their priors.

    The values of the model are the medians of the priors. ``report_score`` is called with the mean score of
    each model that is tried. The penalty is shared among ``motions`` motions, by default those of the
    objective; ``curvature`` is its second derivative in a motion's score, by each value. ``low``, ``high``
    and ``median`` (K,) are bounds, and medians of the priors.
    """

    def __init__(
        self,
        objective: Objective,
        model: Model,
        adjusted: Sequence[Adjustable],
        report_score: Callable[[float], object] = lambda score: None,
        motions: int | None = None,
    ):
        self.objective, self.model, self.adjusted = objective, model, list(adjusted)
        self._report_score = report_score
        self.low = np.array([one.scaled(one.low) for one in adjusted])
        self.high = np.array([one.scaled(one.high) for one in adjusted])
        self.median = np.array([one.scaled(one.prior_median(model)) for one in adjusted])
        count = motions or len(objective.recorded)
        self.curvature = prior_weight(count) / count

    def values(self, x: np.ndarray) -> dict[str, float]:
        """Return the values of scaled values (K,), by their names."""
        return {one.name: one.unscaled(float(u)) for one, u in zip(self.adjusted, x, strict=True)}

    def with_values(self, x: np.ndarray) -> Model:
        """Return the model with scaled values (K,)."""
        return with_values(self.model, self.adjusted, self.values(x))

    def at(self, x: np.ndarray) -> np.ndarray:
        """Return the penalised score of each motion (M,) at scaled values (K,)."""
        try:
            found = self.objective.per_motion(self.with_values(x))
        except DivergedError:  # these values cannot be simulated
            found = np.full(len(self.objective.recorded), _FAILED)
        found = found + 0.5 * self.curvature * np.sum((x - self.median) ** 2)
        self._report_score(float(found.mean()))
        return found

    def directions(self, x: np.ndarray) -> np.ndarray:
        """Return the directions (K, K) of `moved` about scaled values (K,), one a column."""
        return directions(self.adjusted, x)

    def moved(self, x: np.ndarray, k: int, by: float) -> np.ndarray:
        """Return scaled values (K,) with value k changed by ``by`` along its direction, within bounds."""
        return np.clip(x + by * self.directions(x)[:, k], self.low, self.high)
