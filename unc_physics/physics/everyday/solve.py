"""Impulses of contacts: sweeps with extrapolation, and velocities that take out depth."""

import math

from ...compiler import inner
from ...spatial.rotation import cross
from ...spatial.vectors import dot, minus, plus, three, times
from .columns import (
    ACCEL,
    ARM_A,
    ARM_B,
    BEFORE,
    BELT_W,
    BETWEEN,
    BODY_A,
    BODY_B,
    BY_NORMAL,
    EASE_N,
    EASE_T,
    FARTHEST,
    GAP,
    IMASS,
    IWORLD,
    K11,
    K12,
    K22,
    L1,
    L2,
    LN,
    MASS_N,
    MASS_T,
    MODE,
    MOMENT,
    MU,
    NORMAL,
    PUSH,
    PUSH_MOST,
    PUSH_V,
    PUSH_W,
    REBOUND,
    ROLL,
    ROLL_SPEED,
    SLIDES,
    SLOP,
    SPIN,
    SURFACE_U,
    SWEEPS,
    TAN1,
    TAN2,
    TWIST,
    VEL,
    WARM,
    WARM_MOMENT,
)
from .motion import momentum, symmetric_times, write

_PAID = 0.1  # most of the energy of motion that goes into depth in a substep
HOLDS, PARTS, WAITS = 0, 1, 2  # MODE: closes its gap at most; parts at REBOUND; takes no part


@inner(forceinline=True)
def parting(Y, C, k):
    """Return the velocity of b relative to a where a contact's impulses act."""
    a, b = int(C[k, BODY_A]), int(C[k, BODY_B])
    u = plus(three(Y, b, VEL), cross(three(Y, b, SPIN), three(C, k, ARM_B)))
    return minus(u, plus(three(Y, a, VEL), cross(three(Y, a, SPIN), three(C, k, ARM_A))))


@inner
def closing(Y, C, k):
    """Return the normal speed of b relative to a at a contact."""
    return dot(three(C, k, NORMAL), parting(Y, C, k)) - C[k, SURFACE_U]


@inner
def slides(Y, C, k):
    """Return whether a contact that bears slides."""
    v = parting(Y, C, k)
    x, y = dot(three(C, k, TAN1), v) - C[k, SURFACE_U + 1], dot(three(C, k, TAN2), v) - C[k, SURFACE_U + 2]
    return C[k, LN] > 0.0 and x * x + y * y > SLIDES * SLIDES


@inner(forceinline=True)
def push(Y, C, k, f, v, w):
    """Apply an impulse to the velocities in columns v and w on."""
    a, b, rb = int(C[k, BODY_A]), int(C[k, BODY_B]), three(C, k, ARM_B)
    vb, wb = times(Y[b, IMASS], f), symmetric_times(Y, b, IWORLD, cross(rb, f))
    if Y[a, IMASS] > 0.0:
        va, wa = times(Y[a, IMASS], f), symmetric_times(Y, a, IWORLD, cross(three(C, k, ARM_A), f))
        va, wa = minus(three(Y, a, v), va), minus(three(Y, a, w), wa)
        write(Y, a, v, va)
        write(Y, a, w, wa)
    vb, wb = plus(three(Y, b, v), vb), plus(three(Y, b, w), wb)
    write(Y, b, v, vb)
    write(Y, b, w, wb)


@inner
def kick(Y, C, k, ln, l1, l2):
    """Apply impulses along the normal and the tangents."""
    f = plus(times(ln, three(C, k, NORMAL)), times(l1, three(C, k, TAN1)))
    push(Y, C, k, plus(f, times(l2, three(C, k, TAN2))), VEL, SPIN)


@inner
def _twist_by(Y, C, k, m, w):
    """Apply a moment's impulse along normal and tangents to the angular velocities in column w on."""
    a, b = int(C[k, BODY_A]), int(C[k, BODY_B])
    moment = plus(times(m[1], three(C, k, TAN1)), times(m[2], three(C, k, TAN2)))
    moment = plus(times(m[0], three(C, k, NORMAL)), moment)
    write(Y, b, w, plus(three(Y, b, w), symmetric_times(Y, b, IWORLD, moment)))
    if Y[a, IMASS] > 0.0:
        write(Y, a, w, minus(three(Y, a, w), symmetric_times(Y, a, IWORLD, moment)))


@inner
def bear(Y, C, k, f, m, v, w):
    """Apply a contact's impulse f and that of its moment m, along normal and tangents, as `push`."""
    along = plus(times(f[0], three(C, k, NORMAL)), times(f[1], three(C, k, TAN1)))
    push(Y, C, k, plus(along, times(f[2], three(C, k, TAN2))), v, w)
    if C[k, TWIST] > 0.0 or C[k, ROLL] > 0.0:
        _twist_by(Y, C, k, m, w)


