"""What uncertain contacts add to velocities on the step over exact shapes.

Normals tilt (the surrogate), or a pair's contacts are copied at perturbed poses (local sampling). The normal
impulse takes the place of the paper's ``dt kappa V``: Eqs. 16 to 24, and 31 to 35.
"""

import math
from typing import NamedTuple

import numpy as np

from ..compiler import inner
from ..spatial.layout import EP, ER, ERROR, EV, EW
from ..spatial.random import RUN, combine, places
from ..spatial.rotation import cross, exp, rotate, rotate_by_quaternion, tangents
from ..spatial.vectors import dot, minus, plus, times
from .contact_steps import begin_step, kick_pair, meeting
from .local_clouds import add_moments, write_cholesky

#: Of ``k_sigma``. Its default, fitted to forces that act for many steps, becomes 3, with which Eq. 21 is the
#: spread by one tilted impulse, to first order.
_OF_ONE_IMPULSE = 10.0
_POINTS = 2  # contacts of a pair; with more it touches on an area, which goes with neither body
_ENTRIES = np.array([[0, 3, 4], [3, 1, 5], [4, 5, 2]])  # of `add_moments` in a symmetric matrix


class TiltedNormals(NamedTuple):
    """The surrogate: increments of roots by tilted normals."""

    k_sigma: float


class PerturbedContacts(NamedTuple):
    """Local sampling: increments of covariances by perturbed copies of a pair's contacts."""

    table: np.ndarray  # normal numbers (`spatial.random.normal_table`)
    samples: int
    seed: int
    key: np.ndarray  # (1,) uint64: of the present step
    #: spread, change: (3, 6) and (samples, 9): room for moments, and for each sample's force and torques
    spread: np.ndarray
    change: np.ndarray


@inner
def _pose_covariance(i, blocks, position, rotation, own):
    """Add a body's covariances of position, and write that of its rotation, in world axes.

    ``own`` (3, 3) is room for that in body axes.
    """
    rotation[:] = 0.0
    if blocks.of[i] < 0:
        return
    S, R = blocks.all[blocks.of[i]], blocks.R[i]
    for a in range(3):
        for b in range(3):
            if blocks.turns == 2:
                position[a, b] += S[EP + a, EP + b]
                own[a, b] = S[ER + a, ER + b]
            else:
                own[a, b] = 0.0
                for c in range(ERROR):
                    position[a, b] += S[EP + a, c] * S[EP + b, c]
                    own[a, b] += S[ER + a, c] * S[ER + b, c]
    for a in range(3):
        for b in range(3):
            for c in range(3):
                for d in range(3):
                    rotation[a, b] += R[a, c] * own[c, d] * R[b, d]


@inner
def _form(A, u, w):
    """Return ``u^T A w``."""
    return dot(u, rotate(A, w[0], w[1], w[2]))


@inner(error_model="numpy")
def _sine(variance, d, k_sigma):
    """Return the sine of Eq. 20's angle ``atan(k_sigma sqrt(variance) / d)``."""
    reach = k_sigma * math.sqrt(max(variance, 0.0))
    return reach / math.sqrt(d * d + reach * reach) if reach > 0.0 else 0.0


@inner
def _add_bounded(A, B, arm_b, C, arm_c, axes, d, scale, k_sigma, ways, out):
    """Add ``scale`` times the sines of Eq. 20 of a displacement beside d, along its principal directions.

    A is its covariance, to which rotations with covariances B and C add what they make of arms. It counts
    along the two ``axes``, whose sines count along ``ways`` in the result, a symmetric matrix as in Eq. 21.
    """
    u, w = axes
    uu, uw, ww = _form(A, u, u), _form(A, u, w), _form(A, w, w)
    for S, arm in ((B, arm_b), (C, arm_c)):
        p, q = cross(arm, u), cross(arm, w)
        uu, uw, ww = uu + _form(S, p, p), uw + _form(S, p, q), ww + _form(S, q, q)
    # a function of the 2 x 2 matrix: alpha I + beta Sigma_T takes its eigenvalues to the sigmas
    half, mean = math.sqrt(0.25 * (uu - ww) ** 2 + uw * uw), 0.5 * (uu + ww)
    high, low = scale * _sine(mean + half, d, k_sigma), scale * _sine(mean - half, d, k_sigma)
    beta = 0.5 * (high - low) / half if half > 0.0 else 0.0
    alpha = 0.5 * (high + low) - beta * mean
    uu, uw, ww = alpha + beta * uu, beta * uw, alpha + beta * ww
    u, w = ways
    for r in range(3):
        for c in range(3):
            out[r, c] += uu * u[r] * u[c] + uw * (u[r] * w[c] + w[r] * u[c]) + ww * w[r] * w[c]


