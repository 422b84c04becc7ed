"""Square-root surrogate: contacts tilt normals, which feeds roots of velocity covariances (section 4.2)."""

from __future__ import annotations

from dataclasses import dataclass

from ..scene.physics_keys import INTEGRATORS
from .base import Traits
from .contact_kicks import TiltedNormals
from .contact_steps import NominalWithBlocks
from .options import option
from .surrogate_contacts import advance_roots


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

    def contact_method(self):
        return TiltedNormals(self.k_sigma)

    def advance_explicit(self, mean, blocks, first_time, scene, begin, steps):
        world = scene.world
        advance_roots(mean, blocks, first_time, world, world.environment, begin, steps, self.k_sigma)
