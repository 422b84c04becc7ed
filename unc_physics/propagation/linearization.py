"""Linearization of the whole step about the nominal rollout (the paper's section 4.1)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..belief import Belief
from ..errors import InvalidOptionError, NotSupportedError
from ..physics.compiled import inner, kernel
from ..physics.contact import NORMAL, POINT, VOLUME, next_contacts
from ..physics.laws import hold_columns
from ..physics.moments import boxminus, boxplus
from ..physics.pieces import Piece, next_piece
from ..physics.rollout import fresh_memory
from ..physics.so3 import cross, rotate, rotate_back
from ..physics.step import (
    drift,
    glide,
    kick,
    kick_each,
    note_contact,
    open_pair,
    pairs_to_search,
    part,
    press,
    press_by_laws,
    workspace,
)
from ..physics.element_contacts import next_element_contacts, open_element
from ..physics.transition import apply_transition, turn_columns, write_exact_rotation
from ..layout import EP, ER, ERROR, EV, EW, STATE, P
from .base import Propagator, Traits

_JACOBIANS = ("analytic", "finite_difference")
_STEP = 1e-6  # of the finite differences, in units of the error state


class LinearizationCarry(NamedTuple):
    """Persistent state.

    Attributes
    ----------
    mean : (B, 13) array
        The nominal rollout.
    root : (12 M, r) array
        ``root @ root.T`` is the joint covariance; r is the rank of the initial one, which no step raises.
    memory : (1, B, B + E, 2) array
        What the rollout remembers of its contacts (`physics.laws.FIRST`).
    step : int
        Counts the steps done.
    """

    mean: np.ndarray
    root: np.ndarray
    memory: np.ndarray
    step: int


@dataclass(frozen=True)
class Linearization(Propagator):
    """Joint covariance through the derivative of each step (Eqs. 7 to 10).

    Attributes
    ----------
    jacobian : {'analytic', 'finite_difference'}
        How ``F_t`` is applied: by its closed form, or by central differences of the regularized step.

    Notes
    -----
    The mean is a rollout with the full physics. ``F_t`` is the derivative of a step in which only the dominant
    pair of spheres of each pair of bodies acts, with constant volume and Eq. 10's normal. ``F_t P F_t^T`` is never
    formed: a root of P with as many columns as P has rank goes through ``F_t``, which keeps P symmetric and
    positive semidefinite, and costs less. A contact with the environment keeps its normal. Friction and restitution
    enter by their derivative in the velocities.
    """

    name = "linearization"
    traits = Traits("nominal", "full covariance", True, False, "linearized")

    jacobian: str = "analytic"

    def __post_init__(self):
        if self.jacobian not in _JACOBIANS:
            raise InvalidOptionError(f"must be one of {', '.join(_JACOBIANS)}", field="jacobian", value=self.jacobian)

    def init(self, scene, belief):
        if self.jacobian != "analytic" and scene.world.laws is not None:
            raise NotSupportedError(
                "takes scenes without environment, friction, restitution, gyroscopic term and robust integrator only",
                field="jacobian", value=self.jacobian)
        return LinearizationCarry(belief.mean.copy(), belief.root(), fresh_memory(1, scene.world), 0)

    def advance(self, carry, scene, steps):
        mean, root, memory = carry.mean.copy(), carry.root.copy(), carry.memory.copy()
        world = scene.world
        before = None if self.jacobian == "analytic" else np.empty_like(mean)
        _advance(mean, root, memory[0], world, world.laws, (carry.step, steps), before)
        return LinearizationCarry(mean, root, memory, carry.step + steps)

    def belief(self, carry, scene):
        return Belief.trusted(carry.mean.copy(), _outer(carry.root), scene.moving)


class DominantContacts(NamedTuple):
    """The contact with the largest volume of each touching pair of bodies, in one step.

    Attributes
    ----------
    bodies : (B (B - 1) / 2, 2) int64
    spheres : (B (B - 1) / 2, 2) int64
        Indices into the scene's trees.
    volume : (B (B - 1) / 2,) float64
        [m^3]
    """

    bodies: np.ndarray
    spheres: np.ndarray
    volume: np.ndarray


@kernel
def _advance(mean, root, memory, world, laws, span, before):
    """Advance the nominal state and the root in place over ``span`` = (steps before, number of steps).

    ``before`` (B, 13) is room for the state before a step, for finite differences; None for the closed form, which
    compiles without them.
    """
    work = workspace(mean, world, laws)
    pairs = len(work.near)
    dominant = DominantContacts(np.empty((pairs, 2), np.int64), np.empty((pairs, 2), np.int64), np.empty(pairs))
    rotation = np.empty((3, 3))
    moving, R = world.bodies.moving, work.R
    place = np.where(moving, np.cumsum(moving) - 1, -1)  # of each body in the joint error state
    for step in range(span[0], span[0] + span[1]):
        left, time = world.dt, (step + 1) * world.dt
        while left > 0.0:
            piece = next_piece(mean, memory, world, laws, left, work)
            left = piece.left
            if before is None:
                drift_root(mean, root, place, R, world, laws, (piece.before, piece.decay), rotation)
            else:
                for i in range(len(mean)):
                    for c in range(STATE):
                        before[i, c] = mean[i, c]
            drift(mean, world, laws, piece, work)
            touching = 0
            for k in range(pairs_to_search(mean, world, work)):
                i, j = work.near[k, 0], work.near[k, 1]
                t_ij, slack, top = open_pair(mean, i, j, world, work)
                dominant.volume[touching] = 0.0
                while top > 0:
                    count, top = next_contacts(world.tree, work.R_ij, t_ij, slack, work.search, top)
                    if count > 0:
                        press(mean, i, j, count, world, laws, work)
                        keep_dominant(work.search, count, dominant, touching)
                if dominant.volume[touching] > 0.0:
                    dominant.bodies[touching, 0], dominant.bodies[touching, 1] = i, j
                    touching += 1
                    note_contact(memory, i, j, time)
                else:
                    part(i, j, t_ij, slack, world, work)
            if before is None:
                for k in range(touching):
                    contact_root(mean, root, world, piece.dt, R, dominant, k)
            else:
                _difference(before, root, world, laws, dominant, touching)
            if laws is not None:
                if len(laws.kind) > 0 and work.calm[0] <= 0:
                    for i in range(len(mean)):
                        if moving[i]:
                            for e in range(len(laws.kind)):
                                _press_element(mean, (i, e), root, ERROR * place[i], memory, world, laws, (time, piece.dt), work)
            kick(mean, memory, world, laws, piece, work)
            if laws is not None:
                if work.patches.count[0] > 0 and (laws.friction > 0.0 or laws.dissipation > 0.0):
                    hold_columns(root, place, mean, world, laws, piece.dt, True, work)
                if piece.after > 0.0:
                    drift_root(mean, root, place, R, world, laws, (piece.after, 1.0), rotation)
                    glide(mean, world, laws, piece, work)


@inner
def _press_element(x, touching, root, row, memory, world, laws, when, work):
    """Let element e act on body i, and its dominant contact on the root; ``when`` is the time and the piece's length."""
    i, e = touching
    t, top = open_element(x, i, e, world, laws, work)
    pairs, records, R = work.search.pairs, work.search.records, work.R
    best, sphere = 0.0, np.int64(-1)
    force = point = (0.0, 0.0, 0.0)
    while top > 0:
        count, top = next_element_contacts(world.tree, laws, e, work.R_ij, t, work.search, top)
        if count > 0:
            press_by_laws(x, (i, np.int64(-1 - e)), count, world, laws, work)
        for k in range(count):
            volume = records[k, VOLUME]
            if volume > best or (volume == best and pairs[k, 0] < sphere):
                best, sphere = volume, np.int64(pairs[k, 0])
                f = -world.stiffness * volume
                force = rotate(R[i], f * records[k, NORMAL], f * records[k, NORMAL + 1], f * records[k, NORMAL + 2])
                point = rotate(R[i], records[k, POINT], records[k, POINT + 1], records[k, POINT + 2])
    if best == 0.0:
        return
    note_contact(memory, i, len(x) + e, when[0])
    torque = cross(point, force)
    for c in range(root.shape[1]):
        # the force is constant, and what moves the point along the normal leaves the torque alone
        _, turn, d_lever = _moved(root, row, c, R[i], point)
        kick_column(root, row, c, (0.0, 0.0, 0.0), (torque, cross(d_lever, force), turn), world, when[1], R, i)


