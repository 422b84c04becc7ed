"""Linearization of the whole step about the nominal rollout (the paper's section 4.1)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..collision.narrow_phase import NORMAL, POINT, VOLUME
from ..compiler import kernel
from ..compiler.arrays import empty, integers
from ..derivatives.rolling import TILTS
from ..derivatives.transition import apply_drift_jacobian, write_exact_rotation
from ..dynamics import contact_history as histories
from ..dynamics.contact_history import ContactHistory
from ..dynamics.explicit_step import (
    after_element,
    after_pair,
    after_pairs,
    before_drift,
    integrate,
    on_contacts,
    on_element_contacts,
)
from ..dynamics.implicit_rollout import FIRST_ROOM
from ..dynamics.workspace import workspace
from ..scene.belief import Belief
from ..scene.kinematic_states import UNCERTAIN
from ..scene.physics_keys import INTEGRATORS
from ..spatial.layout import ERROR
from ..spatial.rotation import cross, rotate
from .action_directions import directions, start_root
from .base import ContactModes, Propagator, Supports, Traits
from .contact_derivative import contact_root, kick_column, moved_by_column
from .implicit_linearization import advance_root
from .start import resolve_initial_overlap


class LinearizationCarry(NamedTuple):
    """Persistent state."""

    mean: np.ndarray  # (B, 13): the nominal rollout
    #: (12 M, r): ``root @ root.T`` is the joint covariance; r is the rank of the initial one, which no
    #: step raises, and the number of uncertain parameters of actions, whose columns come last
    root: np.ndarray
    contact_history: ContactHistory  # what the rollout remembers of its contacts
    #: (B,): first time at which contacts of each body would have done something else within a standard
    #: deviation [s]; infinite if never, and with the explicit integrator
    contact_mode_uncertain_since: np.ndarray
    step: int  # counts the steps done


@dataclass(frozen=True)
class Linearization(Propagator, ContactModes):
    """Joint covariance through the derivative of each step (Eqs. 7 to 10).

    Notes
    -----
    The mean is a rollout with the full physics. ``F_t`` is the derivative of a step in which only the
    dominant pair of spheres of each pair of bodies acts, with constant volume and Eq. 10's normal. ``F_t P
    F_t^T`` is never formed: a root of P with as many columns as P has rank goes through ``F_t``, which keeps
    P symmetric and positive semidefinite, and costs less. A contact with the environment keeps its normal.
    """

    name = "linearization"
    traits = Traits("nominal", "full covariance", True, False, "linearized")
    integrators = INTEGRATORS
    supports = Supports(UNCERTAIN, actions=("implicit",))

    def init(self, scene, belief):
        mean, history = resolve_initial_overlap(scene, belief, belief.mean[None].copy())
        judged = len(scene.bodies) if scene.integrator == "implicit" else 0
        root = start_root(scene, belief, mean[0])
        return LinearizationCarry(mean[0], root, history, np.full(judged, np.inf), 0)

    def advance(self, carry, scene, steps):
        mean, root, history = carry.mean.copy(), carry.root.copy(), histories.copy(carry.contact_history)
        world = scene.world
        first, begun = history.first_time[0], carry.step
        uncertain = carry.contact_mode_uncertain_since.copy()
        if world.implicit is not None:
            some = directions(scene, root.shape[1])
            source = root, uncertain, some, TILTS
            advance_root(mean, first, history.solver, 0, world, source, begun, steps, FIRST_ROOM)
            return LinearizationCarry(mean, root, history, uncertain, begun + steps)
        _advance(mean, root, first, world, world.environment, begun, steps)
        return LinearizationCarry(mean, root, history, uncertain, begun + steps)

    def belief(self, carry, scene):
        return Belief.trusted(carry.mean.copy(), _outer(carry.root), scene.moving)

    def contact_mode_uncertain_since(self, carry):
        return carry.contact_mode_uncertain_since if len(carry.contact_mode_uncertain_since) else None


class DominantContacts(NamedTuple):
    """The contact with the largest volume of each touching pair of bodies, in one step."""

    count: np.ndarray  # (1,) int64: number of touching pairs so far
    bodies: np.ndarray  # (B (B - 1) / 2, 2) int64
    spheres: np.ndarray  # (B (B - 1) / 2, 2) int64: indices into the scene's trees
    volume: np.ndarray  # (B (B - 1) / 2,) float64: [m^3]


class DominantElementContact(NamedTuple):
    """The contact with the largest volume of a body and an element of the environment."""

    sphere: np.ndarray  # (1,) int64
    volume: np.ndarray  # (1,) float64: [m^3]
    #: force, point: (3,) float64: force on the body [N], and the contact point from its centre of mass [m],
    #: in world axes
    force: np.ndarray
    point: np.ndarray


class ExplicitLinearization(NamedTuple):
    """State of linearization in a rollout."""

    root: np.ndarray  # (12 M, r) float64
    #: (B,) int64: which of the root's blocks of 12 rows is each body's; -1 for a fixed body
    error_block: np.ndarray
    transition: np.ndarray  # (3, 3) float64: room for a block of it
    dominant: DominantContacts
    element: DominantElementContact


@kernel
def _advance(mean, root, first_time, world, environment, begin, steps):
    """Advance state and root in place."""
    work, moving = workspace(mean, world), world.bodies.moving
    pairs = len(work.near)
    dominant = DominantContacts(integers(1), integers((pairs, 2)), integers((pairs, 2)), empty(pairs))
    element = DominantElementContact(integers(1), empty(1), empty(3), empty(3))
    method = ExplicitLinearization(
        root, np.where(moving, np.cumsum(moving) - 1, -1), empty((3, 3)), dominant, element
    )
    integrate(mean, first_time, world, environment, method, begin, steps, work)


@before_drift.of(ExplicitLinearization)
def _begin_step(method, x, step, world, work):
    """Take the root through the drift's derivative."""
    method.dominant.count[0] = 0
    for i in range(len(x)):
        if world.bodies.moving[i]:
            first = ERROR * method.error_block[i]
            write_exact_rotation(work.R, x, i, world.dt, method.transition)
            apply_drift_jacobian(
                method.root, first, x, i, work.R, world, world.environment, method.transition
            )


