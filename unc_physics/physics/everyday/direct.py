"""Direct solution of small groups whose masses differ much, where sweeps converge too slowly.

The contacts' states (open, sticking, sliding) are those of the sweeps at first, and change until none
contradicts its impulses.
"""

import math

from ...compiler import inner
from ...spatial.rotation import cross
from ...spatial.vectors import dot, three
from .columns import (
    ARM_A,
    ARM_B,
    BEFORE,
    BODY_A,
    BODY_B,
    GAP,
    IMASS,
    IWORLD,
    L1,
    L2,
    LN,
    MODE,
    MU,
    NORMAL,
    PUSH_V,
    PUSH_W,
    SPIN,
    SURFACE_U,
    TAN1,
    TAN2,
    UNKNOWNS,
    VEL,
)
from .motion import symmetric_times, write
from .solve import HOLDS, closing, kick, parting

OPEN, STICKS, SLIPS = 0, 1, 2  # MODE of a contact in the direct solution
_STICKING = 0.999  # share of the cone below which a contact begins as sticking
_ROUNDS = 30  # changes of states until it gives up
_REGULAR = 1e-8  # relative increase of the diagonal: more contacts than a rigid body needs
_PULL, _ABOVE, _CLOSES = 1e-9, 1e-9, 1e-8  # round-off of impulses, of the cone, of speeds [m/s]


@inner
def _of_body(Y, i, C, j, at, x, k, by, y):
    """Return the part of `_effect` of body i, with the arms in column ``at`` of j and column ``by`` of k."""
    e, f = three(C, j, NORMAL + 3 * x), three(C, k, NORMAL + 3 * y)
    spin = symmetric_times(Y, i, IWORLD, cross(three(C, k, by), f))
    return Y[i, IMASS] * dot(e, f) + dot(cross(three(C, j, at), e), spin) if Y[i, IMASS] > 0.0 else 0.0


@inner
def _effect(C, j, k, x, y, Y):
    """Return the speed along direction x at contact j by a unit impulse along direction y at contact k."""
    aj, bj, ak, bk = int(C[j, BODY_A]), int(C[j, BODY_B]), int(C[k, BODY_A]), int(C[k, BODY_B])
    g = 0.0
    if bj == bk:
        g += _of_body(Y, bj, C, j, ARM_B, x, k, ARM_B, y)
    if aj == ak:
        g += _of_body(Y, aj, C, j, ARM_A, x, k, ARM_A, y)
    if bj == ak:
        g -= _of_body(Y, bj, C, j, ARM_B, x, k, ARM_A, y)
    if aj == bk:
        g -= _of_body(Y, aj, C, j, ARM_A, x, k, ARM_B, y)
    return g


@inner
def _along(C, k):
    """Return the tangential impulse of a contact."""
    return math.sqrt(C[k, L1] * C[k, L1] + C[k, L2] * C[k, L2])


@inner(noinline=True, error_model="numpy")
def _violation(first, last, C, Y, h):
    """Return the largest speed that contradicts the impulses.

    Contacts that hold neither close nor part, others do not close too fast; what sticks does not slip, and
    what slides does not slip along its friction.
    """
    most = 0.0
    for k in range(first, last):
        u = closing(Y, C, k) + max(C[k, GAP], 0.0) / h
        most = max(most, abs(u) if C[k, LN] > 0.0 else -u)
        if C[k, LN] > 0.0 and C[k, MU] > 0.0:
            v, t = parting(Y, C, k), _along(C, k)
            x, y = (
                dot(three(C, k, TAN1), v) - C[k, SURFACE_U + 1],
                dot(three(C, k, TAN2), v) - C[k, SURFACE_U + 2],
            )
            if t < _STICKING * C[k, MU] * C[k, LN]:
                most = max(most, math.sqrt(x * x + y * y))
            else:
                most = max(most, (x * C[k, L1] + y * C[k, L2]) / t)
    return most


@inner
def _unknowns(C, k):
    """Return the number of unknown impulses of a contact: none, those along normal and tangents, or one."""
    if C[k, MODE] == OPEN:
        return 0
    return 3 if C[k, MODE] == STICKS else 1


@inner
def _number(first, last, C, A):
    """Number the unknowns; return how many."""
    m = 0
    for k in range(first, last):
        A[UNKNOWNS, k - first] = m
        m += _unknowns(C, k)
    return m


@inner(noinline=True, error_model="numpy")
def _equations(first, last, C, Y, h, A):
    """Fill matrix and right side: speeds at the contacts are to vanish, or to close the gap within h."""
    for j in range(first, last):
        r, v = int(A[UNKNOWNS, j - first]), parting(Y, C, j)
        for x in range(_unknowns(C, j)):
            u = dot(three(C, j, NORMAL + 3 * x), v) - C[j, SURFACE_U + x]
            if x == 0:
                u += max(C[j, GAP], 0.0) / h
            A[r + x, UNKNOWNS] = -u
            for k in range(first, last):
                if C[k, MODE] == OPEN:
                    continue
                c = int(A[UNKNOWNS, k - first])
                if C[k, MODE] == STICKS:
                    for y in range(3):
                        A[r + x, c + y] = _effect(C, j, k, x, y, Y)
                else:
                    t = _along(C, k) + 1e-300
                    slip = C[k, L1] * _effect(C, j, k, x, 1, Y) + C[k, L2] * _effect(C, j, k, x, 2, Y)
                    A[r + x, c] = _effect(C, j, k, x, 0, Y) + C[k, MU] / t * slip
            A[r + x, r + x] *= 1.0 + _REGULAR