@inner(forceinline=True)
def keep_dominant(search, count, dominant, place):
    """Keep the contact of largest volume, ties to the lowest sphere of body i, then of body j."""
    for k in range(count):
        i, j = search.pairs[k, 0], search.pairs[k, 1]
        volume, best = search.records[k, VOLUME], dominant.volume[place]
        if volume < best:
            continue
        if volume == best and (i, j) >= (dominant.spheres[place, 0], dominant.spheres[place, 1]):
            continue
        dominant.volume[place] = volume
        dominant.spheres[place, 0], dominant.spheres[place, 1] = i, j


@inner(forceinline=True)
def drift_root(x, root, place, R, world, laws, factors, rotation):
    """Multiply the root by the derivative of drift and damping; ``x`` and ``R`` are those before the drift.

    ``factors`` are the drift's time and decay, ``rotation`` (3, 3) is room for a block.
    """
    for i in range(len(x)):
        if place[i] >= 0:
            write_exact_rotation(R, x, i, factors[0], rotation)
            if laws is not None:
                if laws.gyroscopic:
                    turn_columns(root, ERROR * place[i], x, i, R, world, laws, factors[0])
            apply_transition(root, ERROR * place[i], factors[0], factors[1], rotation)


@inner
def _row(moving, body):
    """First row of a body in the joint error state; -1 for a fixed body."""
    if not moving[body]:
        return -1
    row = 0
    for k in range(body):
        row += ERROR * moving[k]
    return row


