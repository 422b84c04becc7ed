"""Anytime propagator: clouds of more and more rollouts, until errors or time reach a limit."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ..compiler.compile_time import clock
from .base import Anytime
from .cloud import FEWEST_RUNS, Cloud
from .emission import diverged, settled
from .options import option

_RARE = 1.4  # factor on a spread from which on rare outcomes count
FIRST_RUNS = 32  # rollouts before the first estimate of errors
#: Errors are assumed to fall by the root of the number of rollouts. A batch has a margin on that number, is a
#: multiple of a portion, and has a least share of all rollouts, as each estimate of errors costs a fit.
_MARGIN, _PORTION, _LEAST_GROWTH = 1.05, 8, 0.25
_DEARER = 2.0  # factor on the measured time of a fit, as later fits have more rollouts
_WORTH = (
    1.0 / 16.0
)  # share of the rollouts: a time budget that allows fewer additional ones ends the prediction


@dataclass(frozen=True)
class Auto(Cloud, Anytime):
    """A cloud of as many rollouts as a wanted error or a time takes.

    Notes
    -----
    A batch simulates only new rollouts, because the points are nested. It has as many as the errors still
    require, at most as many as there are already. It ends when all limits are met, or at ``runs`` rollouts.
    How far a body of revolution turns about its axis has no consequences, and does not count. The status says
    if a limit was missed. Without a time limit the answer depends on nothing but the seed; with one, on the
    number of rollouts, which it reports (`base.rollout_count`).
    """

    name = "auto"

    runs: int = option(1024, "the most rollouts", low=FEWEST_RUNS, high=100_000)
    first: int = option(
        0, "rollouts to begin with; 0 for 32, or 12 where time is limited", low=0, high=100_000
    )
    #: at all of the prediction's times; the size of the last batch is estimated from the time left
    time: float = option(0.0, "wall time for rollouts and beliefs [s]; 0 for any", low=0.0)
    #: with 0 it continues up to ``runs``, unless other errors are limited
    error: float = option(0.1, "standard error of means that is enough, over the standard deviation", low=0.0)
    spread_error: float = option(
        0.1, "standard error of standard deviations that is enough, over these; 0 for any", low=0.0
    )
    position_error: float = option(0.0, "standard error of positions that is enough [m]; 0 for any", low=0.0)
    rotation_error: float = option(
        0.0, "standard error of rotations that is enough [rad]; 0 for any", low=0.0
    )
    #: the half width of the interval of each requested event, in standard deviations
    probability_error: float = option(
        0.03, "standard error that is enough of probabilities that are asked for; 0 for any", low=0.0
    )

    def init(self, scene, belief):
        first = self.first or (FEWEST_RUNS if self.time > 0.0 else FIRST_RUNS)
        return self.init_rollouts(scene, belief, 0, min(max(first, FEWEST_RUNS), self.runs))

    def within(self, time):
        return replace(self, time=time, first=FIRST_RUNS)

    def additional_rollouts(self, carry, scene, spent):
        count, start = len(carry.states), clock()
        if count >= self.runs or diverged(carry.states):
            return 0
        if 0.0 < self.time <= spent.time:
            return 0
        additional = min(count, self.runs - count, self._wanted(carry, scene, spent))
        if additional > 0 and self.time > 0.0:
            self.belief(carry, scene)
            duration = clock() - start
            answer_time = _DEARER * spent.answers * duration
            left = self.time - spent.time - duration - answer_time
            affordable = math.floor(left * count / (spent.rollouts + answer_time))
            additional = min(additional, affordable) if affordable >= _WORTH * count else 0
        return max(additional, 0)

    def looks_far(self, carry, scene):
        """Return whether contacts are hard, spreads have a limit, and no other limit ends the prediction."""
        limited = self.time > 0.0 or len(carry.states) >= self.runs or self.spread_error == 0.0
        return scene.integrator != "explicit" and not limited and not settled(carry, scene)

    def measures(self, carry, scene):
        return super().measures(carry, scene) | {"missed_goal": self._excess(carry, scene)}

    def _excess(self, carry, scene):
        """Return the largest error of each body over its limit (B,), above 1 for fewer than 32 rollouts."""
        result = np.zeros(len(carry.mean))
        limits = self.error, self.spread_error, self.position_error, self.rotation_error
        if settled(carry, scene):
            return result
        if any(limits):  # which take a fit
            of_rotations = self.standard_errors if self.rotation_error > 0.0 else self._straight_errors
            errors = of_rotations(carry, scene)
            measured = errors.relative, errors.spread, errors.position, errors.rotation
            for limit, error in zip(limits, measured, strict=True):
                if limit > 0.0:
                    result = np.maximum(result, error / limit)
        return np.maximum(result, FIRST_RUNS / len(carry.states))

    def _wanted(self, carry, scene, spent):
        """Return the estimated number of additional rollouts that meet all limits; all without limits."""
        asked = self.probability_error > 0.0 and len(spent.probability_errors) > 0
        limited = self.error or self.position_error or self.rotation_error or asked
        if not (limited or settled(carry, scene)):
            return self.runs
        excess = float(self._excess(carry, scene).max(initial=0.0))
        if asked:  # events are counted in rollouts, also where the moments are known
            excess = max(excess, float(spent.probability_errors.max()) / self.probability_error)
        if spent.rare is not None and self.spread_error > 0.0 and spent.rare > _RARE:
            excess = max(excess, 2.0)  # more rollouts either contain rare outcomes or refute them
        if excess <= 1.0:
            return 0
        count = len(carry.states)
        growth = excess * _MARGIN * excess * _MARGIN - 1.0  # infinite if no number of rollouts suffices
        needed = count * max(growth, _LEAST_GROWTH)
        return _PORTION * math.ceil(min(needed, self.runs) / _PORTION)
