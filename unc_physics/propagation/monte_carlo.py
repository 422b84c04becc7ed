"""Monte Carlo: independent samples through the full simulator, the truth that the others are measured by."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..belief import Belief
from ..errors import InvalidOptionError
from ..kernels.moments import mean_and_errors, second_moment
from ..kernels.rollout import fresh_memory, rollout
from ..validation import integer
from .base import Propagator, Traits


class MonteCarloCarry(NamedTuple):
    """Persistent state: ``states`` (N, B, 13).

    ``step`` counts the steps done; ``memory`` is what the rollouts remember of their contacts (`kernels.laws.FIRST`).
    """

    states: np.ndarray
    memory: np.ndarray
    step: int


@dataclass(frozen=True)
class MonteCarlo(Propagator):
    """Monte Carlo sampling.

    Attributes
    ----------
    samples : int
        Number of rollouts.
    seed : int
        Of the initial draws. A run with fewer samples has the first ones of a run with more.

    Notes
    -----
    Mean and covariance are the samples' own, with weights 1/N; rotations are averaged by the Karcher mean.
    """

    name = "monte_carlo"
    traits = Traits("estimated", "samples", True, False, "simulated")

    samples: int = 1000
    seed: int = 0

    def __post_init__(self):
        self._check_count("samples")
        integer(self.seed, "seed", low=0, error=InvalidOptionError)

    def init(self, scene, belief):
        states = belief.sample(self.samples, np.random.default_rng(self.seed))
        return MonteCarloCarry(states, fresh_memory(len(states), scene.world), 0)

    def advance(self, carry, scene, steps):
        states, memory = carry.states.copy(), carry.memory.copy()
        rollout(states, memory, scene.world, carry.step, steps)
        return MonteCarloCarry(states, memory, carry.step + steps)

    def belief(self, carry, scene):
        mean, errors = mean_and_errors(carry.states, scene.moving.copy())
        return Belief.trusted(mean, second_moment(errors), scene.moving)
