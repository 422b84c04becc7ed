"""How errors of two poses change the geometry of a contact between them: gap, normal, lever arms."""

import math
from typing import NamedTuple

import numpy as np

from .compiled import inner
from .element_contacts import in_element
from .implicit_workspace import DIRECTION, MOMENT_I, MOMENT_J
from .layout import EP, ER, EV, EW
from .rotation import cross, rotate, rotate_back
from .shapes import surface
from .vectors import dot, minus, plus, times, vector

_REACH = 1e-7  # over which an element's normal is differentiated [m]
#: Tilts over which a body is thought to roll [rad], and how many to each side.
_LEAST_TILT, _MOST_TILT, _TILTS = 0.05, 0.8, 24
_JUMP = 0.15  # of the radius by which something rolls: how far its support may jump
_ONE_WAY = 1e-6  # of the squared trace: a determinant below is that of rolling in one direction alone
_ON_HULL = 0.02  # of the body's radius: how far from its hull what rolls may be


def _tilts():
    room = np.zeros((2 * _TILTS, 4))
    angle = np.linspace(_LEAST_TILT, _MOST_TILT, _TILTS)
    room[:, 0], room[:, 1] = np.cos(np.tile(angle, 2)), np.concatenate([np.sin(angle), -np.sin(angle)])
    return room


#: Room for `rolling`, with its tilts.
TILTS = _tilts()


class Geometry(NamedTuple):
    """A contact, all in world axes: as tuples, without arrays.

    Attributes
    ----------
    n : tuple
        Unit normal towards body i.
    arm_i, arm_j : tuples
        From the bodies' centres of mass to the contact [m].
    center_i, center_j : tuples
        To the spheres' centres [m].
    reach : float
        From sphere i's centre to the contact, against the normal [m].
    first, second : tuples
        Unit vectors across the normal.
    bend_first, bend_second : tuples
        Changes of the normal when sphere i's centre moves along these [1/m].
    roll_i, roll_j : tuples
        By how much larger than their spheres' the radii are by which the bodies roll: entries of symmetric
        matrices over the two directions across the normal, 11, 12 and 22 [m] (`rolling`).
    flat : bool
        Whether the normal is that of two faces, which turns with the bodies, instead of with where the
        spheres are.
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


class Change(NamedTuple):
    """What one column of errors changes of a contact: its gap, normal and lever arms."""

    gap: float
    n: tuple
    arm_i: tuple
    arm_j: tuple
    center_i: tuple
    center_j: tuple


@inner(forceinline=True)
def _triple(row, at):
    return row[at], row[at + 1], row[at + 2]


@inner(forceinline=True)
def _arm(row, at, n, first, second):
    """A lever arm from its moments about the three directions, the first of them being at ``at``."""
    along_n, along_first = _triple(row, at), _triple(row, at + 3)
    # arm . second = (arm x n) . first, and so on, for a right-handed basis
    a, b, c = dot(along_n, first), -dot(along_n, second), dot(along_first, second)
    return plus(plus(times(a, second), times(b, first)), times(c, n))


@inner(error_model="numpy")
def contact_geometry(row, ids, gap, surface_of, position_i, world, work):
    """The geometry of a contact by its row of numbers; ``gap`` is that at which it was found [m].

    ``surface_of`` (11,) is what is known of the surfaces that the spheres make: `rolling`'s of body i and of
    body j, and 1 where both are flat.
    """
    i, j = ids[0], ids[1]
    n, first, second = _triple(row, DIRECTION), _triple(row, DIRECTION + 3), _triple(row, DIRECTION + 6)
    reach = world.tree.radii[ids[2]] + 0.5 * gap
    arm_i = _arm(row, MOMENT_I, n, first, second)
    center_i = plus(arm_i, times(reach, n))
    zero, radius = (0.0, 0.0, 0.0), 0.0
    if j >= 0:
        arm_j = _arm(row, MOMENT_J, n, first, second)
        radius = world.tree.radii[ids[3]]
        center_j = minus(arm_j, times(0.5 * gap + radius, n))
        apart = reach + 0.5 * gap + radius - work.kept_overlap[min(i, j), max(i, j)]
        bend_first, bend_second = times(1.0 / apart, first), times(1.0 / apart, second)
    else:
        arm_j = center_j = zero
        center = plus(center_i, position_i)
        bend_first = element_bend(center, first, -1 - j, world)
        bend_second = element_bend(center, second, -1 - j, world)
    rolls_i = (surface_of[0], surface_of[1], surface_of[2])
    roll_i = _beyond(rolls_i, world.tree.radii[ids[2]])
    shift = _to_middle(center_i, first, second, rolls_i, surface_of[3], surface_of[4])
    center_i, arm_i = plus(center_i, shift), plus(arm_i, shift)
    rolls_j = (surface_of[5], surface_of[6], surface_of[7])
    roll_j = _beyond(rolls_j, radius)
    if j >= 0:
        shift = _to_middle(center_j, first, second, rolls_j, surface_of[8], surface_of[9])
        center_j, arm_j = plus(center_j, shift), plus(arm_j, shift)
    # with H what the spheres' centres make of the normal, and G both bodies' rolling: (1 + H G)^-1 H
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
    )


@inner(forceinline=True, error_model="numpy")
def _beyond(rolls, r):
    """By how much larger than a sphere's the radii are by which a body rolls, in the directions in which it
    does.
    """
    a, b, c = rolls
    trace, whole = a + c, a * c - b * b
    if trace <= 0.0:
        return 0.0, 0.0, 0.0
    if whole < _ONE_WAY * trace * trace:
        share = max(1.0 - r / trace, 0.0)
        return share * a, share * b, share * c
    smaller = 0.5 * trace - math.sqrt(max(0.25 * trace * trace - whole, 0.0))
    if smaller <= r:
        return 0.0, 0.0, 0.0
    return a - r, b, c - r


@inner(forceinline=True, error_model="numpy")
def _to_middle(center, first, second, rolls, a, b):
    """From a sphere's centre to the middle of the supports on both sides, in directions in which the body
    rolls over them; ``rolls`` has the radii by which it does.
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
    """Change of element e's normal at a point of the world, when that moves along a unit vector [1/m]."""
    s = world.surroundings
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
    """What column ``c`` of the errors changes; the bodies' blocks begin at rows ``first_i``, ``first_j``."""
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
    arm_i = minus(center_i, plus(times(g.reach, n), times(0.5 * gap, g.n)))
    arm_i = plus(arm_i, _rolled(g, g.roll_i, minus(tilt_i, n)))
    return Change(gap, n, arm_i, minus(plus(arm_i, dp_i), dp_j), center_i, center_j)


