"""Lever arms of contacts of bodies that roll on elements, without the bumps of their packings.

A body is lowest against a normal at its support. A smooth minimum over the hull's spheres gives the support's
height and place. Impulses of a rolling body act where they do the work of the change of this height over the
interval::

    size * place = height before - height after

``size`` is the rotation across the normal, and ``place`` the coordinate of the lever arm along the rolling
direction. The work of many steps then adds up to that of the first and last height, so bumps neither drive
nor brake the body. Damping uses the speed of the support at the interval's end, not of the sphere that
touches.
"""

import math

import numpy as np

from ..collision.contact_row import (
    ANCHOR,
    AXIS,
    COMPLIANCE,
    IN_MIDDLE,
    INVERSE_MASS_I,
    LEAD,
    LEAST,
    MOMENT_I,
    PLACES,
    ROLL_RADIUS,
    ROLLING,
    SLIP_COMPLIANCE,
    TURN_I,
)
from ..collision.contact_simd import plane_mask
from ..collision.implicit_workspace import CONTACTS, FREE, START
from ..compiler import inner
from ..compiler.simd import LANES, lowest_bit
from ..spatial.rotation import cross, exp, rotate, rotate_back
from ..spatial.vectors import dot, minus, plus, three, times, triple
from .implicit_solver import next_patch, rolling_depth

#: Smallest rotation in a step that matters [rad]. Then the largest distance between the places of the
#: impulse and of the support, relative to the motion of the body's farthest points; larger ones jump between
#: edges of a face.
_TURNED, _FARTHEST = 1e-3, 5.0
#: Height over which the minimum over spheres is smoothed, relative to the body's radius, and number of such
#: heights that count. Then the largest distance of such spheres from the lowest one along the rolling
#: direction, relative to the body's radius: round bodies have none beyond, and edges of blocks are farther
#: apart.
_SMOOTHING, _CUT, _WIDTH = 4e-3, 5.0, 0.2
#: Height by which spheres count as higher that are one radius away along the axis of rotation, relative to
#: the body's radius.
_SLOPE = 0.05
#: Largest distance of contacts along the axis that share their places, relative to the body's radius.
_BESIDE = 0.1
#: Least normal velocity per impulse at a moved contact, relative to that of a body without rotation.
_LEAST_COMPLIANCE = 0.7


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
def push_in_the_middle(h, fall, world, work):
    """Move impulses of contacts that roll on elements to their places in the middle of ``h`` seconds.

    ``fall`` is as in `rolling_depth`.
    """
    rows, ids, m = work.rows, work.ids, work.counts[CONTACTS]
    first = 0
    while first < m:
        last, lead = next_patch(rows, first, m)
        for c in range(first, last):
            rows[c, IN_MIDDLE], rows[c, ANCHOR] = 0.0, -1.0
        i = ids[lead, 0]
        n, turn = triple(rows[lead], 0), mean_turn(h, work.velocity, i)
        if ids[lead, 1] < 0 and _turns_across(n, times(world.dt / h, turn)):
            along, depth = rolling_direction(n, turn), rolling_depth(fall, rows[lead, ROLL_RADIUS])
            rate = dot(three(work.velocity[FREE], i, 3), cross(along, n))
            farthest = min(_FARTHEST * dot(turn, cross(n, along)), _WIDTH) * world.bodies.radius[i]
            for c in range(first, last):
                if rows[c, LEAD] != lead or ids[c, 3] > 0:  # an edge of the element does not roll off spheres
                    continue
                _find_places(c, first, n, turn, i, world, work)
                least, places = rows[c, LEAST], triple(rows[c], PLACES)
                axes = triple(rows[c], 0), triple(rows[c], AXIS), triple(rows[c], 2 * AXIS)
                arm = lever_arm(rows[c], MOMENT_I, *axes)
                push_arm = placed_arm(spun_arm(arm, n, turn), places, n, along)
                moves = abs(least - dot(n, arm)) < depth and abs(places[0] - places[2]) < farthest
                moves = moves and abs(dot(arm, along) - places[2]) < _WIDTH * world.bodies.radius[i]
                if moves and _yields(rows[c], push_arm, work.inverse_inertia[i]):
                    rows[c, ROLLING] = rate * (dot(arm, along) - places[2])
                    _push_at(rows[c], push_arm, axes, work.inverse_inertia[i])
                    rows[c, IN_MIDDLE] = 1.0
        first = last


