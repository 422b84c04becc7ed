"""Monte Carlo: independent samples through the full simulator, the truth that the others are measured by."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..physics import contact_history as histories
from ..scene.belief import Belief
from ..scene.kinematic_states import start_states
from ..scene.parameters import center_offsets, draw_parameters, moved_along
from ..scene.physics_keys import INTEGRATORS
from ..scene.scene import UNCERTAIN_PARAMETERS, Scene
from ..spatial.moments import mean_and_errors
from .base import SAMPLES_LIMIT, Rollouts, Samples, Supports, Traits
from .options import option
from .rollouts import RolloutCarry, SimulatedRollouts
from .start import draw, resolve_initial_overlap


@dataclass(frozen=True)
class MonteCarlo(SimulatedRollouts, Samples, Rollouts):
    """Monte Carlo sampling.

    Notes
    -----
    Mean and covariance are the samples' own, with weights 1/N; rotations are averaged by the Karcher mean.
    """

    name = "monte_carlo"
    random_moments = joint_when_used = True
    traits = Traits("estimated", "samples", True, False, "simulated")
    integrators = INTEGRATORS
    supports = Supports(UNCERTAIN_PARAMETERS, INTEGRATORS, impact_errors=True, overlap_rejection=True)

    samples: int = option(1000, "number of rollouts", low=1, high=SAMPLES_LIMIT)
    #: a run with fewer samples has the first draws of a run with more
    seed: int = option(0, "seed of the draws", low=0)

    def init(self, scene, belief):
        return self.init_rollouts(scene, belief, 0, self.samples)

    def init_rollouts(self, scene, belief, first, last):
        return self.start_rollouts(scene, belief, self.drawn(scene, belief, last)[first:], first)

    def start_rollouts(
        self, scene: Scene, belief: Belief, states: np.ndarray, first: int = 0
    ) -> RolloutCarry:
        """Return the carry at time 0 of rollouts from states (N, B, 13) that represent a belief.

        Overlap is removed in the belief's metric. ``first`` is the number of the first rollout: each one has
        draws of its own for uncertain parameters and errors of impacts.
        """
        count = len(states)
        states, history = resolve_initial_overlap(scene, belief, states)
        if scene.draws_impacts:
            history = histories.with_keys(history, self.seed, first)
        z = self.drawn_parameters(scene, first + count)[first:]
        states = moved_along(start_states(scene, states, z), center_offsets(scene, z))
        return RolloutCarry(states, history, 0, z)

    def drawn(self, scene: Scene, belief: Belief, count: int) -> np.ndarray:
        """Return states (count, B, 13) drawn from a belief; larger counts begin alike."""
        return draw(scene, belief, count, self.seed)

    def drawn_parameters(self, scene: Scene, count: int) -> np.ndarray:
        """Return uncertain parameters (count, K) in standard deviations, drawn likewise."""
        return draw_parameters(scene, count, self.seed)

    def belief(self, carry, scene):
        mean, errors = mean_and_errors(self.own_samples(carry, scene), scene.moving.copy())
        return Belief.of_errors(mean, errors, scene.moving)

    @property
    def own_sample_count(self):
        return self.samples

    def own_samples(self, carry, scene):
        """Return the samples' states (N, B, 13) of the models' centres of mass, as in beliefs."""
        return moved_along(carry.states, -center_offsets(scene, carry.parameters))