@kick_pair.of(TiltedNormals)
def _tilt(method, a, b, first, last, states, contact, world, blocks):
    """Add Eqs. 21 to 23 of a pair's contacts, and the same of their levers, to the roots of both bodies."""
    k_sigma, still, small = _OF_ONE_IMPULSE * method.k_sigma, (0.0, 0.0, 0.0), blocks.small
    none, position, turn_a, turn_b, V, T = small[0], small[1], small[2], small[3], small[4], small[5]
    none[:], position[:] = 0.0, 0.0
    _pose_covariance(a, blocks, position, turn_a, V)
    _pose_covariance(b, blocks, position, turn_b, V)
    area = _touches_area(a, b, first, last, states, contact, world, blocks)
    slip = none if area else position
    for k in range(first, last):
        m = meeting(k, a, b, states, contact, world, blocks)
        if m.acting <= 0.0:
            continue
        n, impulse = m.normal, m.acting / 3.0
        u, w = tangents(n)
        axes, across = (u, w), (w, times(-1.0, u))
        p, q = minus(m.arm_a, times(m.round_a, n)), plus(m.arm_b, times(m.round_b, n))
        V[:] = 0.0
        if m.face > 0:  # with that body the normal turns
            own = turn_a if m.face == 1 else turn_b
            _add_bounded(none, own, n, none, still, axes, 1.0, impulse, k_sigma, axes, V)
        else:
            d = m.round_a + m.round_b
            _add_bounded(position, turn_a, p, turn_b, q, axes, d, impulse, k_sigma, axes, V)
        for i, arm, far, turn in ((a, m.arm_a, p, turn_a), (b, m.arm_b, q, turn_b)):
            if blocks.of[i] < 0:
                continue
            more = none
            if m.face > 0 and i == (a if m.face == 1 else b):  # the other body's point slides over its face
                more, turn, far = slip, (turn_b if i == a else turn_a), (q if i == a else p)
            size = math.sqrt(dot(arm, arm))
            T[:] = 0.0
            _add_bounded(more, turn, far, none, still, axes, size, impulse * size, k_sigma, across, T)
            S = blocks.all[blocks.of[i]]
            for c in range(3):
                t = cross(arm, (V[0, c], V[1, c], V[2, c]))
                t = plus(times(1.0 / 3.0, t), (T[0, c], T[1, c], T[2, c]))
                t = rotate(blocks.inverse[i], t[0], t[1], t[2])
                for r in range(3):
                    S[EV + r, EV + c] += world.bodies.inverse_mass[i] * V[r, c]
                    S[EW + r, EW + c] += t[r]


@begin_step.of(PerturbedContacts)
def _new_key(method, step):
    """Take the step's key."""
    method.key[0] = combine(combine(np.uint64(0), method.seed), step)


@inner
def _force(m, n):
    """Return the force along a normal n with its friction, by the force along the normal."""
    slip = minus(m.slip, times(dot(m.slip, n), n))
    friction = times(m.rub, slip)
    size = math.sqrt(dot(friction, friction))
    return plus(n, times(m.most / size if size > m.most else 1.0, friction))