@inner(forceinline=True)
def _turns_across(n, turn):
    """Return whether the rotation ``turn`` in a step across a normal is large enough to matter."""
    across = minus(turn, times(dot(turn, n), n))
    return dot(across, across) > _TURNED * _TURNED


@inner(forceinline=True)
def rolling_direction(n, turn):
    """Return the unit vector along which a rotation ``turn`` rolls a body on a surface of normal ``n``."""
    along = cross(turn, n)
    return times(1.0 / math.sqrt(dot(along, along)), along)


@inner(forceinline=True)
def spun_arm(arm, n, turn):
    """Return a lever arm, rotated back about the normal ``n`` of its lead to the middle of the interval."""
    return plus(arm, cross(_half_spin(n, turn), arm))


@inner(forceinline=True)
def placed_arm(arm, places, n, along):
    """Return a lever arm whose part along the rolling direction is ``places[0]``.

    The part along ``n`` grows by ``places[1]`` (`rolling_places`).
    """
    return plus(arm, plus(times(places[0] - dot(arm, along), along), times(places[1], n)))


@inner(forceinline=True)
def _half_spin(n, turn):
    """Return the rotation about a normal from the end of an interval back to its middle."""
    return times(-0.5 * dot(turn, n), n)


@inner(error_model="numpy")
def _find_places(c, first, n, turn, i, world, work):
    """Write the places of contact ``c``, or copy those of a contact from ``first`` on that is at its side."""
    rows, ids, centers = work.rows, work.ids, world.tree.centers
    axis, s = _body_axis(turn, work.R[i]), ids[c, 2]
    for k in range(first, c):
        if rows[k, LEAD] == rows[c, LEAD] and rows[k, ANCHOR] == ids[k, 2]:
            t = ids[k, 2]
            apart = axis[0] * (centers[s, 0] - centers[t, 0]) + axis[1] * (centers[s, 1] - centers[t, 1])
            apart += axis[2] * (centers[s, 2] - centers[t, 2])
            if abs(apart) < _BESIDE * world.bodies.radius[i]:
                for m in (PLACES, PLACES + 1, PLACES + 2, ANCHOR, LEAST):
                    rows[c, m] = rows[k, m]
                return
    rows[c, ANCHOR] = s
    rows[c, LEAST], places = rolling_places(n, turn, s, i, work.R[i], world)
    for k in range(3):
        rows[c, PLACES + k] = places[k]


@inner(forceinline=True)
def _body_axis(turn, R):
    """Return the unit axis of a rotation in the body's frame."""
    axis = times(1.0 / math.sqrt(dot(turn, turn)), turn)
    return rotate_back(R, axis[0], axis[1], axis[2])


@inner(error_model="numpy")
def rolling_places(n, turn, sphere, i, R, world):
    """Compute the places of impulses near a sphere of body i and of its support, as it rolls.

    ``n`` is the contact normal, ``turn`` the body's rotation over the interval [rad], ``R`` (3, 3) its
    ``R_world_body`` at the end.

    Returns
    -------
    least : float
        Least height of its spheres there, relative to the centre of mass [m].
    places : tuple of 3 floats
        Place of the impulses along the rolling direction, their distance above the contact of the end, and
        place of the support at the end [m].
    """
    across = minus(turn, times(dot(turn, n), n))
    size = math.sqrt(dot(across, across))
    along, axis = times(1.0 / size, cross(across, n)), _body_axis(turn, R)
    least, end, support = _support(n, (0.0, 0.0, 0.0), along, axis, sphere, i, R, world)
    _, start, _ = _support(n, times(-1.0, turn), along, axis, sphere, i, R, world)
    return least, ((start - end) / size, 0.5 * (start - end), support)


