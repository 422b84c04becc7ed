"""Search for the values under which recorded motions are predicted best."""

from __future__ import annotations

import numpy as np

from .posterior import Posterior

_FIRST_STEP, _LAST_STEP = 0.7, 0.07  # of the search, in standard deviations of the priors


class ParameterSearch:
    """Minimization of the penalised score, from the medians of the priors."""

    def __init__(self, posterior: Posterior):
        self._posterior = posterior
        self._points: list[np.ndarray] = []
        self._scores: list[float] = []
        self._try(posterior.median)

    @property
    def tried(self) -> int:
        """Number of models tried."""
        return len(self._points)

    @property
    def best(self) -> np.ndarray:
        """(K,): the best scaled values so far."""
        return self._points[int(np.argmin(self._scores))]

    def approach(self) -> None:
        """Step along each axis, backwards if forwards is worse; then repeat the total step while it helps.

        From poor initial values this takes half as many models as `run` for the same score.
        """
        origin = self.best
        for k in range(len(origin)):
            center, before = self.best, min(self._scores)
            for side in (_FIRST_STEP, -_FIRST_STEP):
                self._try(self._posterior.moved(center, k, side))
                if min(self._scores) < before:
                    break
        while True:
            way, before = self.best - origin, min(self._scores)
            origin = self.best
            self._try(np.clip(origin + way, self._posterior.low, self._posterior.high))
            if min(self._scores) >= before:
                break

    def run(self, evaluations: int) -> None:
        """Minimize with at most ``evaluations`` models, from the best so far.

        SciPy's COBYQA uses quadratic models in a trust region, without derivatives, within bounds. Scores
        from samples are noisy at small steps, so the search ends at a larger radius.
        """
        from scipy.optimize import minimize

        minimize(
            self._try,
            self.best,
            method="COBYQA",
            bounds=list(zip(self._posterior.low, self._posterior.high, strict=True)),
            options={
                "maxfev": evaluations,
                "initial_tr_radius": _FIRST_STEP,
                "final_tr_radius": _LAST_STEP,
                "scale": False,
            },
        )

    def _try(self, x):
        """Return the mean score at scaled values (K,), and record both."""
        score = float(self._posterior.at(x).mean())
        self._points.append(np.array(x))
        self._scores.append(score)
        return score
