"""How a body's contacts with fixed things stop its errors, as they stop the body itself.

To first order, errors behave at a contact as the motion does:

* a closing speed that becomes ``-e`` times as large takes its error along; a load leaves none;
* what sticks has no error of the slip; what slides keeps that along the slip, and across it as much as is
  left of the slip;
* a later impact is one of a body that moved on: errors of the gap become errors of all that changed;
* what carries a load has no error of the gap.
"""

import math
from typing import NamedTuple

import numpy as np

from ..compiler import inner, kernel
from ..compiler.arrays import booleans, empty, zeros
from ..physics.everyday.columns import BODY_A, BODY_B, GAP0, IMPULSE, MU0, NORMAL, POINT, SLOW
from ..spatial.layout import EP, ER, ERROR, EV, EW, P, V, W
from ..spatial.rotation import cross, rotate, rotate_back, tangents
from ..spatial.vectors import dot, minus, plus, three, times

_DEPENDENT = 0.01  # share of a direction's square that others do not have: nearer points tell no rotation
_STICKS = 0.99  # share of the limit of friction; over the parts of a step the direction may turn
_STILL = 1e-6  # m/s, slip that has no direction
_FREE = 6  # directions of a rigid body's motion


class Directions(NamedTuple):
    """Directions of a body's motion that contacts change, up to six, orthogonal in the metric of its mass.

    Attributes
    ----------
    row : (6, 6) array
        Takes velocities to the speed along each.
    kick : (6, 6) array
        Change of velocities by a unit impulse along it.
    drag : (6, 6) array
        Change of velocities by friction beside such an impulse.
    left : (6,) array
        What is left of the speed, by the speed before.
    late : (6,) array
        Change of the speed by an error of the gap [1/s].
    hits, slides : (6,) bool arrays
        Whether it is an impact, and whether its friction is at the limit.
    pose, velocity, gap : (6,) arrays
        Room for errors of the body, and for those of gaps.
    """

    row: np.ndarray
    kick: np.ndarray
    drag: np.ndarray
    left: np.ndarray
    late: np.ndarray
    hits: np.ndarray
    slides: np.ndarray
    pose: np.ndarray
    velocity: np.ndarray
    gap: np.ndarray


@kernel
def no_directions():
    """Return room for `Directions`, and for one that turns out to depend on others."""
    n, m = _FREE + 1, _FREE
    return Directions(
        empty((n, m)),
        empty((n, m)),
        empty((n, m)),
        zeros(n),
        zeros(n),
        booleans(n),
        booleans(n),
        empty(m),
        empty(m),
        empty(m),
    )


@inner
def arm_at(k, i, side, x, contact):
    """Return the point of row k on body i, from its centre of mass: ``side`` gaps from the middle along n."""
    c = plus(three(contact, k, POINT), times(side * contact[k, GAP0], three(contact, k, NORMAL)))
    return minus(c, three(x, i, P))


@inner
def _sum(a, b, k):
    """Return the product of rows k of two arrays (n, 6), along the second axis."""
    total = 0.0
    for c in range(_FREE):
        total += a[c] * b[k, c]
    return total


@inner
def _write_kick(out, k, f, arm, mass, inverse):
    """Write the change of a body's velocities by an impulse f at a point."""
    t = cross(arm, f)
    w = rotate(inverse, t[0], t[1], t[2])
    for c in range(3):
        out[k, c], out[k, 3 + c] = mass * f[c], w[c]


@inner(error_model="numpy")
def _add(d, r, n, drag, arm, mass, inverse):
    """Add what is new of the direction n at a point, beside ``r`` others; return how many there are now."""
    j = cross(arm, n)
    for c in range(3):
        d.row[r, c], d.row[r, 3 + c] = n[c], j[c]
    _write_kick(d.kick, r, n, arm, mass, inverse)
    _write_kick(d.drag, r, drag, arm, mass, inverse)
    square = _sum(d.row[r], d.kick, r)
    for k in range(r):
        share = _sum(d.row[r], d.kick, k)
        for a in (d.row, d.kick, d.drag):
            for c in range(_FREE):
                a[r, c] -= share * a[k, c]
    own = _sum(d.row[r], d.kick, r)
    if not own > _DEPENDENT * square:
        return r
    for a in (d.row, d.kick, d.drag):
        for c in range(_FREE):
            a[r, c] /= math.sqrt(own)
    return r + 1


@inner(error_model="numpy")
def _time_since(i, before, after, contact, count, world):
    """Return how long before the end of the step contacts change velocities; the largest impact decides.

    It ended with the gap that it has left since. Without impacts the middle of the step counts.
    """
    most, rest = 0.0, 0.5 * world.length
    for k in range(count):
        n, load = three(contact, k, NORMAL), _load(i, k, contact, world)
        arm = arm_at(k, i, 0.5, after, contact)
        if load > most and dot(n, plus(three(before, i, V), cross(three(before, i, W), arm))) < -SLOW:
            most, rest = load, 0.5 * world.length
            gap, speed = contact[k, GAP0], dot(n, plus(three(after, i, V), cross(three(after, i, W), arm)))
            if gap > 0.0 and speed > 0.0:
                rest = min(gap / speed, world.length)
    return rest


