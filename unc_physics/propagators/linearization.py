"""Linearization about the nominal rollout: of each explicit step (the paper's section 4.1), or of rollouts.

The explicit step has a derivative in closed form. On the other steps, whose contacts are solved, slopes are
central differences of whole rollouts along the uncertain directions.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..compiler import kernel
from ..compiler.arrays import empty, integers
from ..physics import contact_history as histories
from ..physics.contact_history import ContactHistory
from ..physics.paper.drift_derivative import apply_drift_jacobian, write_exact_rotation
from ..physics.paper.explicit_step import (
    after_element,
    after_pair,
    after_pairs,
    before_drift,
    integrate,
    on_contacts,
    on_element_contacts,
)
from ..physics.paper.narrow_phase import NORMAL, POINT, VOLUME
from ..physics.paper.workspace import workspace
from ..scene.belief import Belief
from ..scene.physics_keys import INTEGRATORS
from ..scene.scene import UNCERTAIN_PARAMETERS
from ..spatial.layout import ERR_ANGULAR_VELOCITY, ERR_POSITION, ERR_ROTATION, ERR_VELOCITY, ERROR
from ..spatial.rotation import cross, rotate
from .base import Propagator, Supports, Traits
from .contact_derivative import contact_root, kick_column, moved_by_column
from .point_pairs import most_points, opposite_points, point_states, spread_points
from .rollouts import SimulatedRollouts, advance_rollouts, recorded_rollouts
from .start import resolve_initial_overlap

#: Distance of the points of central differences from the mean, in standard deviations. Slopes of a smooth
#: outcome are then exact but for 1/600 of its third derivative by standard deviations. Wide beliefs have
#: limits, which keep the contacts of the mean: in position [m], below the sizes of edges and bumps, and 40
#: times the depth at which contacts rest; in rotation [rad], by which the ends of a body of 20 cm move as
#: far; in velocities [m/s] [rad/s], by which a body moves as far in 0.1 s.
REACH = 0.1
LIMITS = ((ERR_POSITION, 1e-3), (ERR_ROTATION, 1e-2), (ERR_VELOCITY, 1e-2), (ERR_ANGULAR_VELOCITY, 1e-1))


#: Integrators whose contacts have no derivative in closed form.
_DIFFERENCES = ("implicit",)


class LinearizationCarry(NamedTuple):
    """Persistent state on the explicit step."""

    mean: np.ndarray  # (B, 13): the nominal rollout
    #: (12 M, r): ``root @ root.T`` is the joint covariance; r is the rank of the initial one, which no
    #: step raises
    root: np.ndarray
    contact_history: ContactHistory  # what the rollout remembers of its contacts
    step: int  # counts the steps done


class DifferenceCarry(NamedTuple):
    """Persistent state on the other steps: rollouts as in `rollouts.RolloutCarry`.

    ``reach`` (n,) is the distance of the points from the mean along each direction, in standard deviations.
    """

    states: np.ndarray
    contact_history: ContactHistory
    step: int
    parameters: np.ndarray
    reach: np.ndarray


@dataclass(frozen=True)
class Linearization(SimulatedRollouts):
    """Joint covariance through derivatives of the nominal rollout (Eqs. 7 to 10).

    Notes
    -----
    The mean is a rollout with the full physics. On the explicit step, ``F_t`` is the derivative of a step in
    which only the dominant pair of spheres of each pair of bodies acts, with constant volume and Eq. 10's
    normal. ``F_t P F_t^T`` is never formed: a root of P with as many columns as P has rank goes through
    ``F_t``, which keeps P symmetric and positive semidefinite, and costs less. A contact with the environment
    keeps its normal.

    On the other steps, the root's columns are central differences of 2 n + 1 rollouts along n uncertain
    directions, those of the scene's parameters included.
    """

    name = "linearization"
    traits = Traits("nominal", "full covariance", True, False, "linearized")
    integrators = INTEGRATORS
    supports = Supports(UNCERTAIN_PARAMETERS, _DIFFERENCES, parameters_on=_DIFFERENCES)

    def init(self, scene, belief):
        root = belief.root()
        if scene.integrator in _DIFFERENCES:
            reach = _reach(scene, root)
            return DifferenceCarry(*spread_points(scene, belief, root, reach), reach)
        mean, history = resolve_initial_overlap(scene, belief, belief.mean[None].copy())
        return LinearizationCarry(mean[0], root, history, 0)

    def advance(self, carry, scene, steps):
        if scene.integrator in _DIFFERENCES:
            return advance_rollouts(carry, scene, steps)
        mean, root, history = carry.mean.copy(), carry.root.copy(), histories.copy(carry.contact_history)
        world, begun = scene.world, carry.step
        _advance(mean, root, history.first_time[0], world, world.environment, begun, steps)
        return LinearizationCarry(mean, root, history, begun + steps)

    def advance_through(self, carry, scene, marks):
        if scene.integrator in _DIFFERENCES:
            return recorded_rollouts(carry, scene, marks)
        return Propagator.advance_through(self, carry, scene, marks)

    def belief(self, carry, scene):
        if scene.integrator == "explicit":
            return Belief.trusted(carry.mean.copy(), _outer(carry.root), scene.moving)
        points = point_states(carry, scene)
        forth, back = opposite_points(points, scene.moving)
        slopes = 0.5 * (forth / carry.reach[:, None, None] - back / carry.reach[:, None, None])
        slopes = slopes.reshape(len(slopes), ERROR * len(scene.moving))
        return Belief.trusted(points[0], _outer(slopes.T.copy()), scene.moving)

    def most_rollouts(self, scene, belief):
        return most_points(scene, belief) if scene.integrator in _DIFFERENCES else 1


def _reach(scene, root):
    """Return the reach (n,) of central differences along the columns of a root, then of parameters."""
    errors = root.reshape(len(scene.moving), ERROR, root.shape[1])
    reach = np.full(root.shape[1] + len(scene.uncertain), REACH)
    for block, limit in LIMITS:
        most = np.linalg.norm(errors[:, block], axis=1).max(axis=0, initial=0.0)
        reach[: len(most)] = np.minimum(reach[: len(most)], limit / np.maximum(most, limit))
    for k, parameter in enumerate(scene.uncertain, root.shape[1]):
        if parameter.name == "trajectory":
            reach[k] = min(REACH, LIMITS[parameter.axis // 3][1] / parameter.std)
    return reach


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