@on_contacts.of(ExplicitLinearization)
def _keep_dominant(method, x, i, j, count, first, world, work):
    """Keep the contact of largest volume, ties to the lowest sphere of body i, then of body j."""
    dominant, pairs, records = method.dominant, work.search.pairs, work.search.records
    place = dominant.count[0]
    if first:
        dominant.volume[place] = 0.0
    for k in range(count):
        a, b = pairs[k, 0], pairs[k, 1]
        volume, best = records[k, VOLUME], dominant.volume[place]
        if volume < best:
            continue
        if volume == best and (a, b) >= (dominant.spheres[place, 0], dominant.spheres[place, 1]):
            continue
        dominant.volume[place] = volume
        dominant.spheres[place, 0], dominant.spheres[place, 1] = a, b


@after_pair.of(ExplicitLinearization)
def _count_pair(method, x, i, j, world, work):
    """Give the pair the next number if it has a dominant contact."""
    dominant = method.dominant
    place = dominant.count[0]
    if dominant.volume[place] > 0.0:
        dominant.bodies[place, 0], dominant.bodies[place, 1] = i, j
        dominant.count[0] += 1


@after_pairs.of(ExplicitLinearization)
def _kick_root(method, x, world, work):
    """Let the dominant contacts of all pairs act on the root."""
    for k in range(method.dominant.count[0]):
        contact_root(x, method.root, method.error_block, world, work.R, method.dominant, k)


@on_element_contacts.of(ExplicitLinearization)
def _keep_dominant_of_element(method, x, i, e, t, count, first, world, work):
    """Keep the contact of largest volume with an element, its force and the point where it acts."""
    dominant, pairs, records, R = method.element, work.search.pairs, work.search.records, work.R
    if first:
        dominant.volume[0], dominant.sphere[0] = 0.0, -1
    for k in range(count):
        volume = records[k, VOLUME]
        if volume > dominant.volume[0] or (volume == dominant.volume[0] and pairs[k, 0] < dominant.sphere[0]):
            dominant.volume[0], dominant.sphere[0] = volume, pairs[k, 0]
            f = -world.stiffness * volume
            force = rotate(
                R[i], f * records[k, NORMAL], f * records[k, NORMAL + 1], f * records[k, NORMAL + 2]
            )
            point = rotate(R[i], records[k, POINT], records[k, POINT + 1], records[k, POINT + 2])
            for c in range(3):
                dominant.force[c], dominant.point[c] = force[c], point[c]


@after_element.of(ExplicitLinearization)
def _kick_root_by_element(method, x, i, e, world, work):
    """Let the dominant contact with an element act on the root."""
    dominant, root, row, R = method.element, method.root, ERROR * method.error_block[i], work.R
    if dominant.volume[0] == 0.0:
        return
    force = (dominant.force[0], dominant.force[1], dominant.force[2])
    point = (dominant.point[0], dominant.point[1], dominant.point[2])
    torque = cross(point, force)
    for c in range(root.shape[1]):
        # the force is constant, and what moves the point along the normal leaves the torque alone
        _, turn, d_lever = moved_by_column(root, row, c, R[i], point)
        kick_column(root, row, c, (0.0, 0.0, 0.0), (torque, cross(d_lever, force), turn), world, R, i)


@kernel
def _outer(root):
    """Return ``root @ root.T``, exactly symmetric."""
    size = len(root)
    P = empty((size, size))
    for a in range(size):
        for b in range(a + 1):
            total = 0.0
            for c in range(root.shape[1]):
                total += root[a, c] * root[b, c]
            P[a, b] = P[b, a] = total
    return P
