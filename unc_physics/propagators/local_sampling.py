"""Local sampling: contacts are perturbed by the poses' uncertainty, the spread feeds P (section 4.4)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..scene.physics_keys import INTEGRATORS
from .base import Traits
from .contact_kicks import PerturbedContacts
from .contact_steps import NominalWithBlocks
from .local_clouds import advance_covariances
from .options import option
from .sampled_contacts import TABLE

_SAMPLES_LIMIT = 100_000


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

    def contact_method(self):
        return PerturbedContacts(
            *self._draws, np.empty(1, np.uint64), np.empty((3, 6)), np.empty((self.samples, 9))
        )

    def advance_explicit(self, mean, blocks, first_time, scene, begin, steps):
        world = scene.world
        advance_covariances(mean, blocks, first_time, world, world.environment, begin, steps, self._draws)

    @property
    def _draws(self):
        return TABLE, self.samples, self.seed % 2**63
