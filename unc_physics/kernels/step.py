"""One time step of a scene: drift, damp, gravity, contacts, kick, in this order (the paper's Eqs. 3 to 6)."""

from typing import NamedTuple

import numpy as np
from numba import njit

from ..layout import P, Q, V, W
from .contact import RECORD, contact_sums, next_contacts
from .so3 import exp, multiply, renormalized, rotate, rotate_back, write_matrix
from .tree import WIDTH, Scratch, candidates

_PAIRS_AT_ONCE = 1024
# of the sum of two bodies' radii: bounds, with a margin, what single precision loses in a change of frame
_SINGLE_PRECISION = 4e-6
_ROOTS_ALONE = np.int64(1)  # height of a search's first stack; typed, since a literal would compile every caller twice
_FIRST_REST, _LONGEST_REST = 4.0, 64.0  # steps for which bodies that part are asked to be left alone


class Workspace(NamedTuple):
    """What a rollout computes anew in each step; no state.

    Attributes
    ----------
    R : (B, 3, 3) float64
        ``R_world_body`` at the current pose.
    wrench : (B, 6) float64
        Force [N] and torque about the centre of mass [N m], world frame.
    touched : (B,) bool
        Whether a contact force acts on the body in this step.
    order : (B,) int64
        Bodies sorted along x.
    low : (B,) float64
        Where each body's ball begins along x [m].
    near : (B (B - 1) / 2, 2) int64
        Pairs of bodies that may touch.
    speed : (B,) float64
        The most that a point of the body moves in a step [m].
    travel : (B,) float64
        Sum of ``speed`` since the rollout began [m].
    rest : (B, B, 2) float64
        For a pair i < j: up to which sum of their travels they can't touch [m], and the number of steps for which
        they are next asked to be apart.
    R_ij : (3, 3) float64
        Rotation from body j's to body i's coordinates, of the pair at hand.
    search, glance : Scratch
        The latter has so little room that a search ends at the first candidates.
    """

    R: np.ndarray
    wrench: np.ndarray
    touched: np.ndarray
    order: np.ndarray
    low: np.ndarray
    near: np.ndarray
    speed: np.ndarray
    travel: np.ndarray
    rest: np.ndarray
    R_ij: np.ndarray
    search: Scratch
    glance: Scratch


