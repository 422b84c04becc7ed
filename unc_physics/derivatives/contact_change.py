"""Change of a contact's geometry (gap, normal, lever arms) with errors of two poses."""

import math
from typing import NamedTuple

from ..collision.contact_candidates import partner_sphere
from ..collision.contact_row import AXIS, DIRECTION, MOMENT_I, MOMENT_J
from ..collision.element_contacts import in_element
from ..collision.shapes import surface
from ..compiler import inner
from ..dynamics.middle_arms import lever_arm
from ..spatial.layout import EP, ER, EV, EW
from ..spatial.rotation import cross, rotate
from ..spatial.vectors import dot, minus, plus, times, triple, vector

_REACH = 1e-7  # step of finite differences of an element's normal [m]
_ONE_WAY = 1e-6  # relative to the squared trace: a smaller determinant means rolling in one direction only
_SAME_RADIUS = 1e-6  # least relative difference of two radii with distinct directions


class Geometry(NamedTuple):
    """Geometry of a contact in world axes, as tuples without arrays.

    Attributes
    ----------
    n : tuple
        Unit normal towards body i.
    arm_i, arm_j : tuples
        Vectors from the bodies' centres of mass to the contact [m].
    center_i, center_j : tuples
        Vectors to the spheres' centres [m].
    reach : float
        Distance from sphere i's centre to the contact, against the normal [m].
    first, second : tuples
        Tangent unit vectors.
    bend_first, bend_second : tuples
        Changes of the normal with motions of sphere i's centre along these [1/m].
    roll_i, roll_j : tuples
        Excess of the rolling radii over the spheres' radii: entries 11, 12 and 22 of symmetric matrices in
        the tangent directions [m] (`rolling.rolling`).
    flat : bool
        Whether the normal belongs to two faces and rotates with the bodies, instead of depending on sphere
        positions.
    in_middle : bool
        Whether the contact is in the middle of the gap, not on sphere i.
    """

    n: tuple
    arm_i: tuple
    arm_j: tuple
    center_i: tuple
    center_j: tuple
    reach: float
    first: tuple
    second: tuple
    bend_first: tuple
    bend_second: tuple
    roll_i: tuple
    roll_j: tuple
    flat: bool
    in_middle: bool


class Change(NamedTuple):
    """Change of a contact for one column of errors: gap, normal and lever arms."""

    gap: float
    n: tuple
    arm_i: tuple
    arm_j: tuple
    center_i: tuple
    center_j: tuple


@inner(error_model="numpy")
def contact_geometry(row, ids, gap, surface_of, position_i, world, work):
    """Return the geometry of a contact from its row; ``gap`` is the gap when it was found [m].

    ``surface_of`` (12,) describes the surfaces: five entries of `rolling.rolling` for each of body i and body
    j, then 1 if both are flat. The last is the gap of the rolling shape of body i on an element.
    """
    i, j = ids[0], ids[1]
    n, first = triple(row, DIRECTION), triple(row, DIRECTION + AXIS)
    second = triple(row, DIRECTION + 2 * AXIS)
    half = 0.5 * gap if j >= 0 else 0.5 * max(gap, 0.0)
    reach = world.tree.radii[ids[2]] + half
    arm_i = lever_arm(row, MOMENT_I, n, first, second)
    center_i = plus(arm_i, times(reach, n))
    zero, radius = (0.0, 0.0, 0.0), 0.0
    if j >= 0:
        arm_j = lever_arm(row, MOMENT_J, n, first, second)
        radius = world.tree.radii[partner_sphere(ids[3], world.tree.radii)]
        center_j = minus(arm_j, times(gap - half + radius, n))
        apart = reach + gap - half + radius - work.kept_overlap[min(i, j), max(i, j)]
        bend_first, bend_second = times(1.0 / apart, first), times(1.0 / apart, second)
    else:
        arm_j = center_j = zero
        center = plus(center_i, position_i)
        bend_first = element_bend(center, first, -1 - j, world)
        bend_second = element_bend(center, second, -1 - j, world)
    rolls_i = (surface_of[0], surface_of[1], surface_of[2])
    roll_i = _beyond(rolls_i, world.tree.radii[ids[2]])
    shift = _to_middle(center_i, first, second, rolls_i, surface_of[3], surface_of[4])
    if j < 0 and rolls_i[0] + rolls_i[2] > 0.0:  # a contact that sticks at two heights cannot roll
        shift = plus(shift, times(surface_of[11] - gap, n))
    center_i, arm_i = plus(center_i, shift), plus(arm_i, shift)
    rolls_j = (surface_of[5], surface_of[6], surface_of[7])
    roll_j = _beyond(rolls_j, radius)
    if j >= 0:
        shift = _to_middle(center_j, first, second, rolls_j, surface_of[8], surface_of[9])
        center_j, arm_j = plus(center_j, shift), plus(arm_j, shift)
    # with H the change of the normal with the centres, and G the rolling of both bodies: (1 + H G)^-1 H
    a, b = dot(first, bend_first), dot(first, bend_second)
    c, d = dot(second, bend_first), dot(second, bend_second)
    g, h, k = roll_i[0] + roll_j[0], roll_i[1] + roll_j[1], roll_i[2] + roll_j[2]
    p, q, r, s = 1.0 + a * g + b * h, a * h + b * k, c * g + d * h, 1.0 + c * h + d * k
    whole = p * s - q * r
    bend_first = plus(times((s * a - q * c) / whole, first), times((p * c - r * a) / whole, second))
    bend_second = plus(times((s * b - q * d) / whole, first), times((p * d - r * b) / whole, second))
    return Geometry(
        n,
        arm_i,
        arm_j,
        center_i,
        center_j,
        reach,
        first,
        second,
        bend_first,
        bend_second,
        roll_i,
        roll_j,
        surface_of[10] > 0.0,
        gap > 0.0 or j >= 0,
    )


