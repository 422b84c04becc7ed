"""Monte Carlo: independent samples through the full simulator, the truth that the others are measured by."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..checks.errors import InvalidOptionError
from ..checks.validation import integer
from ..physics.contact_history import ContactHistory
from ..physics.moments import mean_and_errors, second_moment
from ..scene.belief import Belief
from ..scene.parameters import center_offsets, draw_parameters, moved_along
from ..scene.scene import INTEGRATORS
from .base import Propagator, Traits, rolled
from .start import begin, draw


class MonteCarloCarry(NamedTuple):
    """Persistent state: ``states`` (N, B, 13), of the bodies' centres of mass, wherever those are uncertain.

    ``parameters`` (N, K) are the samples' K uncertain parameters, in standard deviations from their values;
    ``step`` counts the steps done; ``contact_history`` is what the rollouts remember of their contacts.
    """

    states: np.ndarray
    contact_history: ContactHistory
    step: int
    parameters: np.ndarray


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
    varies_parameters = True
    integrators = INTEGRATORS
    traits = Traits("estimated", "samples", True, False, "simulated")

    samples: int = 1000
    seed: int = 0

    def __post_init__(self):
        self._check_count("samples")
        integer(self.seed, "seed", low=0, error=InvalidOptionError)

    def init(self, scene, belief):
        states, history = begin(scene, belief, draw(scene, belief, self.samples, self.seed))
        z = draw_parameters(scene, self.samples, self.seed)
        states = moved_along(states, center_offsets(scene, z))
        return MonteCarloCarry(states, history, 0, z)

    def advance(self, carry, scene, steps):
        return rolled(carry, scene, steps)

    def belief(self, carry, scene):
        mean, errors = mean_and_errors(self.states(carry, scene), scene.moving.copy())
        return Belief.trusted(mean, second_moment(errors), scene.moving)

    def own_samples(self, carry, scene):
        return self.states(carry, scene)

    def states(self, carry, scene):
        """(N, B, 13): the samples' states of the models' centres of mass, as beliefs have them."""
        return moved_along(carry.states, -center_offsets(scene, carry.parameters))
