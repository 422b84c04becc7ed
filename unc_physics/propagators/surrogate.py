"""Square-root surrogate: contacts tilt normals, which feeds roots of velocity covariances (section 4.2)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..physics import contact_history as histories
from ..physics.contact_history import ContactHistory
from ..scene.belief import Belief
from ..scene.physics_keys import INTEGRATORS
from ..spatial.moments import symmetric_root
from .base import Traits
from .contact_kicks import TiltedNormals
from .contact_steps import NominalWithBlocks
from .options import option
from .start import resolve_initial_overlap
from .surrogate_contacts import advance_roots


class SurrogateCarry(NamedTuple):
    """Persistent state: the nominal ``mean`` (B, 13) and moving bodies' covariance ``roots`` (M, 12, 12).

    ``step`` counts the steps done; ``contact_history`` is what the rollout remembers of its contacts.
    """

    mean: np.ndarray
    roots: np.ndarray
    contact_history: ContactHistory
    step: int


@dataclass(frozen=True)
class Surrogate(NominalWithBlocks):
    """Square-root surrogate model, one body at a time (Eqs. 11 to 24).

    Notes
    -----
    The mean is a rollout with the full physics. The contact points of Eqs. 16 to 20 and 23 are the spheres'
    centres; all contacts of a step see the covariance after the drift. The environment's normals do not tilt:
    its contacts move the mean alone. With the implicit integrator `contact_steps` says what acts, and
    `k_sigma` counts ten times, because an impulse acts once.
    """

    name = "surrogate"
    turns = 1
    traits = Traits("nominal", "square-root, per body", False, True, "surrogate")
    integrators = INTEGRATORS

    #: how many standard deviations of the contact's position tilt its normal (Eq. 20). The paper leaves it
    #: open; the default has the smallest errors after collisions (``evaluate paper`` sweeps it)
    k_sigma: float = option(
        0.3, "standard deviations of a contact's position that tilt its normal", positive=True
    )

    def init(self, scene, belief):
        mean, history = resolve_initial_overlap(scene, belief, belief.mean[None].copy())
        return SurrogateCarry(mean[0], symmetric_root(belief.blocks), history, 0)

    def contact_method(self):
        return TiltedNormals(self.k_sigma)

    def advance_explicit(self, carry, scene, steps):
        mean, roots, history = carry.mean.copy(), carry.roots.copy(), histories.copy(carry.contact_history)
        world, first = scene.world, history.first_time[0]
        advance_roots(mean, roots, first, world, world.environment, carry.step, steps, self.k_sigma)
        return SurrogateCarry(mean, roots, history, carry.step + steps)

    def belief(self, carry, scene):
        P = carry.roots @ carry.roots.transpose(0, 2, 1)
        return Belief.trusted(carry.mean.copy(), 0.5 * (P + P.transpose(0, 2, 1)), scene.moving)
