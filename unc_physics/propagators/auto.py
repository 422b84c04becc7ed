"""An anytime answer: clouds of ever more rollouts, until they are sure enough or time is up."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..physics.compile_time import clock
from .base import one_after_the_other
from .cloud import FEWEST_RUNS, Cloud
from .emission import diverged, settled
from .options import option

_FIRST = 16  # rollouts, before it is known what more of them would be good for
_FITS = 4.0  # times what a look at the errors takes, for which the answer after another batch needs time


@dataclass(frozen=True)
class Auto(Cloud):
    """A cloud of as many rollouts as a wanted error or a time takes.

    Attributes
    ----------
    runs : int
        The most rollouts. It begins with 16.
    samples, seed, points, surface
        As of `Cloud`.
    time : float
        Wall time that the rollouts may take [s]; 0 for any. The last batch is as large as it is thought to
        leave time for, and no less than one rollout.
    error : float
        Standard error of each mean that is enough, over the standard deviation; 0 goes on for ever.
    position_error, rotation_error : float
        The same in m and rad; 0 does not count.
    probability_error : float
        Standard error of probabilities that is enough: of one that is a half; 0 does not count.

    Notes
    -----
    Every batch doubles the rollouts and simulates only the new ones: the points are nested. Of the wishes for
    errors all must be met. Without a time limit the answer depends on nothing but the seed; with one, on the
    number of rollouts, which it reports (`Propagator.rollouts`). Islands keep to 64 rollouts.
    """

    name = "auto"
    color, marker = "#882255", "P"
    grows = True

    runs: int = option(1024, "the most rollouts", low=FEWEST_RUNS, high=100_000)
    time: float = option(0.0, "wall time that rollouts may take [s]; 0 for any", low=0.0)
    error: float = option(0.1, "standard error of means that is enough, over the standard deviation", low=0.0)
    position_error: float = option(0.0, "standard error of positions that is enough [m]; 0 for any", low=0.0)
    rotation_error: float = option(
        0.0, "standard error of rotations that is enough [rad]; 0 for any", low=0.0
    )
    probability_error: float = option(
        0.0, "standard error of probabilities that is enough; 0 for any", low=0.0
    )

    def init(self, scene, belief):
        return self.begun(scene, belief, 0, min(4 * _FIRST if scene.islands else _FIRST, self.runs))

    def further(self, carry, scene, spent):
        count, began = len(carry.states), clock()
        more = min(count, self.runs - count)
        if more <= 0 or diverged(carry.states) or self._sure(carry, scene):
            return 0
        if self.time > 0.0:
            fitted = clock() - began
            left = self.time - spent - fitted - _FITS * fitted
            more = min(more, math.floor(left * count / spent))
        return max(more, 0)

    def together(self, carry, further):
        return one_after_the_other(carry, further)

    def _sure(self, carry, scene):
        """Whether all wishes are met; with none, nothing that rollouts tell is ever sure enough."""
        if settled(self._runs(carry), scene):
            return True
        wishes = self.error, self.position_error, self.rotation_error, self.probability_error
        if not any(wishes):
            return False
        errors = self.standard_errors(carry, scene)
        probability = np.array([0.5 / math.sqrt(len(carry.states))])
        found = errors.relative, errors.position, errors.rotation, probability
        return all(bool((f <= wish).all()) for wish, f in zip(wishes, found, strict=True) if wish > 0.0)