@inner
def _load(i, k, contact, world):
    """Return the normal impulse of row k if it is one of body i with a fixed thing, else 0."""
    if contact[k, BODY_B] != i or world.bodies.moving[int(contact[k, BODY_A])]:
        return 0.0
    return max(dot(three(contact, k, NORMAL), three(contact, k, IMPULSE)), 0.0)


@inner(noinline=True, error_model="numpy")
def hold(i, before, after, contact, count, world, blocks):
    """Let contacts of body i with fixed things stop its errors.

    Parameters
    ----------
    i : int
    before, after : (B, 13) arrays
        States.
    contact : (K, REMEMBERED) array
        The step's contacts, ``count`` of them.
    world : Drifting
    blocks : Blocks
        Changed in place.
    """
    mass, inverse = world.bodies.inverse_mass[i], blocks.inverse[i]
    g = world.gravity[0], world.gravity[1], world.gravity[2]
    start, w0, w1 = three(before, i, V), three(before, i, W), three(after, i, W)
    rest = _time_since(i, before, after, contact, count, world)
    v0 = plus(start, times(world.length - rest, g))
    v1 = minus(three(after, i, V), times(rest, g))
    d, r, normals = blocks.directions, 0, 0
    for what in range(3):  # loads, impacts, then friction
        for k in range(count):
            n, load = three(contact, k, NORMAL), _load(i, k, contact, world)
            if load <= 0.0 or r == _FREE:
                continue
            arm = arm_at(k, i, 0.5, after, contact)
            f = times(1.0 / load, three(contact, k, IMPULSE))
            f = minus(f, n)  # friction, by the normal impulse
            slides = dot(f, f) >= (_STICKS * contact[k, MU0]) ** 2
            hits = dot(n, plus(start, cross(w0, arm))) < -SLOW
            s0, s1 = plus(v0, cross(w0, arm)), plus(v1, cross(w1, arm))
            if what < 2:
                if hits == (what == 1):
                    d.hits[r], d.slides[r], d.left[r], d.late[r] = hits, slides, 0.0, 0.0
                    closing, parting = dot(n, s0), dot(n, s1)
                    if hits and parting > 0.0 and closing < 0.0:
                        d.left[r] = max(parting / closing, -1.0)
                        d.late[r] = (1.0 - d.left[r]) * dot(n, g) / min(closing, -SLOW)
                    r = normals = _add(d, r, n, f, arm, mass, inverse)
                continue
            d.hits[r] = d.slides[r] = False
            d.left[r] = d.late[r] = 0.0
            nothing = 0.0, 0.0, 0.0
            if not slides:
                t, u = tangents(n)
                r = _add(d, r, t, nothing, arm, mass, inverse)
                if r < _FREE:
                    d.hits[r] = d.slides[r] = False
                    d.left[r] = d.late[r] = 0.0
                    r = _add(d, r, u, nothing, arm, mass, inverse)
                continue
            s0, s1 = minus(s0, times(dot(s0, n), n)), minus(s1, times(dot(s1, n), n))
            size = math.sqrt(dot(s0, s0))
            if size > _STILL:  # across the slip
                d.left[r] = min(math.sqrt(dot(s1, s1)) / size, 1.0)
                r = _add(d, r, times(1.0 / size, cross(n, s0)), nothing, arm, mass, inverse)
    if normals > 0:
        _apply(blocks.step, blocks.R[i], rest, d, normals, r)


@inner
def _apply(F, R, rest, d, normals, count):
    """Let directions change a derivative F (12, 12): the pose the first ones, the velocities all.

    They do so ``rest`` before the end of the step, from where it goes on with the velocities that are left.
    """
    x, y, gap = d.pose, d.velocity, d.gap
    for c in range(ERROR):
        turn = rotate(R, F[ER, c], F[ER + 1, c], F[ER + 2, c])
        for m in range(3):
            x[m], x[3 + m] = F[EP + m, c], turn[m]
            y[m], y[3 + m] = F[EV + m, c], F[EW + m, c]
        for m in range(_FREE):
            x[m] -= rest * y[m]
        for k in range(normals):
            gap[k] = _sum(x, d.row, k)
        for k in range(count):
            less = (d.left[k] - 1.0) * _sum(y, d.row, k)
            if k < normals:
                less += d.late[k] * gap[k]
            for m in range(_FREE):
                y[m] += less * (d.kick[k, m] + (d.drag[k, m] if d.slides[k] else 0.0))
        for k in range(normals):
            less = (d.left[k] - 1.0) * gap[k]
            for m in range(_FREE):
                x[m] += less * (d.kick[k, m] + (d.drag[k, m] if d.hits[k] else 0.0))
        for m in range(_FREE):
            x[m] += rest * y[m]
        turn = rotate_back(R, x[3], x[4], x[5])
        for m in range(3):
            F[EP + m, c], F[ER + m, c] = x[m], turn[m]
            F[EV + m, c], F[EW + m, c] = y[m], y[3 + m]