@inner
def contact_geometry(x, R, tree, dominant, k):
    """The sphere pair of dominant contact ``k`` in the world frame.

    Returns
    -------
    arm_i, arm_j : tuples of 3 floats
        Sphere centres from their bodies' centres of mass [m].
    D : tuple of 3 floats
        From sphere i's centre to sphere j's [m].
    r_i, r_j : float
    """
    i, j = dominant.bodies[k]
    a, b = dominant.spheres[k]
    arm_i = rotate(R[i], tree.centers[a, 0], tree.centers[a, 1], tree.centers[a, 2])
    arm_j = rotate(R[j], tree.centers[b, 0], tree.centers[b, 1], tree.centers[b, 2])
    D = (
        x[j, P] + arm_j[0] - x[i, P] - arm_i[0],
        x[j, P + 1] + arm_j[1] - x[i, P + 1] - arm_i[1],
        x[j, P + 2] + arm_j[2] - x[i, P + 2] - arm_i[2],
    )
    return arm_i, arm_j, D, tree.radii[a], tree.radii[b]


@inner
def _lever(d, ri, rj):
    """Contact point on the line of centres from sphere i's centre, and its derivative by the distance."""
    low, high = max(d - rj, -ri), min(ri, d + rj)
    return 0.5 * (low + high), 0.5 * ((d - rj > -ri) + (d + rj < ri))


