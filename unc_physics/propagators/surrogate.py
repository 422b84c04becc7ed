"""Square-root surrogate: contacts tilt normals, which feeds roots of velocity covariances (section 4.2)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..dynamics import contact_history as histories
from ..dynamics.contact_history import ContactHistory
from ..dynamics.implicit_rollout import FIRST_ROOM
from ..scene.belief import Belief
from ..scene.marks import whole
from ..scene.physics_keys import INTEGRATORS
from ..spatial.moments import symmetric_root
from .base import Propagator, Traits
from .contact_kicks import TiltedNormals
from .contact_steps import advanced
from .implicit_surrogate import advance_solved_roots
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
class Surrogate(Propagator):
    """Square-root surrogate model, one body at a time (Eqs. 11 to 24).

    Notes
    -----
    The mean is a rollout with the full physics. The contact points of Eqs. 16 to 20 and 23 are the spheres'
    centres; all contacts of a step see the covariance after the drift. The environment's normals do not tilt:
    its contacts move the mean alone. On exact shapes `contact_steps` says what acts, and `k_sigma` counts ten
    times, because an impulse acts once.
    """

    name = "surrogate"
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

    def advance_through(self, carry, scene, marks):
        if scene.integrator != "contact":
            return super().advance_through(carry, scene, marks)
        method = TiltedNormals(self.k_sigma)
        own = carry.mean, carry.roots, carry.contact_history
        through = advanced(*own, method, scene, carry.step, marks, turns=1)
        steps = [mark.fraction_of(scene.dt) for mark in marks]
        return [SurrogateCarry(*at, 0)._replace(step=step) for at, step in zip(through, steps, strict=True)]

    def advance(self, carry, scene, steps):
        if scene.integrator == "contact":
            return self.advance_through(carry, scene, [whole(carry.step + steps, scene.dt)])[0]
        mean, roots, history = carry.mean.copy(), carry.roots.copy(), histories.copy(carry.contact_history)
        world = scene.world
        first, begun = history.first_time[0], carry.step
        if world.implicit is None:
            advance_roots(mean, roots, first, world, world.environment, begun, steps, self.k_sigma)
        else:
            source = roots, self.k_sigma
            advance_solved_roots(mean, first, history.solver, 0, world, source, begun, steps, FIRST_ROOM)
        return SurrogateCarry(mean, roots, history, carry.step + steps)

    def belief(self, carry, scene):
        P = carry.roots @ carry.roots.transpose(0, 2, 1)
        return Belief.trusted(carry.mean.copy(), 0.5 * (P + P.transpose(0, 2, 1)), scene.moving)