@inner
def _touches_area(a, b, first, last, states, contact, world, blocks):
    """Return whether more of a pair's contacts act than two points."""
    count = 0
    for k in range(first, last):
        count += meeting(k, a, b, states, contact, world, blocks).acting > 0.0
    return count > _POINTS


@kick_pair.of(PerturbedContacts)
def _sample(method, a, b, first, last, states, contact, world, blocks):
    """Add Eqs. 34 and 35 of a pair's contacts to both covariances: one draw of both poses for all of them."""
    small, spread, change, found = blocks.small, method.spread, method.change, 0
    position, turn_a, turn_b, L, A, B = small[0], small[1], small[2], small[3], small[4], small[5]
    position[:], spread[:], change[:] = 0.0, 0.0, 0.0
    _pose_covariance(a, blocks, position, turn_a, L)
    _pose_covariance(b, blocks, position, turn_b, L)
    write_cholesky(position, 0, L)
    write_cholesky(turn_a, 0, A)
    write_cholesky(turn_b, 0, B)
    area = _touches_area(a, b, first, last, states, contact, world, blocks)
    key, table = combine(combine(method.key[0], a), b), method.table
    for k in range(first, last):
        m = meeting(k, a, b, states, contact, world, blocks)
        if m.acting <= 0.0:
            continue
        found += 1
        n, d = m.normal, m.round_a + m.round_b
        p, q = minus(m.arm_a, times(m.round_a, n)), plus(m.arm_b, times(m.round_b, n))
        force = _force(m, n)
        for run in range(0, method.samples, RUN):
            o = places(combine(key, run))
            for s in range(min(RUN, method.samples - run)):
                j = np.uint64(s)
                x = rotate(L, float(table[o[0] + j]), float(table[o[1] + j]), float(table[o[2] + j]))
                y = rotate(A, float(table[o[3] + j]), float(table[o[4] + j]), float(table[o[5] + j]))
                z = rotate(B, float(table[o[6] + j]), float(table[o[7] + j]), float(table[o[8] + j]))
                y, z = exp(y[0], y[1], y[2]), exp(z[0], z[1], z[2])
                if m.face > 0:
                    e = rotate_by_quaternion(y if m.face == 1 else z, n)
                else:
                    e = plus(minus(rotate_by_quaternion(z, q), q), minus(p, rotate_by_quaternion(y, p)))
                    e = plus(plus(e, x), times(d, n))
                    size = math.sqrt(dot(e, e))
                    e = times(1.0 / size, e) if size > 0.0 else n
                g, h = rotate_by_quaternion(y, p), rotate_by_quaternion(z, q)
                if m.face == 1:  # the other body's point slides over its face
                    g = p if area else plus(p, plus(x, minus(h, q)))
                elif m.face == 2:
                    h = q if area else plus(q, minus(minus(g, p), x))
                g, h = plus(g, times(m.round_a, e)), minus(h, times(m.round_b, e))
                e = _force(m, e)
                f, t = minus(e, force), minus(cross(g, e), cross(m.arm_a, force))
                r = minus(cross(h, e), cross(m.arm_b, force))
                for c in range(3):
                    change[run + s, c] += m.acting * f[c]
                    change[run + s, 3 + c] += m.acting * t[c]
                    change[run + s, 6 + c] += m.acting * r[c]
    if found == 0:
        return
    for s in range(method.samples):
        for c in range(3):
            one = change[s, 3 * c], change[s, 3 * c + 1], change[s, 3 * c + 2]
            add_moments(spread[c], 1.0 / method.samples, one)
    for side, i in ((1, a), (2, b)):
        if blocks.of[i] >= 0:
            P, I = blocks.all[blocks.of[i]], blocks.inverse[i]
            for r in range(3):
                for c in range(3):
                    P[EV + r, EV + c] += world.bodies.inverse_mass[i] ** 2 * spread[0, _ENTRIES[r, c]]
                    for x in range(3):
                        for y in range(3):
                            P[EW + r, EW + c] += I[r, x] * spread[side, _ENTRIES[x, y]] * I[c, y]