@inner(error_model="numpy")
def contact_root(x, root, world, dt, R, dominant, k):
    """Add to the root what the kick of dominant contact ``k`` adds, to first order in each column's error.

    With s = r_i + r_j and the volume V held, the force on body j is f = kappa V D / (d + s) (Eq. 10), at the
    point c = c_i + lever(d) D / d.
    """
    i, j = dominant.bodies[k]
    row_i, row_j = _row(world.bodies.moving, i), _row(world.bodies.moving, j)
    arm_i, arm_j, D, ri, rj = contact_geometry(x, R, world.tree, dominant, k)
    d = math.sqrt(D[0] * D[0] + D[1] * D[1] + D[2] * D[2])
    n = (D[0] / d, D[1] / d, D[2] / d)
    scale = world.stiffness * dominant.volume[k] / (d + ri + rj)
    f = (scale * D[0], scale * D[1], scale * D[2])
    lever, slope = _lever(d, ri, rj)
    point = (lever * n[0], lever * n[1], lever * n[2])
    lever_i = (arm_i[0] + point[0], arm_i[1] + point[1], arm_i[2] + point[2])
    lever_j = (arm_j[0] + point[0] - D[0], arm_j[1] + point[1] - D[1], arm_j[2] + point[2] - D[2])
    torque_i, torque_j = cross(f, lever_i), cross(lever_j, f)
    for c in range(root.shape[1]):
        dp_i, turn_i, d_arm_i = _moved(root, row_i, c, R[i], arm_i)
        dp_j, turn_j, d_arm_j = _moved(root, row_j, c, R[j], arm_j)
        dD = (
            dp_j[0] + d_arm_j[0] - dp_i[0] - d_arm_i[0],
            dp_j[1] + d_arm_j[1] - dp_i[1] - d_arm_i[1],
            dp_j[2] + d_arm_j[2] - dp_i[2] - d_arm_i[2],
        )
        stretch = n[0] * dD[0] + n[1] * dD[1] + n[2] * dD[2]
        shrink = stretch / (d + ri + rj)
        df = (scale * (dD[0] - shrink * D[0]), scale * (dD[1] - shrink * D[1]), scale * (dD[2] - shrink * D[2]))
        along = slope * stretch - lever * stretch / d
        d_point = (
            lever / d * dD[0] + along * n[0],
            lever / d * dD[1] + along * n[1],
            lever / d * dD[2] + along * n[2],
        )
        if row_i >= 0:
            d_lever = (d_arm_i[0] + d_point[0], d_arm_i[1] + d_point[1], d_arm_i[2] + d_point[2])
            a, b = cross(df, lever_i), cross(f, d_lever)
            dtau = (a[0] + b[0], a[1] + b[1], a[2] + b[2])
            kick_column(root, row_i, c, (-df[0], -df[1], -df[2]), (torque_i, dtau, turn_i), world, dt, R, i)
        if row_j >= 0:
            d_lever = (
                d_arm_j[0] + d_point[0] - dD[0], d_arm_j[1] + d_point[1] - dD[1], d_arm_j[2] + d_point[2] - dD[2],
            )
            a, b = cross(d_lever, f), cross(lever_j, df)
            dtau = (a[0] + b[0], a[1] + b[1], a[2] + b[2])
            kick_column(root, row_j, c, df, (torque_j, dtau, turn_j), world, dt, R, j)


@inner
def _moved(root, row, c, R, arm):
    """How column ``c`` moves a body: its displacement, its rotation in world axes, and the change of ``arm``."""
    if row < 0:
        zero = (0.0, 0.0, 0.0)
        return zero, zero, zero
    dp = (root[row + EP, c], root[row + EP + 1, c], root[row + EP + 2, c])
    turn = rotate(R, root[row + ER, c], root[row + ER + 1, c], root[row + ER + 2, c])
    return dp, turn, cross(turn, arm)


