"""Where contacts of what rolls push: at their places in the middle of an interval.

Gaps and speeds are those of the interval's end. Its impulse is the mean of a force that acts all the while:
on a disc that rolls on its edge it would come half an interval too late, and brake the disc.
"""

import math

import numpy as np

from ..collision.contact_row import (
    AXIS,
    COMPLIANCE,
    IN_MIDDLE,
    INVERSE_MASS_I,
    LEAD,
    MOMENT_I,
    SHIFT,
    SLIP_COMPLIANCE,
    TURN_I,
)
from ..collision.implicit_workspace import CONTACTS, FREE, START
from ..compiler import inner
from ..spatial.rotation import cross, exp, rotate, rotate_back
from ..spatial.vectors import dot, minus, plus, put, three, times, triple, vector
from .implicit_solver import next_patch

#: Turn in an interval from which on it matters [rad], and the farthest way of a contact in units of that of
#: the body's farthest points: what goes farther jumps from one edge of a face to another.
_TURNED, _FARTHEST = 1e-3, 5.0
#: Height over which spheres beside the lowest count as well [m].
_BUMPS = 1.3e-4
_REACH = 1e-7  # over which shifts are differentiated [rad]


@inner(forceinline=True)
def lever_arm(row, at, n, first, second):
    """A lever arm from its moments about the three directions, the first of them being at ``at``."""
    along_n, along_first = triple(row, at), triple(row, at + AXIS)
    # arm . second = (arm x n) . first, and so on, for a right-handed basis
    a, b, c = dot(along_n, first), -dot(along_n, second), dot(along_first, second)
    return plus(plus(times(a, second), times(b, first)), times(c, n))


@inner(forceinline=True)
def _turned(q, v):
    """A vector turned by a quaternion."""
    u = (q[0], q[1], q[2])
    c = cross(u, v)
    return plus(v, times(2.0, plus(times(q[3], c), cross(u, c))))


@inner(forceinline=True)
def mean_turn(h, velocity, i):
    """Turn of body i over an interval of ``h`` seconds, as its contacts' places take it [rad]."""
    return times(h, plus(times(0.25, three(velocity[START], i, 3)), times(0.75, three(velocity[FREE], i, 3))))


@inner(error_model="numpy")
def push_in_the_middle(h, world, work):
    """Let contacts with elements push where they are in the middle of an interval of ``h`` seconds."""
    rows, ids, m = work.rows, work.ids, work.counts[CONTACTS]
    first = 0
    while first < m:
        last, lead = next_patch(rows, first, m)
        for c in range(first, last):
            rows[c, IN_MIDDLE] = 0.0
        i = ids[lead, 0]
        if ids[lead, 1] < 0:
            n, turn = triple(rows[lead], 0), mean_turn(h, work.velocity, i)
            moves, shift = middle_shift(n, turn, i, work.R[i], world)
            if moves:
                for c in range(first, last):
                    if rows[c, LEAD] == lead:
                        axes = triple(rows[c], 0), triple(rows[c], AXIS), triple(rows[c], 2 * AXIS)
                        arm = middle_arm(lever_arm(rows[c], MOMENT_I, *axes), shift, n, turn)
                        _push_at(rows[c], arm, axes, work.inverse_inertia[i])
                        rows[c, IN_MIDDLE] = 1.0
                        for k in range(3):
                            rows[c, SHIFT + k] = shift[k]
        first = last


@inner(forceinline=True)
def middle_arm(arm, shift, n, turn):
    """Lever arm at which a contact pushes, from the one at the interval's end: ``shift`` away, and turned
    back about the normal ``n`` of its lead.
    """
    return plus(plus(arm, shift), cross(_half_spin(n, turn), arm))


@inner(forceinline=True)
def _half_spin(n, turn):
    """Turn back about a normal to the middle of an interval."""
    return times(-0.5 * dot(turn, n), n)


@inner(error_model="numpy")
def middle_shift(n, turn, i, R, world):
    """How far the place where body i touches along normal ``n`` is in the middle of an interval from that at
    its end, beyond what turning about the normal does.

    ``turn`` is the body's turn over the interval [rad], ``R`` (3, 3) its ``R_world_body`` at the end.

    Returns
    -------
    moves : bool
        Whether contacts push there.
    shift : tuple of 3 floats
        [m]
    """
    across = minus(turn, times(dot(turn, n), n))
    size = math.sqrt(dot(across, across))
    if size <= _TURNED:
        return False, (0.0, 0.0, 0.0)
    end = _support(n, (0.0, 0.0, 0.0), i, R, world)
    way = minus(_support(n, times(-0.5, turn), i, R, world), end)
    along = times(1.0 / size, cross(across, n))
    step = dot(minus(way, cross(_half_spin(n, turn), end)), along)
    shift = plus(times(step, along), times(dot(way, n), n))
    return abs(step) < _FARTHEST * size * world.bodies.radius[i], shift


