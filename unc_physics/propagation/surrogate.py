"""Square-root surrogate: contacts tilt the normal, the tilt feeds the roots of the velocities' covariances (section 4.2)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit

from ..belief import Belief
from ..errors import InvalidOptionError
from ..kernels.contact import DISTANCE, NORMAL, VOLUME, next_contacts
from ..kernels.so3 import cross, rotate, rotate_back
from ..kernels.step import add_wrench, drift, kick, near_pairs, open_pair, part, workspace
from ..kernels.transition import apply_transition, write_printed_rotation
from ..layout import EP, ER, ERROR, EV, EW
from ..validation import positive
from .base import Propagator, Traits, symmetric_root


class SurrogateCarry(NamedTuple):
    """Persistent state: the nominal ``mean`` (B, 13) and each moving body's root ``roots`` (M, 12, 12) of its covariance."""

    mean: np.ndarray
    roots: np.ndarray


@dataclass(frozen=True)
class Surrogate(Propagator):
    """Square-root surrogate model, one body at a time (Eqs. 11 to 24).

    Attributes
    ----------
    k_sigma : float
        How many standard deviations of the contact's position tilt its normal (Eq. 20).

    Notes
    -----
    The mean is a rollout with the full physics. The contact points of Eqs. 16 to 20 and 23 are the spheres'
    centres; all contacts of a step see the covariance after the drift.
    """

    name = "surrogate"
    traits = Traits("nominal", "square-root, per body", False, True, "surrogate")

    k_sigma: float = 3.0

    def __post_init__(self):
        object.__setattr__(self, "k_sigma", positive(self.k_sigma, "k_sigma", InvalidOptionError))

    def init(self, scene, belief):
        return SurrogateCarry(belief.mean.copy(), symmetric_root(belief.blocks))

    def advance(self, carry, scene, steps):
        mean, roots = carry.mean.copy(), carry.roots.copy()
        _advance(mean, roots, scene.world, steps, self.k_sigma)
        return SurrogateCarry(mean, roots)

    def belief(self, carry, scene):
        P = np.einsum("kac,kbc->kab", carry.roots, carry.roots)
        return Belief.trusted(carry.mean.copy(), 0.5 * (P + P.transpose(0, 2, 1)), scene.moving)


class Spread(NamedTuple):
    """Uncertainty of the bodies' poses in one step, and what its contacts add.

    Attributes
    ----------
    position, rotation : (B, 3, 3) float64
        Covariance of position [m^2] and rotation [rad^2] in world axes; zero for a fixed body.
    known : (B,) bool
        Whether the two are computed for this step.
    tilt : (3, 3) float64
        Sum of Eq. 21's V over the contacts of the pair of bodies at hand, in units of the stiffness [m^3].
    torque : (2, 3, 3) float64
        Sums of [r]x V for its two bodies [m^4].
    """

    position: np.ndarray
    rotation: np.ndarray
    known: np.ndarray
    tilt: np.ndarray
    torque: np.ndarray


@njit(cache=True, nogil=True)
def _advance(mean, roots, world, steps, k_sigma):
    """Advance the nominal state and the roots in place."""
    work = workspace(mean, world)
    count = len(mean)
    place = np.cumsum(world.bodies.moving) - 1  # of each moving body among the roots
    spread = Spread(
        np.zeros((count, 3, 3)), np.zeros((count, 3, 3)), np.zeros(count, np.bool_), np.empty((3, 3)), np.empty((2, 3, 3))
    )
    rows, rotation = roots.reshape(-1, ERROR), np.empty((3, 3))
    moving, R, dt, decay = world.bodies.moving, work.R, world.dt, world.decay
    for _ in range(steps):
        for i in range(count):
            if moving[i]:
                write_printed_rotation(R, i, dt, rotation)
                apply_transition(rows, ERROR * place[i], dt, decay, rotation)
        drift(mean, world, work)
        spread.known[:] = False
        for k in range(near_pairs(mean, world, work)):
            i, j = work.near[k, 0], work.near[k, 1]
            t_ij, slack, top = open_pair(mean, i, j, world, work)
            spread.tilt[:] = 0.0
            spread.torque[:] = 0.0
            touching = False
            while top > 0:
                found, top = next_contacts(world.tree, work.R_ij, t_ij, slack, work.search, top)
                if found > 0:
                    touching = True
                    add_wrench(mean, i, j, found, world.stiffness, work)
                    for body in (i, j):
                        if moving[body] and not spread.known[body]:
                            know_spread(roots[place[body]], R[body], body, spread)
                    add_tilts((i, j), found, k_sigma, world.tree, work, spread)
            if not touching:
                part(i, j, t_ij, slack, world, work)
                continue
            for side, body in ((0, i), (1, j)):
                if moving[body]:
                    kick_root(roots[place[body]], world, R[body], body, spread, side)
        kick(mean, world, work)


@njit(cache=True, nogil=True)
def know_spread(S, R, body, spread):
    """Covariance blocks of position and rotation from the root ``S`` (12, 12), the latter turned to world axes."""
    spread.known[body] = True
    local = np.empty((3, 3))
    for a in range(3):
        for b in range(a + 1):
            p = t = 0.0
            for c in range(ERROR):
                p += S[EP + a, c] * S[EP + b, c]
                t += S[ER + a, c] * S[ER + b, c]
            spread.position[body, a, b] = spread.position[body, b, a] = p
            local[a, b] = local[b, a] = t
    half = np.empty((3, 3))
    for b in range(3):
        half[0, b], half[1, b], half[2, b] = rotate(R, local[0, b], local[1, b], local[2, b])
    for a in range(3):
        spread.rotation[body, a, 0], spread.rotation[body, a, 1], spread.rotation[body, a, 2] = rotate(
            R, half[a, 0], half[a, 1], half[a, 2]
        )


