"""Monte Carlo: independent samples through the full simulator, the truth that the others are measured by."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..dynamics import contact_history as histories
from ..dynamics.contact_history import ContactHistory
from ..scene.belief import Belief
from ..scene.kinematic_states import start_states
from ..scene.parameters import center_offsets, draw_parameters, moved_along
from ..scene.physics_keys import INTEGRATORS
from ..scene.scene import UNCERTAIN_PARAMETERS, Scene
from ..spatial.moments import mean_and_errors, second_moment, spread_states
from .base import SAMPLES_LIMIT, Rollouts, Samples, Supports, Traits
from .free_flight import course_of
from .options import option
from .reduction import common_covariance, moved_in_common, reduction, symmetric
from .rollouts import SimulatedRollouts
from .start import draw, resolve_initial_overlap


class MonteCarloCarry(NamedTuple):
    """Persistent state: ``states`` (N, B, 13), of the bodies' centres of mass, wherever those are uncertain.

    ``parameters`` (N, K) are the samples' K uncertain parameters, in standard deviations from their values;
    ``step`` counts the steps done; ``contact_history`` is what the rollouts remember of their contacts.
    ``common`` (N, 6) are the samples' common translation and velocity at time 0 that were not simulated,
    and ``motion`` (6, c) what they were drawn by; both are empty without reduction.
    """

    states: np.ndarray
    contact_history: ContactHistory
    step: int
    parameters: np.ndarray
    common: np.ndarray
    motion: np.ndarray


@dataclass(frozen=True)
class MonteCarlo(SimulatedRollouts, Samples, Rollouts):
    """Monte Carlo sampling.

    Notes
    -----
    Mean and covariance are the samples' own, with weights 1/N; rotations are averaged by the Karcher mean.
    Those of a common motion are exact where it is left to a closed form.
    """

    name = "monte_carlo"
    random_moments = True
    traits = Traits("estimated", "samples", True, False, "simulated")
    integrators = INTEGRATORS
    supports = Supports(UNCERTAIN_PARAMETERS, INTEGRATORS, impact_errors=True, overlap_rejection=True)

    samples: int = option(1000, "number of rollouts", low=1, high=SAMPLES_LIMIT)
    #: a run with fewer samples has the first draws of a run with more
    seed: int = option(0, "seed of the draws", low=0)
    #: common motion is that of bodies that can meet nothing but each other (`reduction`); the option does
    #: nothing where there is something else to meet
    reduce: bool = option(False, "whether common motion is left to a closed form")

    def init(self, scene, belief):
        return self.init_rollouts(scene, belief, 0, self.samples)

    def init_rollouts(self, scene, belief, first, last):
        common, motion = np.zeros((last, 0)), np.zeros((6, 0))
        if self.reduce and symmetric(scene) and scene.overlap != "reject":
            drawn, common, motion = self._reduced(scene, belief, last)
        else:
            drawn = self.drawn(scene, belief, last)
        carry = self.start_rollouts(scene, belief, drawn[first:], first)
        return carry._replace(common=common[first:], motion=motion)

    def start_rollouts(
        self, scene: Scene, belief: Belief, states: np.ndarray, first: int = 0
    ) -> MonteCarloCarry:
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
        return MonteCarloCarry(states, history, 0, z, np.zeros((count, 0)), np.zeros((6, 0)))

    def drawn(self, scene: Scene, belief: Belief, count: int) -> np.ndarray:
        """Return states (count, B, 13) drawn from a belief; larger counts begin alike."""
        return draw(scene, belief, count, self.seed)

    def drawn_parameters(self, scene: Scene, count: int) -> np.ndarray:
        """Return uncertain parameters (count, K) in standard deviations, drawn likewise."""
        return draw_parameters(scene, count, self.seed)

    def _reduced(self, scene, belief, count):
        """Return states (N, B, 13), common motions (N, 6), and their root."""
        root = belief.root()
        reduced = reduction(root)
        z = np.random.default_rng(self.seed).standard_normal((count, root.shape[1]))
        errors = np.einsum("nr,kr->nk", z[:, : reduced.relative.shape[1]], root @ reduced.relative)
        states = spread_states(belief.mean.copy(), scene.moving.copy(), errors)
        common = np.einsum("nc,kc->nk", z[:, reduced.relative.shape[1] :], reduced.motion)
        return states, common, reduced.motion

    def select_rollouts(self, carry, rollouts):
        return super().select_rollouts(carry, rollouts)._replace(common=carry.common[rollouts])

    def concatenate(self, carry, additional):
        common = np.concatenate([carry.common, additional.common])
        return super().concatenate(carry, additional)._replace(common=common)

    def belief(self, carry, scene):
        mean, errors = mean_and_errors(self._model_centers(carry, scene), scene.moving.copy())
        P = second_moment(errors)
        if carry.motion.size:
            P += common_covariance(carry.motion, course_of(scene.world, carry.step), len(scene.moving))
        return Belief.trusted(mean, P, scene.moving)

    @property
    def own_sample_count(self):
        return self.samples

    def own_samples(self, carry, scene):
        """Return the samples' states (N, B, 13) of the models' centres of mass, as in beliefs."""
        states = self._model_centers(carry, scene)
        if carry.common.size:
            states = states.copy()
            moved_in_common(states, carry.common, course_of(scene.world, carry.step))
        return states

    def _model_centers(self, carry, scene):
        return moved_along(carry.states, -center_offsets(scene, carry.parameters))
