"""Impacts: Newton's restitution and Coulomb's friction over the contacts of a pair, pair by pair."""

import math

from ...compiler import inner
from ...spatial.random import combine, two_normals
from ...spatial.rotation import cross
from ...spatial.vectors import dot, minus, plus, three, times
from .columns import (
    ARM_A,
    ARM_B,
    BODY_A,
    BODY_B,
    BOUNCE,
    DIRECTION_ERROR,
    GAP,
    IMASS,
    IMPACT_SWEEPS,
    IMPACT_VISITS,
    IMPACTS,
    IMPACTS_MOST,
    LN,
    MODE,
    MOMENT,
    MU,
    MU0,
    MU_ERROR,
    NEAR,
    NORMAL,
    PART,
    POINT_ERROR,
    REBOUND,
    SAVED,
    SLIPPERINESS,
    SLOW,
    SPIN,
    STEP_NUMBER,
    STRUCK,
    SURFACE_A,
    SURFACE_B,
    SURFACE_U,
    TOLERANCE,
    VEL,
    E,
)
from .contacts import masses, note, spread
from .motion import momentum, write
from .solve import HOLDS, PARTS, WAITS, closing, parting, solve

_EXACT = 0.3 * TOLERANCE  # no later step takes out what an impact leaves: a carton with e = 1 turns
_PARTS_OF_A_STEP = 64  # at most, between which rollouts release bodies


@inner
def bouncing(C, k):
    """Return the closing speed from which a contact rebounds: the more elastic, the slower."""
    return BOUNCE * max(1.0 - C[k, E], 0.01)


@inner
def landing(C, k):
    """Return the closing speed from which a contact has an impact."""
    return min(SLOW, bouncing(C, k))


@inner
def _rotated(v, d):
    """Return a vector rotated by a rotation vector."""
    angle = math.sqrt(dot(d, d))
    if angle == 0.0:
        return v
    e = times(1.0 / angle, d)
    c = math.cos(angle)
    along = plus(times(c, v), times((1.0 - c) * dot(e, v), e))
    return plus(along, times(math.sin(angle), cross(e, v)))


@inner(noinline=True)
def _disturb(first, last, C, Y, par, key):
    """Turn the directions of a pair's impact, shift its points and scale its friction by random errors.

    They depend on rollout, step, pair and the number of the pair's impact in the step only.
    """
    i, j = int(C[first, SURFACE_A]), int(C[first, SURFACE_B])
    own = combine(combine(key, int(par[STEP_NUMBER]) * _PARTS_OF_A_STEP + int(par[PART])), min(i, j))
    own = combine(combine(own, max(i, j)), int(C[first, STRUCK]))
    x, y = two_normals(own, 0)
    z, p = two_normals(own, 1)
    q, r = two_normals(own, 2)
    f, _ = two_normals(own, 3)
    turn, shift = times(par[DIRECTION_ERROR], (x, y, z)), times(par[POINT_ERROR], (p, q, r))
    for k in range(first, last):
        n = three(C, k, NORMAL)
        along = minus(shift, times(dot(n, shift), n))
        write(C, k, ARM_A, plus(three(C, k, ARM_A), along))
        write(C, k, ARM_B, plus(three(C, k, ARM_B), along))
        given = (0.0, 0.0, 0.0)
        for at in range(3):
            d = three(C, k, NORMAL + 3 * at)
            given = plus(given, times(C[k, SURFACE_U + at], d))
            write(C, k, SAVED + 3 * at, d)
            write(C, k, NORMAL + 3 * at, _rotated(d, turn))
        for at in range(3):
            C[k, SURFACE_U + at] = dot(given, three(C, k, NORMAL + 3 * at))
        masses(C, k, Y)
        C[k, MU] *= math.exp(par[MU_ERROR] * f)


@inner
def _restore(first, last, C, Y):
    """Undo `_disturb`."""
    for k in range(first, last):
        for at in range(9):
            C[k, NORMAL + at] = C[k, SAVED + at]
        spread(C, k, Y, 0.0)