@inner
def rolls_smoothly(surface_of, radius):
    """Return whether body i of a contact rolls on a larger shape than its touching sphere's ``radius`` [m].

    ``surface_of`` is as in `contact_geometry`; `Geometry.roll_i` is then not zero.
    """
    roll = _beyond((surface_of[0], surface_of[1], surface_of[2]), radius)
    return roll[0] + roll[2] > 0.0


@inner(forceinline=True, error_model="numpy")
def _beyond(rolls, r):
    """Return the excess of a body's rolling radii over a sphere's radius, in its rolling directions."""
    a, b, c = rolls
    trace, whole = a + c, a * c - b * b
    if trace <= 0.0:
        return 0.0, 0.0, 0.0
    if whole < _ONE_WAY * trace * trace:
        share = max(1.0 - r / trace, 0.0)
        return share * a, share * b, share * c
    half = math.sqrt(max(0.25 * trace * trace - whole, 0.0))
    smaller, larger = 0.5 * trace - half, 0.5 * trace + half
    if smaller > r:
        return a - r, b, c - r
    if larger <= r or half < _SAME_RADIUS * trace:
        return 0.0, 0.0, 0.0
    share = 0.5 * (larger - r) / half  # share of the projection on the direction of the larger radius
    return share * (a - smaller), share * b, share * (c - smaller)


@inner(forceinline=True, error_model="numpy")
def _to_middle(center, first, second, rolls, a, b):
    """Return the vector from a sphere's centre to the middle of the supports, in rolling directions.

    ``rolls`` holds the rolling radii.
    """
    trace, whole = rolls[0] + rolls[2], rolls[0] * rolls[2] - rolls[1] * rolls[1]
    if trace <= 0.0:
        return 0.0, 0.0, 0.0
    a, b = a - dot(center, first), b - dot(center, second)
    if whole < _ONE_WAY * trace * trace:
        a, b = (rolls[0] * a + rolls[1] * b) / trace, (rolls[1] * a + rolls[2] * b) / trace
    return plus(times(a, first), times(b, second))


@inner
def element_bend(c, direction, e, world):
    """Return the change of element e's normal at a world point that moves along a unit vector [1/m]."""
    s = world.environment
    a = _element_normal(plus(c, times(_REACH, direction)), e, s)
    b = _element_normal(minus(c, times(_REACH, direction)), e, s)
    return times(0.5 / _REACH, minus(a, b))


@inner(forceinline=True)
def _element_normal(c, e, s):
    px, py, pz = in_element(s.position, s.R, e, c[0], c[1], c[2])
    n = surface(s.kind, s.size, e, px, py, pz)[1]
    return rotate(s.R[e], n[0], n[1], n[2])


@inner(forceinline=True)
def contact_change(geometry, errors, first_i, first_j, c):
    """Return the change for column ``c``; the bodies' error blocks begin at ``first_i``, ``first_j``."""
    g = geometry
    dp_i, t_i = vector(errors, first_i + EP, c), vector(errors, first_i + ER, c)
    dp_j, t_j = vector(errors, first_j + EP, c), vector(errors, first_j + ER, c)
    center_i, center_j = cross(t_i, g.center_i), cross(t_j, g.center_j)
    moved = minus(plus(dp_i, center_i), plus(dp_j, center_j))
    gap = dot(g.n, moved)
    tilt_i, tilt_j = cross(t_i, g.n), cross(t_j, g.n)
    if g.flat:
        n = times(0.5, plus(tilt_i, tilt_j))
    else:
        moved = plus(moved, plus(_rolled(g, g.roll_i, tilt_i), _rolled(g, g.roll_j, tilt_j)))
        n = plus(times(dot(g.first, moved), g.bend_first), times(dot(g.second, moved), g.bend_second))
    half = 0.5 * gap if g.in_middle else 0.0
    arm_i = minus(center_i, plus(times(g.reach, n), times(half, g.n)))
    arm_i = plus(arm_i, _rolled(g, g.roll_i, minus(tilt_i, n)))
    return Change(gap, n, arm_i, minus(plus(arm_i, dp_i), dp_j), center_i, center_j)


@inner(forceinline=True)
def _rolled(g, roll, tilt):
    """Return the displacement of the contact on the surface of a body that rolls by a tilt."""
    a, b = dot(g.first, tilt), dot(g.second, tilt)
    return plus(times(roll[0] * a + roll[1] * b, g.first), times(roll[1] * a + roll[2] * b, g.second))


@inner(forceinline=True)
def point_velocity(v, i, arm):
    """Return the velocity of a point of body i from its row of velocities."""
    return plus((v[i, 0], v[i, 1], v[i, 2]), cross((v[i, 3], v[i, 4], v[i, 5]), arm))


@inner(forceinline=True)
def turning(v, i, change):
    """Return the change of velocity at the end of a lever arm that changes."""
    return cross((v[i, 3], v[i, 4], v[i, 5]), change)


@inner(forceinline=True)
def error_velocity(errors, first, arm, c):
    """Return the change of a point's velocity for column ``c``, with a constant lever arm."""
    return plus(vector(errors, first + EV, c), cross(vector(errors, first + EW, c), arm))


@inner(forceinline=True)
def bend_change(n, w, r, dn, dw, dr):
    """Return the change of ``n . (w x (w x r))``."""
    wr, wn, rn = dot(w, r), dot(w, n), dot(r, n)
    return (
        (dot(dw, r) + dot(w, dr)) * wn
        + wr * (dot(dw, n) + dot(w, dn))
        - 2.0 * dot(w, dw) * rn
        - dot(w, w) * (dot(dr, n) + dot(r, dn))
    )
