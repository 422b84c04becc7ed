"""Monte Carlo: independent samples through the full simulator, the truth that the others are measured by."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..physics import contact_history as histories
from ..physics.contact_history import ContactHistory
from ..physics.moments import mean_and_errors, second_moment
from ..scene.belief import Belief
from ..scene.parameters import center_offsets, draw_parameters, moved_along
from ..scene.physics_keys import INTEGRATORS
from .base import SAMPLES_LIMIT, Propagator, Traits, rolled
from .joining import joined_history
from .options import option
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
    traits = Traits("estimated", "samples", True, False, "simulated")
    label, color, marker = "Monte Carlo", "#000000", "o"
    integrators = INTEGRATORS
    varies_parameters = rejects_overlap = draws_together = True

    samples: int = option(1000, "number of rollouts", low=1, high=SAMPLES_LIMIT)
    seed: int = option(0, "seed of the draws", low=0)

    def init(self, scene, belief):
        states, history = begin(scene, belief, draw(scene, belief, self.samples, self.seed))
        z = draw_parameters(scene, self.samples, self.seed)
        states = moved_along(states, center_offsets(scene, z))
        return MonteCarloCarry(states, history, 0, z)

    def advance(self, carry, scene, steps):
        return rolled(carry, scene, steps)

    def belief(self, carry, scene):
        mean, errors = mean_and_errors(self.own_samples(carry, scene), scene.moving.copy())
        return Belief.trusted(mean, second_moment(errors), scene.moving)

    def join(self, carries, parts, frame):
        count = len(carries[0].states)
        states, z = np.tile(frame.mean, (count, 1, 1)), np.zeros((count, frame.parameters))
        for carry, part in zip(carries, parts, strict=True):
            states[:, part.bodies] = carry.states
            z[:, part.parameters] = carry.parameters
        return carries[0]._replace(
            states=states, contact_history=joined_history(carries, parts, frame), parameters=z
        )

    def part(self, carry, bodies, parameters):
        return carry._replace(
            states=np.ascontiguousarray(carry.states[:, bodies]),
            contact_history=histories.of_bodies(carry.contact_history, bodies),
            parameters=np.ascontiguousarray(carry.parameters[:, parameters]),
        )

    @property
    def own_sample_count(self):
        return self.samples

    def own_samples(self, carry, scene):
        """(N, B, 13): the samples' states of the models' centres of mass, as beliefs have them."""
        return moved_along(carry.states, -center_offsets(scene, carry.parameters))
