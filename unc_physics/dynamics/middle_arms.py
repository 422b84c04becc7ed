"""Lever arms of contacts of rolling bodies, at the contact points in the middle of an interval.

Gaps and speeds refer to the interval's end. The impulse is the mean of a force over the interval. At the end
pose, the impulse on a disc that rolls on its edge would lag by half an interval and brake the disc.
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

#: Smallest rotation in an interval that matters [rad]. Then the largest shift of a contact relative to the
#: motion of the body's farthest points; larger ones jump between edges of a face.
_TURNED, _FARTHEST = 1e-3, 5.0
#: Height above the lowest sphere within which other spheres count as well [m].
_BUMPS = 1.3e-4
_REACH = 1e-7  # step of finite differences of the shift [rad]


@inner(forceinline=True)
def lever_arm(row, at, n, first, second):
    """Compute a lever arm from its moments about the three directions; the first is at index ``at``."""
    along_n, along_first = triple(row, at), triple(row, at + AXIS)
    # arm . second = (arm x n) . first, and so on, for a right-handed basis
    a, b, c = dot(along_n, first), -dot(along_n, second), dot(along_first, second)
    return plus(plus(times(a, second), times(b, first)), times(c, n))


@inner(forceinline=True)
def _turned(q, v):
    """Rotate a vector by a quaternion."""
    u = (q[0], q[1], q[2])
    c = cross(u, v)
    return plus(v, times(2.0, plus(times(q[3], c), cross(u, c))))


@inner(forceinline=True)
def mean_turn(h, velocity, i):
    """Return the rotation of body i over ``h`` seconds that its contact points follow [rad]."""
    return times(h, plus(times(0.25, three(velocity[START], i, 3)), times(0.75, three(velocity[FREE], i, 3))))


@inner(error_model="numpy")
def push_in_the_middle(h, world, work):
    """Move impulses of contacts with elements to the contact points in the middle of ``h`` seconds."""
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
    """Return the lever arm of a contact's impulse from the arm at the interval's end.

    It is moved by ``shift`` and rotated back about the normal ``n`` of its lead.
    """
    return plus(plus(arm, shift), cross(_half_spin(n, turn), arm))


@inner(forceinline=True)
def _half_spin(n, turn):
    """Return the rotation about a normal from the end of an interval back to its middle."""
    return times(-0.5 * dot(turn, n), n)


@inner(error_model="numpy")
def middle_shift(n, turn, i, R, world):
    """Compute the shift of body i's contact point from the end of an interval to its middle.

    ``n`` is the contact normal; rotation about it is excluded. ``turn`` is the body's rotation over the
    interval [rad], ``R`` (3, 3) its ``R_world_body`` at the end.

    Returns
    -------
    moves : bool
        Whether the impulses act at the shifted point.
    shift : tuple of 3 floats
        Shift [m].
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
    """Write the derivative of `middle_shift` into ``out`` (3, 5).

    Its columns are tilts of the normal towards ``first`` and ``second``, and the components of ``turn``.
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
    """Return the change of `middle_arm` for given changes of its inputs.

    The body's rotation changes by ``tilt``, its arm by ``darm``, the normal of its lead by ``dn``, and the
    turn by ``dturn``. ``lead`` is the lead's `Geometry`. ``shift`` (3, 6) is the shift and its derivative
    (`write_shift_slopes`). A common rotation of all of these also rotates the arm; the rest is in the body's
    frame.
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
    """Return the arm to the lowest point of body i against ``n`` [m], rotated by ``back`` from ``R``.

    It is the mean of several spheres that are nearly as low, which smooths the bumps of a packing.
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
    """Set the lever arm of a contact's impulses on body i, which then differs from the arm of its speeds."""
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