@inner(noinline=True)
def write_shift_slopes(n, first, second, turn, i, R, world, out):
    """Write the derivative of `middle_shift` into ``out`` (3, 5): by tilts of the normal towards ``first``
    and ``second``, and by the turn.
    """
    for k in range(5):
        ahead = behind = (0.0, 0.0, 0.0)
        for sign in (1.0, -1.0):
            e, t = n, turn
            if k < 2:
                e = plus(n, times(sign * _REACH, first if k == 0 else second))
                e = times(1.0 / math.sqrt(dot(e, e)), e)
            else:
                t = plus(turn, times(sign * _REACH, (1.0 * (k == 2), 1.0 * (k == 3), 1.0 * (k == 4))))
            _, shift = middle_shift(e, t, i, R, world)
            if sign > 0.0:
                ahead = shift
            else:
                behind = shift
        put(out, 0, k, times(0.5 / _REACH, minus(ahead, behind)))


@inner
def middle_arm_change(arm, shift, lead, turn, tilt, darm, dn, dturn):
    """Change of `middle_arm` where the body's rotation changes by ``tilt``, its arm by ``darm``, the normal
    of its lead by ``dn`` and the turn by ``dturn``.

    ``lead`` is the lead's `Geometry`. ``shift`` (3, 6) is the shift, and beside it its derivative
    (`write_shift_slopes`). What turns all of these together turns the arm as well; the rest counts as seen by
    the body.
    """
    n, first, second = lead.n, lead.first, lead.second
    darm, dn = minus(darm, cross(tilt, arm)), minus(dn, cross(tilt, n))
    dturn = minus(dturn, cross(tilt, turn))
    spin = dot(turn, n)
    dspin = dot(dturn, n) + dot(turn, dn)
    bend = times(-0.5, plus(times(dspin, n), times(spin, dn)))
    a, b = dot(first, dn), dot(second, dn)
    dshift = plus(times(a, vector(shift, 0, 1)), times(b, vector(shift, 0, 2)))
    for k in range(3):
        dshift = plus(dshift, times(dturn[k], vector(shift, 0, 3 + k)))
    changed = plus(plus(darm, dshift), plus(cross(bend, arm), cross(_half_spin(n, turn), darm)))
    return plus(cross(tilt, middle_arm(arm, vector(shift, 0, 0), n, turn)), changed)


@inner(error_model="numpy")
def _support(n, back, i, R, world):
    """Arm to where body i, turned by ``back`` from its orientation ``R``, is lowest against ``n`` [m].

    Of several spheres that are nearly as low the mean counts: it does not jump over a packing's bumps.
    """
    hull = world.implicit.hull
    low, high = world.implicit.hull_range[i, 0], world.implicit.hull_range[i, 1]
    q = exp(back[0], back[1], back[2])
    up = _turned((-q[0], -q[1], -q[2], q[3]), n)
    x, y, z = rotate_back(R, up[0], up[1], up[2])
    least = np.inf
    for k in range(low, high):
        least = min(least, x * hull[0, k] + y * hull[1, k] + z * hull[2, k] - hull[3, k])
    total, c = 0.0, (0.0, 0.0, 0.0)
    for k in range(low, high):
        above = x * hull[0, k] + y * hull[1, k] + z * hull[2, k] - hull[3, k] - least
        if above < _BUMPS:
            share = (1.0 - above / _BUMPS) ** 2
            total += share
            c = plus(c, times(share, (hull[0, k], hull[1, k], hull[2, k])))
    c = times(1.0 / total, c)
    c = _turned(q, rotate(R, c[0], c[1], c[2]))
    return plus(c, times(least - dot(c, n), n))


@inner
def _push_at(row, arm, axes, inverse_inertia):
    """Let a contact's impulses turn its body i by another lever arm than that of its speeds."""
    for d, axis in ((0, axes[0]), (1, axes[1]), (2, axes[2])):
        at = AXIS * d
        moment = cross(arm, axis)
        turn = rotate(inverse_inertia, moment[0], moment[1], moment[2])
        row[at + TURN_I], row[at + TURN_I + 1], row[at + TURN_I + 2] = turn
        own = row[INVERSE_MASS_I] + dot(triple(row, at + MOMENT_I), turn)
        if d == 0:
            row[COMPLIANCE] = own
        elif d == 1:
            row[SLIP_COMPLIANCE] = own
        else:
            row[SLIP_COMPLIANCE] = max(row[SLIP_COMPLIANCE], own)