@inner
def kick_column(root, row, c, df, torques, world, dt, R, body):
    """Add the change of one body's velocities by a changed force and torque, and by a turned inertia.

    ``torques`` holds the nominal torque, its change, and the body's rotation, all in world axes: with
    ``w = I_world^-1 tau`` and a rotation ``t``, ``dw = t x w + I_world^-1 (dtau - t x tau)``.
    """
    tau, dtau, turn = torques
    a = dt * world.bodies.inverse_mass[body]
    for k in range(3):
        root[row + EV + k, c] += a * df[k]
    w = _inverse_inertia(world, R[body], body, tau)
    twist = cross(turn, tau)
    dw = _inverse_inertia(world, R[body], body, (dtau[0] - twist[0], dtau[1] - twist[1], dtau[2] - twist[2]))
    turned = cross(turn, w)
    for k in range(3):
        root[row + EW + k, c] += dt * (turned[k] + dw[k])


@inner
def _inverse_inertia(world, R, body, tau):
    """``I_world^-1 tau``."""
    x, y, z = rotate_back(R, tau[0], tau[1], tau[2])
    x, y, z = rotate(world.bodies.inverse_inertia[body], x, y, z)
    return rotate(R, x, y, z)


@inner
def regularized_step(x, world, laws, work, dominant, touching):
    """The step that ``F_t`` differentiates: the dominant contacts act, with held volume and Eq. 10's normal."""
    drift(x, world, laws, Piece(world.dt, world.decay, world.dt, 0.0, 0.0, 0.0), work)
    for k in range(touching):
        i, j = dominant.bodies[k]
        arm_i, arm_j, D, ri, rj = contact_geometry(x, work.R, world.tree, dominant, k)
        d = math.sqrt(D[0] * D[0] + D[1] * D[1] + D[2] * D[2])
        scale = world.stiffness * dominant.volume[k] / (d + ri + rj)
        share = _lever(d, ri, rj)[0] / d
        f = (scale * D[0], scale * D[1], scale * D[2])
        tau_i = cross(f, (arm_i[0] + share * D[0], arm_i[1] + share * D[1], arm_i[2] + share * D[2]))
        share -= 1.0
        tau_j = cross((arm_j[0] + share * D[0], arm_j[1] + share * D[1], arm_j[2] + share * D[2]), f)
        for c in range(3):
            work.wrench[i, c] -= f[c]
            work.wrench[i, 3 + c] += tau_i[c]
            work.wrench[j, c] += f[c]
            work.wrench[j, 3 + c] += tau_j[c]
        work.touched[i] = work.touched[j] = True
    kick_each(x, world, world.dt, work)


@kernel
def _difference(x, root, world, laws, dominant, touching):
    """Replace each column of the root by the central difference of the regularized step along it."""
    count = len(x)
    forth, back = np.empty((count, STATE)), np.empty((count, STATE))
    error = np.empty(ERROR)
    for c in range(root.shape[1]):
        length = 0.0
        for row in range(len(root)):
            length += root[row, c] * root[row, c]
        if length == 0.0:
            continue
        h = _STEP / math.sqrt(length)
        for side, state in ((h, forth), (-h, back)):
            _perturb(x, root, c, side, world.bodies.moving, state)
            regularized_step(state, world, laws, workspace(state, world, laws), dominant, touching)
        place = 0
        for i in range(count):
            if world.bodies.moving[i]:
                boxminus(forth[i], back[i], error)
                for k in range(ERROR):
                    root[place + k, c] = error[k] / (2.0 * h)
                place += ERROR


@kernel
def _perturb(x, root, c, h, moving, out):
    """``x`` boxplus ``h`` times column ``c`` of the root, into ``out``."""
    error = np.empty(ERROR)
    place = 0
    for i in range(len(x)):
        if moving[i]:
            for k in range(ERROR):
                error[k] = h * root[place + k, c]
            boxplus(x[i], error, out[i])
            place += ERROR
        else:
            for k in range(STATE):
                out[i, k] = x[i, k]


@kernel
def _outer(root):
    """``root @ root.T``, exactly symmetric."""
    size = len(root)
    P = np.empty((size, size))
    for a in range(size):
        for b in range(a + 1):
            total = 0.0
            for c in range(root.shape[1]):
                total += root[a, c] * root[b, c]
            P[a, b] = P[b, a] = total
    return P
