"""Local sampling: contacts are perturbed by the poses' uncertainty, the spread feeds P (section 4.4)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..physics import contact_history as histories
from ..physics.contact_history import ContactHistory
from ..scene.belief import Belief
from ..scene.physics_keys import INTEGRATORS
from .base import Traits
from .contact_kicks import PerturbedContacts
from .contact_steps import NominalWithBlocks
from .local_clouds import advance_covariances
from .options import option
from .sampled_contacts import TABLE
from .start import resolve_initial_overlap

_SAMPLES_LIMIT = 100_000


class LocalSamplingCarry(NamedTuple):
    """Persistent state: the nominal ``mean`` (B, 13) and each moving body's ``covariance`` (M, 12, 12).

    ``step`` counts the steps done, from which the draws are keyed; ``contact_history`` is what the rollout
    remembers of its contacts.
    """

    mean: np.ndarray
    covariance: np.ndarray
    contact_history: ContactHistory
    step: int


@dataclass(frozen=True)
class LocalSampling(NominalWithBlocks):
    """Local sampling, one body at a time (Eqs. 30 to 35).

    Notes
    -----
    The mean is a rollout with the full physics. A perturbed contact keeps the nominal volume; its direction
    and its lever arms are those of the perturbed spheres, the inertia is the nominal one. Positions and
    rotations are drawn independently, as in Eq. 31. With the implicit integrator `contact_steps` says what
    acts, and all contacts of a pair share their draws.
    """

    name = "local_sampling"
    turns = 2
    traits = Traits("nominal", "covariance, per body", False, True, "sampled")
    integrators = INTEGRATORS

    samples: int = option(32, "perturbed copies of each contact", low=1, high=_SAMPLES_LIMIT)
    #: the draws depend on it, the step, the contact and the sample, and on nothing else
    seed: int = option(0, "seed of the draws", low=0)

    def init(self, scene, belief):
        mean, history = resolve_initial_overlap(scene, belief, belief.mean[None].copy())
        return LocalSamplingCarry(mean[0], belief.blocks.copy(), history, 0)

    def contact_method(self):
        return PerturbedContacts(
            *self._draws, np.empty(1, np.uint64), np.empty((3, 6)), np.empty((self.samples, 9))
        )

    def advance_explicit(self, carry, scene, steps):
        mean, covariance = carry.mean.copy(), carry.covariance.copy()
        history, world, draws = histories.copy(carry.contact_history), scene.world, self._draws
        first = history.first_time[0]
        advance_covariances(mean, covariance, first, world, world.environment, carry.step, steps, draws)
        return LocalSamplingCarry(mean, covariance, history, carry.step + steps)

    @property
    def _draws(self):
        return TABLE, self.samples, self.seed % 2**63

    def belief(self, carry, scene):
        P = 0.5 * (carry.covariance + carry.covariance.transpose(0, 2, 1))
        return Belief.trusted(carry.mean.copy(), P, scene.moving)