@njit(cache=True, nogil=True)
def workspace(x, world):
    """Workspace of one rollout that begins at state ``x`` (B, 13)."""
    count = len(x)
    R = np.empty((count, 3, 3))
    for i in range(count):
        write_matrix((x[i, Q], x[i, Q + 1], x[i, Q + 2], x[i, Q + 3]), R, i)
    stack = np.empty((world.stack_size, 2), np.int32)
    search = Scratch(stack, np.empty((_PAIRS_AT_ONCE, 2), np.int32), np.empty((_PAIRS_AT_ONCE, RECORD)))
    glance = Scratch(stack, np.empty((WIDTH * WIDTH, 2), np.int32), search.records)
    rest = np.zeros((count, count, 2))
    for i in range(count):
        for j in range(i + 1, count):
            rest[i, j, 1] = _FIRST_REST
    return Workspace(
        R,
        np.zeros((count, 6)),
        np.zeros(count, np.bool_),
        np.arange(count),
        np.empty(count),
        np.empty((count * (count - 1) // 2, 2), np.int64),
        np.zeros(count),
        np.zeros(count),
        rest,
        np.empty((3, 3)),
        search,
        glance,
    )


@njit(cache=True, nogil=True, forceinline=True)
def drift(x, world, work):
    """Move all bodies freely over one step, then damp their velocities and apply gravity; ``work.R`` follows."""
    R, speed, travel, radius = work.R, work.speed, work.travel, world.bodies.radius
    dt, decay, gravity, moving = world.dt, world.decay, world.gravity, world.bodies.moving
    for i in range(len(x)):
        if not moving[i]:
            continue
        q = multiply(exp(dt * x[i, W], dt * x[i, W + 1], dt * x[i, W + 2]), (x[i, Q], x[i, Q + 1], x[i, Q + 2], x[i, Q + 3]))
        q = renormalized(q)
        x[i, Q], x[i, Q + 1], x[i, Q + 2], x[i, Q + 3] = q
        write_matrix(q, R, i)
        speed[i] = dt * (
            abs(x[i, V]) + abs(x[i, V + 1]) + abs(x[i, V + 2])
            + radius[i] * (abs(x[i, W]) + abs(x[i, W + 1]) + abs(x[i, W + 2]))
        )
        travel[i] += speed[i]
        for k in range(3):
            x[i, P + k] += dt * x[i, V + k]
            x[i, V + k] = decay * x[i, V + k] + dt * gravity[k]
            x[i, W + k] *= decay


@njit(cache=True, nogil=True, forceinline=True)
def relative_pose(x, i, j, work):
    """Pose of body j in body i's frame: writes ``work.R_ij`` and returns the position [m]."""
    Ri, Rj = work.R[i], work.R[j]
    for a in range(3):
        for b in range(3):
            work.R_ij[a, b] = Ri[0, a] * Rj[0, b] + Ri[1, a] * Rj[1, b] + Ri[2, a] * Rj[2, b]
    return rotate_back(Ri, x[j, P] - x[i, P], x[j, P + 1] - x[i, P + 1], x[j, P + 2] - x[i, P + 2])


@njit(cache=True, nogil=True, forceinline=True)
def near_pairs(x, world, work):
    """Find the pairs of bodies that may touch: at least one moves, the balls around them overlap, none rests.

    Sweeps along x over the bodies, which `work.order` keeps sorted from step to step. Fills ``work.near`` with
    pairs (i, j), i < j, in an order that depends on the state alone, and returns their number.
    """
    radius, moving = world.bodies.radius, world.bodies.moving
    order, low = work.order, work.low
    for i in range(len(x)):
        low[i] = x[i, P] - radius[i]
    for k in range(1, len(x)):  # insertion sort: next to no work on what was sorted a step ago
        body, place = order[k], k
        while place > 0:
            before = order[place - 1]
            if low[before] < low[body] or (low[before] == low[body] and before < body):
                break
            order[place] = before
            place -= 1
        order[place] = body
    count = 0
    for k in range(len(x)):
        a = order[k]
        high = x[a, P] + radius[a]
        for m in range(k + 1, len(x)):
            b = order[m]
            if low[b] >= high:
                break
            dx, dy, dz = x[b, P] - x[a, P], x[b, P + 1] - x[a, P + 1], x[b, P + 2] - x[a, P + 2]
            reach = radius[a] + radius[b]
            if dx * dx + dy * dy + dz * dz < reach * reach and (moving[a] or moving[b]):
                i, j = min(a, b), max(a, b)
                if work.travel[i] + work.travel[j] >= work.rest[i, j, 0]:
                    work.near[count, 0], work.near[count, 1] = i, j
                    count += 1
    return count


@njit(cache=True, nogil=True, forceinline=True)
def open_pair(x, i, j, world, work):
    """Begin the search for the contacts of bodies i and j.

    Returns
    -------
    t_ij : tuple of 3 floats
        Body j's centre of mass in body i's frame [m]; ``work.R_ij`` has the rotation.
    slack : float
    top : int
        What `contact.next_contacts` takes.
    """
    t_ij = relative_pose(x, i, j, work)
    work.search.stack[0, 0], work.search.stack[0, 1] = world.bodies.root[i], world.bodies.root[j]
    return t_ij, _SINGLE_PRECISION * (world.bodies.radius[i] + world.bodies.radius[j]), _ROOTS_ALONE


@njit(cache=True, nogil=True)
def part(i, j, t_ij, slack, world, work):
    """Let two bodies that do not touch rest: no search until they may have crossed the gap between them.

    Asks the trees whether the bodies stay apart when each sphere grows by what they may travel in some steps; the
    number of steps adapts. This only leaves out searches that would find nothing, so no result depends on it.
    """
    steps, pace = work.rest[i, j, 1], work.speed[i] + work.speed[j]
    glance = work.glance
    glance.stack[0, 0], glance.stack[0, 1] = world.bodies.root[i], world.bodies.root[j]
    found, _ = candidates(world.tree, work.R_ij, t_ij, slack + steps * pace, glance, _ROOTS_ALONE)
    if found == 0:
        work.rest[i, j, 0] = work.travel[i] + work.travel[j] + steps * pace
        work.rest[i, j, 1] = min(2.0 * steps, _LONGEST_REST)
    else:
        work.rest[i, j, 1] = max(0.5 * steps, 1.0)


@njit(cache=True, nogil=True, forceinline=True)
def add_wrench(x, i, j, count, stiffness, work):
    """Add the forces of the first ``count`` contacts on record to the wrenches of bodies i and j."""
    force, moment = contact_sums(work.search.records, count)
    fx, fy, fz = rotate(work.R[i], force[0], force[1], force[2])
    mx, my, mz = rotate(work.R[i], moment[0], moment[1], moment[2])
    fx, fy, fz = stiffness * fx, stiffness * fy, stiffness * fz
    mx, my, mz = stiffness * mx, stiffness * my, stiffness * mz
    dx, dy, dz = x[j, P] - x[i, P], x[j, P + 1] - x[i, P + 1], x[j, P + 2] - x[i, P + 2]
    on_i, on_j = work.wrench[i], work.wrench[j]
    on_i[0] -= fx
    on_i[1] -= fy
    on_i[2] -= fz
    on_i[3] -= mx
    on_i[4] -= my
    on_i[5] -= mz
    on_j[0] += fx
    on_j[1] += fy
    on_j[2] += fz
    on_j[3] += mx - (dy * fz - dz * fy)  # the same forces, with the lever arm from body j's centre of mass
    on_j[4] += my - (dz * fx - dx * fz)
    on_j[5] += mz - (dx * fy - dy * fx)
    work.touched[i] = work.touched[j] = True


@njit(cache=True, nogil=True, forceinline=True)
def kick(x, world, work):
    """Change the velocities of all touched bodies by their wrench over one step; clears the wrenches."""
    for i in range(len(x)):
        if not work.touched[i]:
            continue
        work.touched[i] = False
        f = work.wrench[i]
        if world.bodies.moving[i]:
            a = world.dt * world.bodies.inverse_mass[i]
            x[i, V] += a * f[0]
            x[i, V + 1] += a * f[1]
            x[i, V + 2] += a * f[2]
            bx, by, bz = rotate_back(work.R[i], f[3], f[4], f[5])
            bx, by, bz = rotate(world.bodies.inverse_inertia[i], bx, by, bz)
            wx, wy, wz = rotate(work.R[i], bx, by, bz)
            x[i, W] += world.dt * wx
            x[i, W + 1] += world.dt * wy
            x[i, W + 2] += world.dt * wz
        for k in range(6):
            f[k] = 0.0


@njit(cache=True, nogil=True)
def advance(x, world, steps):
    """Advance the state ``x`` (B, 13) of one rollout in place."""
    work = workspace(x, world)
    for _ in range(steps):
        drift(x, world, work)
        for k in range(near_pairs(x, world, work)):
            i, j = work.near[k, 0], work.near[k, 1]
            t_ij, slack, top = open_pair(x, i, j, world, work)
            touching = False
            while top > 0:
                count, top = next_contacts(world.tree, work.R_ij, t_ij, slack, work.search, top)
                if count > 0:
                    touching = True
                    add_wrench(x, i, j, count, world.stiffness, work)
            if not touching:
                part(i, j, t_ij, slack, world, work)
        kick(x, world, work)
