"""One time step of a scene: drift, damp, gravity, contacts, kick, in this order (the paper's Eqs. 3 to 6)."""

from typing import NamedTuple

import numpy as np
from numba import njit

from ..layout import P, Q, V, W
from .contact import pair_wrench
from .so3 import exp, multiply, normalized, rotate, rotate_back, write_matrix
from .tree import Scratch

_PAIRS_AT_ONCE = 1024
# of the sum of two bodies' radii: bounds, with a margin, what single precision loses in a change of frame
_SINGLE_PRECISION = 4e-6


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
    R_ij : (3, 3) float64
    search : Scratch
    """

    R: np.ndarray
    wrench: np.ndarray
    touched: np.ndarray
    R_ij: np.ndarray
    search: Scratch


@njit(cache=True, nogil=True)
def workspace(x, world):
    """Workspace of one rollout that begins at state ``x`` (B, 13)."""
    count = len(x)
    R = np.empty((count, 3, 3))
    for i in range(count):
        write_matrix((x[i, Q], x[i, Q + 1], x[i, Q + 2], x[i, Q + 3]), R[i])
    search = Scratch(np.empty((world.stack_size, 2), np.int32), np.empty((_PAIRS_AT_ONCE, 2), np.int32))
    return Workspace(R, np.zeros((count, 6)), np.zeros(count, np.bool_), np.empty((3, 3)), search)


@njit(cache=True, nogil=True)
def drift(x, world, R):
    """Move all bodies freely over one step, then damp their velocities and apply gravity; ``R`` follows."""
    dt, decay = world.dt, world.decay
    for i in range(len(x)):
        if not world.bodies.moving[i]:
            continue
        s = x[i]
        q = multiply(exp(dt * s[W], dt * s[W + 1], dt * s[W + 2]), (s[Q], s[Q + 1], s[Q + 2], s[Q + 3]))
        q = normalized(q)
        s[Q], s[Q + 1], s[Q + 2], s[Q + 3] = q
        write_matrix(q, R[i])
        for k in range(3):
            s[P + k] += dt * s[V + k]
            s[V + k] = decay * s[V + k] + dt * world.gravity[k]
            s[W + k] *= decay


@njit(cache=True, nogil=True)
def relative_pose(x, i, j, work):
    """Pose of body j in body i's frame: writes ``work.R_ij`` and returns the position [m]."""
    Ri, Rj = work.R[i], work.R[j]
    for a in range(3):
        for b in range(3):
            work.R_ij[a, b] = Ri[0, a] * Rj[0, b] + Ri[1, a] * Rj[1, b] + Ri[2, a] * Rj[2, b]
    return rotate_back(Ri, x[j, P] - x[i, P], x[j, P + 1] - x[i, P + 1], x[j, P + 2] - x[i, P + 2])


@njit(cache=True, nogil=True)
def near(x, i, j, bodies):
    """Whether bodies i and j may touch: at least one moves, and the balls around them overlap."""
    if not (bodies.moving[i] or bodies.moving[j]):
        return False
    dx, dy, dz = x[j, P] - x[i, P], x[j, P + 1] - x[i, P + 1], x[j, P + 2] - x[i, P + 2]
    reach = bodies.radius[i] + bodies.radius[j]
    return dx * dx + dy * dy + dz * dz < reach * reach


@njit(cache=True, nogil=True)
def add_contacts(x, i, j, world, work):
    """Add the contact forces between bodies i and j to the wrenches of both."""
    bodies = world.bodies
    t = relative_pose(x, i, j, work)
    slack = _SINGLE_PRECISION * (bodies.radius[i] + bodies.radius[j])
    force, moment = pair_wrench(world.tree, (bodies.root[i], bodies.root[j]), work.R_ij, t, slack, work.search)
    if force[0] == 0.0 and force[1] == 0.0 and force[2] == 0.0:
        return
    fx, fy, fz = rotate(work.R[i], force[0], force[1], force[2])
    mx, my, mz = rotate(work.R[i], moment[0], moment[1], moment[2])
    fx, fy, fz = world.stiffness * fx, world.stiffness * fy, world.stiffness * fz
    mx, my, mz = world.stiffness * mx, world.stiffness * my, world.stiffness * mz
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


@njit(cache=True, nogil=True)
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
        f[:] = 0.0


@njit(cache=True, nogil=True)
def advance(x, world, steps):
    """Advance the state ``x`` (B, 13) of one rollout in place."""
    work = workspace(x, world)
    count = len(x)
    for _ in range(steps):
        drift(x, world, work.R)
        for i in range(count):
            for j in range(i + 1, count):
                if near(x, i, j, world.bodies):
                    add_contacts(x, i, j, world, work)
        kick(x, world, work)