@inner(noinline=True, error_model="numpy")
def _gauss(m, A):
    """Solve m equations with pivots; the right side, the last column, becomes the solution."""
    for c in range(m):
        p = c
        for r in range(c + 1, m):
            if abs(A[r, c]) > abs(A[p, c]):
                p = r
        if p != c:
            for x in range(m):
                A[p, x], A[c, x] = A[c, x], A[p, x]
            A[p, UNKNOWNS], A[c, UNKNOWNS] = A[c, UNKNOWNS], A[p, UNKNOWNS]
        for r in range(c + 1, m):
            f = A[r, c] / (A[c, c] + 1e-300)
            if f != 0.0:
                for x in range(c, m):
                    A[r, x] -= f * A[c, x]
                A[r, UNKNOWNS] -= f * A[c, UNKNOWNS]
    for c in range(m - 1, -1, -1):
        for x in range(c + 1, m):
            A[c, UNKNOWNS] -= A[c, x] * A[x, UNKNOWNS]
        A[c, UNKNOWNS] /= A[c, c] + 1e-300


@inner
def _take(first, last, C, A):
    """Read the impulses from the solution; return the largest along a normal."""
    most = 1e-12
    for k in range(first, last):
        if C[k, MODE] == OPEN:
            write(C, k, LN, (0.0, 0.0, 0.0))
            continue
        r = int(A[UNKNOWNS, k - first])
        ln = A[r, UNKNOWNS]
        if C[k, MODE] == STICKS:
            write(C, k, LN, (ln, A[r + 1, UNKNOWNS], A[r + 2, UNKNOWNS]))
        else:
            share = max(C[k, MU] * ln, 1e-30) / (_along(C, k) + 1e-300)
            write(C, k, LN, (ln, C[k, L1] * share, C[k, L2] * share))
        most = max(most, abs(ln))
    return most


@inner
def _apply(first, last, C, Y, share):
    """Apply a share of all impulses to the velocities."""
    for k in range(first, last):
        kick(Y, C, k, share * C[k, LN], share * C[k, L1], share * C[k, L2])


@inner(noinline=True)
def _revise(first, last, C, Y, h, most):
    """Change the states that the impulses contradict; return whether any had to change.

    All beyond their cones slide, and the one that pulls most opens; if none pulls, the open one that closes
    fastest sticks.
    """
    changed, pull, worst = False, -_PULL * most, -1
    for k in range(first, last):
        if C[k, MODE] != OPEN and C[k, LN] < pull:
            pull, worst = C[k, LN], k
        elif C[k, MODE] == STICKS and _along(C, k) > C[k, MU] * C[k, LN] * (1.0 + _ABOVE):
            C[k, MODE] = SLIPS
            changed = True
    if worst >= 0:
        C[worst, MODE] = OPEN
        return True
    _apply(first, last, C, Y, 1.0)
    fast = -_CLOSES
    for k in range(first, last):
        if C[k, MODE] == OPEN:
            u = closing(Y, C, k) + max(C[k, GAP], 0.0) / h
            if u < fast:
                fast, worst = u, k
    _apply(first, last, C, Y, -1.0)
    if worst >= 0:
        C[worst, MODE] = STICKS
        changed = True
    return changed


@inner(noinline=True, error_model="numpy")
def solve_directly(first, last, C, Y, h, A):
    """Solve the contacts of a small group exactly; return 1 if that settled.

    Otherwise, or where the sweeps were better, impulses and velocities stay as the sweeps left them.
    """
    swept = _violation(first, last, C, Y, h)
    for k in range(first, last):  # PUSH_V and PUSH_W keep the velocities, BEFORE the impulses
        for i in (int(C[k, BODY_A]), int(C[k, BODY_B])):
            write(Y, i, PUSH_V, three(Y, i, VEL))
            write(Y, i, PUSH_W, three(Y, i, SPIN))
        write(C, k, BEFORE, three(C, k, LN))
    for k in range(first, last):
        sticks = _along(C, k) < _STICKING * C[k, MU] * C[k, LN]
        C[k, MODE] = OPEN if C[k, LN] <= 0.0 else (STICKS if sticks else SLIPS)
    _apply(first, last, C, Y, -1.0)
    settled = 0
    for _ in range(_ROUNDS):
        m = _number(first, last, C, A)
        _equations(first, last, C, Y, h, A)
        _gauss(m, A)
        if not _revise(first, last, C, Y, h, _take(first, last, C, A)):
            settled = 1
            break
    for k in range(first, last):  # within the cones
        C[k, MODE] = HOLDS
        ln, t = max(C[k, LN], 0.0), _along(C, k)
        top = C[k, MU] * ln
        share = 1.0 if t <= top else top / t
        write(C, k, LN, (ln, share * C[k, L1], share * C[k, L2]))
    _apply(first, last, C, Y, 1.0)
    if settled == 0 or not _violation(first, last, C, Y, h) <= swept:
        settled = 0
        for k in range(first, last):
            write(C, k, LN, three(C, k, BEFORE))
            for i in (int(C[k, BODY_A]), int(C[k, BODY_B])):
                write(Y, i, VEL, three(Y, i, PUSH_V))
                write(Y, i, SPIN, three(Y, i, PUSH_W))
    return settled