@inner(noinline=True, error_model="numpy")
def _resist(Y, C, k):
    """Let torsional and rolling friction of a contact act; return the change of speed.

    Moments oppose relative spin: about the normal up to TWIST times LN, across it up to ROLL times LN.
    """
    n, t1, t2 = three(C, k, NORMAL), three(C, k, TAN1), three(C, k, TAN2)
    a, b, old, ln = int(C[k, BODY_A]), int(C[k, BODY_B]), three(C, k, MOMENT), C[k, LN]
    w = minus(three(Y, b, SPIN), plus(three(Y, a, SPIN), three(C, k, BELT_W)))
    easy, across = C[k, EASE_N], C[k, EASE_T]
    top, most = C[k, TWIST] * ln, C[k, ROLL] * ln
    m = min(max(old[0] - dot(n, w) / easy, -top), top)
    x, y = old[1] - dot(t1, w) / across, old[2] - dot(t2, w) / across
    r = math.sqrt(x * x + y * y)
    if r > most:
        x, y = x * most / r, y * most / r
    new = m, x, y
    d = minus(new, old)
    write(C, k, MOMENT, new)
    _twist_by(Y, C, k, d, SPIN)
    return abs(d[0]) * easy * C[k, TWIST] + (abs(d[1]) + abs(d[2])) * C[k, ROLL_SPEED]


@inner(noinline=True, error_model="numpy")
def sweep(first, last, C, Y, h):
    """Let each contact act once on the velocities that the others left.

    By MODE a contact closes its gap within h at most, parts with the speed REBOUND, or takes no part. Returns
    the largest change of speed, and the sum of squares of the changes of impulses.
    """
    most = total = 0.0
    for k in range(first, last):
        if C[k, MODE] == WAITS:
            continue
        n, t1, t2 = three(C, k, NORMAL), three(C, k, TAN1), three(C, k, TAN2)
        ln, l1, l2, m, v = C[k, LN], C[k, L1], C[k, L2], C[k, MASS_N], parting(Y, C, k)
        wanted = C[k, REBOUND] if C[k, MODE] == PARTS else -max(C[k, GAP], 0.0) / h
        new = max(ln - m * (dot(n, v) - C[k, SURFACE_U] - wanted), 0.0)
        d = new - ln
        if d == 0.0 and new == 0.0 and l1 == 0.0 and l2 == 0.0:
            continue
        u1 = dot(t1, v) - C[k, SURFACE_U + 1] + d * C[k, BY_NORMAL]
        u2 = dot(t2, v) - C[k, SURFACE_U + 2] + d * C[k, BY_NORMAL + 1]
        x, y = l1 - C[k, K11] * u1 - C[k, K12] * u2, l2 - C[k, K12] * u1 - C[k, K22] * u2
        top = C[k, MU] * new
        if x * x + y * y > top * top:  # slides: against the velocity
            x, y = l1 - C[k, MASS_T] * u1, l2 - C[k, MASS_T] * u2
            r = math.sqrt(x * x + y * y)
            if r > top:
                x, y = x * top / r, y * top / r
        d1, d2 = x - l1, y - l2
        most = max(most, (abs(d) + abs(d1) + abs(d2)) / m)
        total += d * d + d1 * d1 + d2 * d2
        push(Y, C, k, plus(plus(times(d, n), times(d1, t1)), times(d2, t2)), VEL, SPIN)
        write(C, k, LN, (new, x, y))
        if C[k, TWIST] > 0.0 or C[k, ROLL] > 0.0:
            most = max(most, _resist(Y, C, k))
    return most, total


@inner
def _extrapolate(first, last, C, Y, more):
    """Change the impulses on by ``more`` times the last change, within the cones."""
    for k in range(first, last):
        d = times(more, minus(three(C, k, LN), three(C, k, BEFORE)))
        if d[0] == 0.0 and d[1] == 0.0 and d[2] == 0.0:
            continue
        ln, x, y = max(C[k, LN] + d[0], 0.0), C[k, L1] + d[1], C[k, L2] + d[2]
        top = C[k, MU] * ln
        if x * x + y * y > top * top:
            share = top / math.sqrt(x * x + y * y)
            x, y = x * share, y * share
        kick(Y, C, k, ln - C[k, LN], x - C[k, L1], y - C[k, L2])
        write(C, k, LN, (ln, x, y))