@inner(error_model="numpy")
def _support(n, back, along, axis, sphere, i, R, world):
    """Return where body i, rotated by ``back`` from ``R``, is lowest against ``n`` near a sphere.

    Spheres count as higher, the farther they are from it along ``axis`` (body frame).

    Returns
    -------
    least, smooth : float
        Least height of its spheres relative to the centre of mass, and smooth minimum of these heights [m].
    place : float
        Coordinate along ``along`` of the point where the smooth minimum is [m].
    """
    hull = world.implicit.hull
    low, high = world.implicit.hull_range[i, 0], world.implicit.hull_range[i, 1]
    q = exp(-back[0], -back[1], -back[2])
    up, ahead = _turned(q, n), _turned(q, along)
    x, y, z = rotate_back(R, up[0], up[1], up[2])
    ax, ay, az = rotate_back(R, ahead[0], ahead[1], ahead[2])
    radius = world.bodies.radius[i]
    smoothing, slope = _SMOOTHING * radius, _SLOPE / radius
    center = world.tree.centers[sphere]
    offset = axis[0] * center[0] + axis[1] * center[1] + axis[2] * center[2]
    plane, least, lowest = (x, y, z, 0.0), np.inf, low
    for first in range(low, high, LANES):  # heights without the slope are lower, and tested eight at once
        mask = lower_spheres(hull, first, high, plane, least)
        while mask != 0:
            k = first + lowest_bit(mask)
            mask &= mask - np.uint64(1)
            apart = axis[0] * hull[0, k] + axis[1] * hull[1, k] + axis[2] * hull[2, k] - offset
            height = x * hull[0, k] + y * hull[1, k] + z * hull[2, k] - hull[3, k] + slope * apart * apart
            if height < least:
                least, lowest = height, k
    middle = ax * hull[0, lowest] + ay * hull[1, lowest] + az * hull[2, lowest]
    total = place = 0.0
    for first in range(low, high, LANES):
        mask = lower_spheres(hull, first, high, plane, least + _CUT * smoothing)
        while mask != 0:
            k = first + lowest_bit(mask)
            mask &= mask - np.uint64(1)
            apart = axis[0] * hull[0, k] + axis[1] * hull[1, k] + axis[2] * hull[2, k] - offset
            height = x * hull[0, k] + y * hull[1, k] + z * hull[2, k] - hull[3, k] + slope * apart * apart
            if height - least < _CUT * smoothing:
                at = ax * hull[0, k] + ay * hull[1, k] + az * hull[2, k]
                if abs(at - middle) < _WIDTH * radius:
                    share = math.exp((least - height) / smoothing)
                    total += share
                    place += share * at
    return least, least - smoothing * math.log(total), place / total


@inner(forceinline=True)
def lower_spheres(hull, first, end, plane, limit):
    """Return a mask of the spheres from ``first`` on, eight before ``end``, that are below a height [m]."""
    mask = plane_mask(hull, first, plane, plane, limit)
    if end - first < LANES:
        mask &= (np.uint64(1) << np.uint64(end - first)) - np.uint64(1)
    return mask


@inner(forceinline=True)
def _yields(row, arm, inverse_inertia):
    """Return whether a normal impulse at a lever arm moves the contact enough for a stable solution."""
    moment = cross(arm, triple(row, 0))
    turn = rotate(inverse_inertia, moment[0], moment[1], moment[2])
    return dot(triple(row, MOMENT_I), turn) > (_LEAST_COMPLIANCE - 1.0) * row[INVERSE_MASS_I]


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