@njit(cache=True, nogil=True)
def _form(A, u, w):
    """``u^T A w`` of a 3 x 3 matrix."""
    x, y, z = rotate(A, w[0], w[1], w[2])
    return u[0] * x + u[1] * y + u[2] * z


@njit(cache=True, nogil=True, error_model="numpy")
def tangent_basis(n):
    """Two unit vectors that complete the unit vector ``n`` to a right-handed orthonormal basis."""
    s = 1.0 if n[2] >= 0.0 else -1.0
    a = -1.0 / (s + n[2])
    b = n[0] * n[1] * a
    return (1.0 + s * n[0] * n[0] * a, s * b, -s * n[0]), (b, s + n[1] * n[1] * a, -n[1])


@njit(cache=True, nogil=True, error_model="numpy")
def _sine_of_tilt(variance, d, k_sigma):
    """Sine of Eq. 20's angle ``atan(k_sigma sqrt(variance) / d)``."""
    reach = k_sigma * math.sqrt(max(variance, 0.0))
    return reach / math.sqrt(d * d + reach * reach)


@njit(cache=True, nogil=True, error_model="numpy")
def add_tilts(bodies, found, k_sigma, tree, work, spread):
    """Add Eq. 21's increments, and their moments, of the first ``found`` contacts on record (Eqs. 16 to 23)."""
    i, j = bodies
    R_i, R_j = work.R[i], work.R[j]
    pairs, records = work.search.pairs, work.search.records
    tilt, torque_i, torque_j = spread.tilt, spread.torque[0], spread.torque[1]
    position_i, position_j = spread.position[i], spread.position[j]
    rotation_i, rotation_j = spread.rotation[i], spread.rotation[j]
    for k in range(found):
        a, b = pairs[k, 0], pairs[k, 1]
        n = rotate(R_i, records[k, NORMAL], records[k, NORMAL + 1], records[k, NORMAL + 2])
        arm_i = rotate(R_i, tree.centers[a, 0], tree.centers[a, 1], tree.centers[a, 2])
        arm_j = rotate(R_j, tree.centers[b, 0], tree.centers[b, 1], tree.centers[b, 2])
        u, w = tangent_basis(n)
        # J Sigma J^T with J = -R [r]x is [arm]x (R Sigma R^T) [arm]x^T in world axes
        ui, wi, uj, wj = cross(u, arm_i), cross(w, arm_i), cross(u, arm_j), cross(w, arm_j)
        uu = _form(position_i, u, u) + _form(rotation_i, ui, ui)
        uw = _form(position_i, u, w) + _form(rotation_i, ui, wi)
        ww = _form(position_i, w, w) + _form(rotation_i, wi, wi)
        uu += _form(position_j, u, u) + _form(rotation_j, uj, uj)
        uw += _form(position_j, u, w) + _form(rotation_j, uj, wj)
        ww += _form(position_j, w, w) + _form(rotation_j, wj, wj)
        # Eq. 21 is a function of the 2 x 2 matrix: alpha I + beta Sigma_T takes its eigenvalues to the sigmas
        half, mean = math.sqrt(0.25 * (uu - ww) ** 2 + uw * uw), 0.5 * (uu + ww)
        d, scale = records[k, DISTANCE], records[k, VOLUME] / 3.0
        high = scale * _sine_of_tilt(mean + half, d, k_sigma)
        low = scale * _sine_of_tilt(mean - half, d, k_sigma)
        beta = 0.5 * (high - low) / half if half > 0.0 else 0.0
        alpha = 0.5 * (high + low) - beta * mean
        uu, uw, ww = alpha + beta * uu, beta * uw, alpha + beta * ww
        for c in range(3):
            column = (
                (uu * u[c] + uw * w[c]) * u[0] + (uw * u[c] + ww * w[c]) * w[0],
                (uu * u[c] + uw * w[c]) * u[1] + (uw * u[c] + ww * w[c]) * w[1],
                (uu * u[c] + uw * w[c]) * u[2] + (uw * u[c] + ww * w[c]) * w[2],
            )
            moment_i, moment_j = cross(arm_i, column), cross(arm_j, column)
            for r in range(3):
                tilt[r, c] += column[r]
                torque_i[r, c] += moment_i[r]
                torque_j[r, c] += moment_j[r]


@njit(cache=True, nogil=True)
def kick_root(S, world, R, body, spread, side):
    """Add the pair's increments to the diagonal blocks of the velocities in the root (Eqs. 22 and 23)."""
    a = world.dt * world.stiffness * world.bodies.inverse_mass[body]
    b = world.dt * world.stiffness / 3.0
    for c in range(3):
        x, y, z = rotate_back(R, spread.torque[side, 0, c], spread.torque[side, 1, c], spread.torque[side, 2, c])
        x, y, z = rotate(world.bodies.inverse_inertia[body], x, y, z)
        x, y, z = rotate(R, x, y, z)
        S[EW, EW + c] += b * x
        S[EW + 1, EW + c] += b * y
        S[EW + 2, EW + c] += b * z
        for r in range(3):
            S[EV + r, EV + c] += a * spread.tilt[r, c]