@inner(forceinline=True)
def _rolled(g, roll, tilt):
    """How far a body that rolls by a tilt moves the contact over its surface."""
    a, b = dot(g.first, tilt), dot(g.second, tilt)
    return plus(times(roll[0] * a + roll[1] * b, g.first), times(roll[1] * a + roll[2] * b, g.second))


@inner(error_model="numpy")
def rolling(n, first, second, i, sphere, R, world, room, out):
    """How the support of body i moves over its surface when it rolls, from its packing's hull.

    A packing is rough: what rolls goes from sphere to sphere, and its derivative between two of them is not
    that of the shape which they stand for. The support moves on with the tilt where the shape is round, by
    the difference of its radius and the sphere's; across a flat face it jumps at once and then stays, as at
    an edge, which are what they look like from nearby. So what counts is the slope of a line through the
    supports at several tilts, which need not go through zero.

    Parameters
    ----------
    n, first, second : tuples of 3 floats
        Direction away from the contact into the body, and two across it, world frame.
    i, sphere : int
        The body, and its sphere that touches; one that is not on the hull's side of the contact does not
        roll.
    R : (3, 3) array
        ``R_world_body``.
    world : World
    room : array
        A copy of `TILTS`.
    out : (5,) array
        Entries 11, 12 and 22 of a symmetric matrix, the radii by which it rolls; and where the middle of the
        supports is, in both directions from the centre of mass [m].
    """
    for k in range(5):
        out[k] = 0.0
    hull, tree = world.implicit.hull, world.tree
    low, high = world.implicit.hull_range[i, 0], world.implicit.hull_range[i, 1]
    m = rotate_back(R, n[0], n[1], n[2])
    a = rotate_back(R, first[0], first[1], first[2])
    b = rotate_back(R, second[0], second[1], second[2])
    own = tree.centers[sphere, 0] * m[0] + tree.centers[sphere, 1] * m[1] + tree.centers[sphere, 2] * m[2]
    own -= tree.radii[sphere]
    least = math.inf
    for k in range(low, high):
        least = min(least, hull[0, k] * m[0] + hull[1, k] * m[1] + hull[2, k] * m[2] - hull[3, k])
    if own - least > _ON_HULL * world.bodies.radius[i]:
        return
    count = len(room) // 2
    mean = square = 0.0
    for k in range(count):
        mean += room[k, 1] / count
    for k in range(count):
        square += (room[k, 1] - mean) ** 2
    # slopes and means of the supports' way along both directions, for tilts in both
    s11 = s12 = s21 = s22 = j11 = j12 = j21 = j22 = 0.0
    for way in range(2):
        e = a if way == 0 else b
        for t in range(2 * count):
            room[t, 2] = math.inf
        for k in range(low, high):
            x, y, z, r = hull[0, k], hull[1, k], hull[2, k], hull[3, k]
            p, q = m[0] * x + m[1] * y + m[2] * z, e[0] * x + e[1] * y + e[2] * z
            for t in range(2 * count):
                depth = room[t, 0] * p + room[t, 1] * q - r
                if depth < room[t, 2]:
                    room[t, 2], room[t, 3] = depth, float(k)
        for t in range(count):
            u = v = 0.0
            for side in range(2):
                k = int(room[t + side * count, 3])
                sign, reach = (0.5 if side else -0.5), hull[3, k] * room[t + side * count, 1]
                x, y, z = hull[0, k], hull[1, k], hull[2, k]
                c = a[0] * x + a[1] * y + a[2] * z - (reach if way == 0 else 0.0)
                d = b[0] * x + b[1] * y + b[2] * z - (reach if way == 1 else 0.0)
                u, v = u + sign * c, v + sign * d
                out[3] += 0.25 / count * c
                out[4] += 0.25 / count * d
            share = (room[t, 1] - mean) / square
            if way == 0:
                s11, s21, j11, j21 = s11 + share * u, s21 + share * v, j11 + u / count, j21 + v / count
            else:
                s12, s22, j12, j22 = s12 + share * u, s22 + share * v, j12 + u / count, j22 + v / count
    # what the lines through them have at no tilt are jumps: along the longest one, and across it
    j11, j12, j21, j22 = j11 - mean * s11, j12 - mean * s12, j21 - mean * s21, j22 - mean * s22
    p, q, r = j11 * j11 + j12 * j12, j11 * j21 + j12 * j22, j21 * j21 + j22 * j22
    half, spread = 0.5 * (p + r), math.sqrt(0.25 * (p - r) ** 2 + q * q)
    angle = 0.5 * math.atan2(2.0 * q, p - r)
    for k in range(2):
        jump = math.sqrt(max(half + spread if k == 0 else half - spread, 0.0))
        x, y = (math.cos(angle), math.sin(angle)) if k == 0 else (-math.sin(angle), math.cos(angle))
        slope = s11 * x * x + (s12 + s21) * x * y + s22 * y * y
        if slope > 0.0 and jump < _JUMP * slope:
            out[0] += slope * x * x
            out[1] += slope * x * y
            out[2] += slope * y * y


@inner(forceinline=True)
def point_velocity(v, i, arm):
    """Velocity of a point of body i from its row of velocities."""
    return plus((v[i, 0], v[i, 1], v[i, 2]), cross((v[i, 3], v[i, 4], v[i, 5]), arm))


@inner(forceinline=True)
def turning(v, i, change):
    """How a changed lever arm changes the velocity of its end."""
    return cross((v[i, 3], v[i, 4], v[i, 5]), change)


@inner(forceinline=True)
def error_velocity(errors, first, arm, c):
    """How column ``c`` changes the velocity of a point, its lever arm held."""
    return plus(vector(errors, first + EV, c), cross(vector(errors, first + EW, c), arm))


@inner(forceinline=True)
def bend_change(n, w, r, dn, dw, dr):
    """Change of ``n . (w x (w x r))``."""
    wr, wn, rn = dot(w, r), dot(w, n), dot(r, n)
    return (
        (dot(dw, r) + dot(w, dr)) * wn
        + wr * (dot(dw, n) + dot(w, dn))
        - 2.0 * dot(w, dw) * rn
        - dot(w, w) * (dot(dr, n) + dot(r, dn))
    )