@inner
def _strike(C, k, Y, par):
    """Prepare a contact for an impact: the rebound wanted, and friction, which is less at speed.

    One that opens waits: if the impact closes it, it has one of its own. To stop it at once would add energy.
    """
    u = closing(Y, C, k)
    write(C, k, LN, (0.0, 0.0, 0.0))
    write(C, k, MOMENT, (0.0, 0.0, 0.0))
    C[k, MODE] = PARTS if C[k, GAP] < NEAR and u < landing(C, k) else WAITS
    C[k, REBOUND] = -C[k, E] * u if u < -bouncing(C, k) else 0.0
    C[k, MU] /= 1.0 + par[SLIPPERINESS] * max(-u, 0.0)


@inner
def _energy_of(Y, i, v, w):
    """Return the kinetic energy of body i at velocities v and w; zero if it does not move freely."""
    if Y[i, IMASS] == 0.0:
        return 0.0
    return 0.5 * dot(v, v) / Y[i, IMASS] + 0.5 * dot(w, momentum(Y, i, w))


@inner(noinline=True)
def _keep_energy(first, last, C, Y, before):
    """Scale the impulses of a pair's impact down to what gains no energy.

    Newton's restitution with friction can gain some: where friction turns what slides, a rebound at the
    speed wanted needs more impulse than the bodies' energy pays for. The energy is that relative to surfaces
    that are driven: half the impulses' product with the sum of velocities before and after.
    """
    a, b = int(C[first, BODY_A]), int(C[first, BODY_B])
    va, wa, vb, wb = before
    changes = (
        minus(three(Y, a, VEL), va),
        minus(three(Y, a, SPIN), wa),
        minus(three(Y, b, VEL), vb),
        minus(three(Y, b, SPIN), wb),
    )
    change = _energy_of(Y, a, changes[0], changes[1]) + _energy_of(Y, b, changes[2], changes[3])
    after = 0.0
    for k in range(first, last):
        u = parting(Y, C, k)
        for at in range(3):
            after += C[k, LN + at] * (dot(u, three(C, k, NORMAL + 3 * at)) - C[k, SURFACE_U + at])
    if after <= change:
        return
    share = max(2.0 - after / change, 0.0)
    for k in range(first, last):
        write(C, k, LN, times(share, three(C, k, LN)))
    if Y[a, IMASS] > 0.0:
        write(Y, a, VEL, plus(va, times(share, changes[0])))
        write(Y, a, SPIN, plus(wa, times(share, changes[1])))
    write(Y, b, VEL, plus(vb, times(share, changes[2])))
    write(Y, b, SPIN, plus(wb, times(share, changes[3])))


@inner(noinline=True)
def impacts(start, end, C, Y, par, key, count):
    """Let pairs that touch and close fast rebound, one after another, until none does."""
    errors = par[DIRECTION_ERROR] > 0.0 or par[POINT_ERROR] > 0.0 or par[MU_ERROR] > 0.0
    for _ in range(IMPACTS_MOST):
        again, first = False, start
        while first < end:
            last, hit = first, False
            while last < end and C[last, BODY_A] == C[first, BODY_A] and C[last, BODY_B] == C[first, BODY_B]:
                hit = hit or (C[last, GAP] < NEAR and closing(Y, C, last) < -landing(C, last))
                last += 1
            if hit:
                again = True
                count[IMPACTS] += 1
                for k in range(first, last):
                    masses(C, k, Y)
                if errors:
                    _disturb(first, last, C, Y, par, key)
                for k in range(first, last):
                    _strike(C, k, Y, par)
                a, b = int(C[first, BODY_A]), int(C[first, BODY_B])
                before = three(Y, a, VEL), three(Y, a, SPIN), three(Y, b, VEL), three(Y, b, SPIN)
                count[IMPACT_VISITS] += (last - first) * solve(IMPACT_SWEEPS, first, last, C, Y, 1.0, _EXACT)
                _keep_energy(first, last, C, Y, before)
                note(first, last, C)
                for k in range(first, last):
                    C[k, MU] = C[k, MU0]
                    C[k, STRUCK] += 1.0
                if errors:
                    _restore(first, last, C, Y)
            first = last
        if not again:
            break
    for k in range(start, end):
        C[k, MODE] = HOLDS