@inner(noinline=True, error_model="numpy")
def solve(rounds, first, last, C, Y, h, tolerance):
    """Sweep until speeds change by less, and extrapolate what converges slowly; return how many."""
    before = 0.0
    for r in range(rounds):
        turn = r % BETWEEN if r > BETWEEN else 0  # at 1 and 2 changes are measured, and their ratio after 2
        if turn == 2:
            for k in range(first, last):
                write(C, k, BEFORE, three(C, k, LN))
        most, now = sweep(first, last, C, Y, h)
        if most < tolerance:
            return r + 1
        if turn == 1 or turn == 2:
            ratio = math.sqrt(now / before) if before > 0.0 else 0.0
            before = now
            if turn == 2 and 0.0 < ratio < 1.0:
                _extrapolate(first, last, C, Y, min(ratio / (1.0 - ratio), FARTHEST))
    return rounds


@inner(noinline=True)
def start_warm(first, last, C, Y, h):
    """Begin with the impulses that the last forces give within h."""
    for k in range(first, last):
        share = h if C[k, MODE] != WAITS else 0.0
        write(C, k, LN, times(share, three(C, k, WARM)))
        write(C, k, MOMENT, times(share, three(C, k, WARM_MOMENT)))
        if C[k, LN] > 0.0:
            bear(Y, C, k, three(C, k, LN), three(C, k, MOMENT), VEL, SPIN)


@inner
def keep_warm(first, last, C, h):
    """Keep the forces of this substep for the next one."""
    for k in range(first, last):
        write(C, k, WARM, times(1.0 / h, three(C, k, LN)))
        write(C, k, WARM_MOMENT, times(1.0 / h, three(C, k, MOMENT)))


@inner(noinline=True, error_model="numpy")
def push_out(first, last, members, C, Y, h):
    """Find velocities that take depth out within h without friction; they move the bodies once.

    With friction, or as part of the velocities, this would load what is wedged in, and the load could do
    work.
    """
    for i in members:
        write(Y, i, PUSH_V, (0.0, 0.0, 0.0))
        write(Y, i, PUSH_W, (0.0, 0.0, 0.0))
    fastest = 0.0
    for k in range(first, last):
        C[k, BEFORE] = 0.0
        fastest = max(fastest, min(PUSH / h * (-C[k, GAP] - SLOP), PUSH_MOST))
    for _ in range(SWEEPS):
        most = 0.0
        for k in range(first, last):
            a, b, n, s = int(C[k, BODY_A]), int(C[k, BODY_B]), three(C, k, NORMAL), C[k, GAP]
            u = dot(n, three(Y, b, PUSH_V)) + dot(cross(three(C, k, ARM_B), n), three(Y, b, PUSH_W))
            if Y[a, IMASS] > 0.0:
                u -= dot(n, three(Y, a, PUSH_V)) + dot(cross(three(C, k, ARM_A), n), three(Y, a, PUSH_W))
            u += s / h if s > 0.0 else max(PUSH / h * min(s + SLOP, 0.0), -PUSH_MOST)
            new = max(C[k, BEFORE] - C[k, MASS_N] * u, 0.0)
            d = new - C[k, BEFORE]
            if d == 0.0:
                continue
            C[k, BEFORE] = new
            most = max(most, abs(d) / C[k, MASS_N])
            push(Y, C, k, times(d, n), PUSH_V, PUSH_W)
        if most < PUSH * fastest:
            break
    _pay(members, Y, h, fastest if len(members) == 1 else 0.0)


@inner
def _pay(members, Y, h, lift):
    """Take the work of `push_out` against forces from the energy of motion; where there is little, push less.

    Without this a wedged body is lifted, falls back and is lifted again, and its energy grows. At most a
    tenth is taken: a body that begins to tip over an edge has little, and would stop there. Where that is
    too little, a body that touches no other may rise as fast as its deepest contact is pushed, ``lift``
    [m/s]. Otherwise one that lies too deep on a slope would lose all speed that it gains. Stacks of masses
    with a ratio of 100 would creep by 4 mm in 3 s.
    """
    work, have, free = 0.0, 0.0, 0.0
    for i in members:
        m, v, w, acc = 1.0 / Y[i, IMASS], three(Y, i, VEL), three(Y, i, SPIN), three(Y, i, ACCEL)
        work -= h * m * dot(acc, three(Y, i, PUSH_V))
        free += h * m * math.sqrt(dot(acc, acc)) * lift
        have += 0.5 * m * dot(v, v) + 0.5 * dot(w, momentum(Y, i, w))
    if work > 0.0:
        paid = work if work < _PAID * have else max(0.0, min(work - free, _PAID * have))
        keep = math.sqrt(1.0 - paid / have) if have > 0.0 else 1.0
        part = min(1.0, (free + paid) / work)
        for i in members:
            write(Y, i, VEL, times(keep, three(Y, i, VEL)))
            write(Y, i, SPIN, times(keep, three(Y, i, SPIN)))
            write(Y, i, PUSH_V, times(part, three(Y, i, PUSH_V)))
            write(Y, i, PUSH_W, times(part, three(Y, i, PUSH_W)))
