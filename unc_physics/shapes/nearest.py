"""Kernels: gap, normal and nearest points of two pieces.

GJK (Gilbert, Johnson, Keerthi 1988) finds nearest points of two convex cores that are apart. Cores that touch
or overlap are first drawn apart along a direction; the direction from one to the other then replaces it until
both agree. Along the result the pieces overlap least, as seen from the direction of the start. The gap along
the direction never decreases on the way, so no second method for depths is needed.

``work`` (12, 3) is scratch: three times four points.
"""

import math

from ..compiler import inner
from ..spatial.rotation import cross
from ..spatial.vectors import dot, minus, plus, times, triple
from .columns import (
    AXES,
    FIRST_FACE,
    FIRST_POINT,
    HALF_SPACE,
    KIND,
    LAST_FACE,
    LATHE,
    OWNER,
    POSITION,
    ROTATION,
    ROUNDING,
)
from .support import gap_along, get, matrix_times, meridian, put, support, transposed_times, unit

#: Distance to which overlapping cores are drawn apart [m]: far enough for the direction between them to be
#: exact to 1e-11, near enough to leave the nearest features as they are.
DRAWN_APART = 1e-4
_FARTHEST_APART = 1e-2  # where this is not enough [m]
_OVERLAPPING = 1e-7  # distance of cores below which the direction between them is uncertain [m]
_ACCURACY = 1e-12  # relative, of squared distances; a direction is then certain to 1e-6 rad
_ROUND_OFF = 1e-17  # of distances [m]
_ITERATIONS = 64  # of GJK; smooth pieces take about 20
_UNPROVEN = 1e-12  # difference of the distance of two points and the gap along their direction [m]
_ROUNDS = 64  # of drawing apart; faces take two
_SAME = 1e-13  # 1 - cosine of directions that agree
_GAINED = 1e-12  # a round that increases the gap by less is the last [m]


@inner
def _triangle_weights(work, i, j, k):
    """Return the weights of a triangle's point that is nearest to the origin (Ericson 2005)."""
    a, b, c = get(work, i), get(work, j), get(work, k)
    ab, ac = minus(b, a), minus(c, a)
    d1, d2 = -dot(ab, a), -dot(ac, a)
    d3, d4 = -dot(ab, b), -dot(ac, b)
    d5, d6 = -dot(ab, c), -dot(ac, c)
    if d1 <= 0.0 and d2 <= 0.0:
        return 1.0, 0.0, 0.0
    if d3 >= 0.0 and d4 <= d3:
        return 0.0, 1.0, 0.0
    if d6 >= 0.0 and d5 <= d6:
        return 0.0, 0.0, 1.0
    vc = d1 * d4 - d3 * d2
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        t = d1 / (d1 - d3)
        return 1.0 - t, t, 0.0
    vb = d5 * d2 - d1 * d6
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        t = d2 / (d2 - d6)
        return 1.0 - t, 0.0, t
    va = d3 * d6 - d5 * d4
    if va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        t = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        return 0.0, 1.0 - t, t
    total = va + vb + vc
    return va / total, vb / total, vc / total


@inner
def _simplex_weights(work, count):
    """Return the weights of a simplex's point nearest to the origin, and whether that is inside."""
    if count == 1:
        return (1.0, 0.0, 0.0, 0.0), False
    if count == 2:
        a = get(work, 0)
        d = minus(get(work, 1), a)
        t = min(1.0, max(0.0, -dot(a, d) / (dot(d, d) + 1e-300)))
        return (1.0 - t, t, 0.0, 0.0), False
    if count == 3:
        u, v, w = _triangle_weights(work, 0, 1, 2)
        return (u, v, w, 0.0), False
    nearest, inside, weights = math.inf, True, (0.0, 0.0, 0.0, 0.0)
    for f in range(4):
        i, j, k, other = (f + 1) % 4, (f + 2) % 4, (f + 3) % 4, f
        a = get(work, i)
        n = cross(minus(get(work, j), a), minus(get(work, k), a))
        if dot(n, a) * dot(n, minus(get(work, other), a)) < 0.0:
            continue  # the origin is on the inner side of this face
        inside = False
        u, v, w = _triangle_weights(work, i, j, k)
        x = plus(plus(times(u, a), times(v, get(work, j))), times(w, get(work, k)))
        if dot(x, x) < nearest:
            nearest = dot(x, x)
            if f == 0:
                weights = (0.0, u, v, w)
            elif f == 1:
                weights = (w, 0.0, u, v)
            elif f == 2:
                weights = (v, w, 0.0, u)
            else:
                weights = (u, v, w, 0.0)
    return weights, inside


@inner
def core_distance(a, b, start, shift, far, base, frames, pieces, rows, work):
    """Return the distance of two cores, the direction from a to b, and the nearest points; b is shifted.

    ``start`` is a first guess of the direction. A distance of more than ``far`` is a lower bound. It is -1
    where the cores overlap or touch.
    """
    v, p, q = start, start, start
    count, last, apart = 0, math.inf, False
    for _ in range(_ITERATIONS):
        s = support(a, v, base, frames, pieces, rows)
        t = plus(support(b, times(-1.0, v), base, frames, pieces, rows), shift)
        w = minus(t, s)
        vv, vw = dot(v, v), dot(v, w)
        apart = apart or (vw > 0.0 and vw * vw > _OVERLAPPING * _OVERLAPPING * vv)
        if count > 0:
            if vw > 0.0 and vw * vw > far * far * vv:
                return vw / math.sqrt(vv), unit(v), s, t
            if vv - vw <= _ACCURACY * vv + _ROUND_OFF * math.sqrt(vv):
                break
            known = False
            for k in range(count):
                e = minus(w, get(work, k))
                known = known or dot(e, e) == 0.0
            if known:
                break
        put(work, count, w)
        put(work, 4 + count, s)
        put(work, 8 + count, t)
        weights, inside = _simplex_weights(work, count + 1)
        if inside:
            if apart:
                break  # round-off of a flat tetrahedron: a plane parts the cores
            return -1.0, start, s, t
        kept, new, s, t = 0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        for k in range(count + 1):
            if weights[k] > 0.0:
                new = plus(new, times(weights[k], get(work, k)))
                s = plus(s, times(weights[k], get(work, 4 + k)))
                t = plus(t, times(weights[k], get(work, 8 + k)))
                put(work, kept, get(work, k))
                put(work, 4 + kept, get(work, 4 + k))
                put(work, 8 + kept, get(work, 8 + k))
                kept += 1
        vv = dot(new, new)
        if vv < _OVERLAPPING * _OVERLAPPING:
            return -1.0, start, s, t
        if vv >= last:
            break  # round-off: the point before is as near
        count, v, p, q, last = kept, new, s, t, vv
    d = math.sqrt(dot(v, v))
    return d, times(1.0 / d, v), p, q


@inner
def best_face_normal(a, b, n, base, frames, pieces, rows):
    """Return the direction of ``n`` and the normals of both pieces' faces along which they overlap least."""
    best, found = gap_along(a, b, n, base, frames, pieces, rows), n
    for p, side in ((a, 1.0), (b, -1.0)):
        piece = pieces[p]
        frame = frames[int(piece[OWNER])]
        for k in range(int(piece[FIRST_FACE]), int(piece[LAST_FACE])):
            e = get(rows, k)
            if piece[KIND] == LATHE:
                along = transposed_times(piece, AXES, transposed_times(frame, ROTATION, times(side, n)))
                x, y, _ = meridian(piece, along)
                e = matrix_times(piece, AXES, (e[0] * x, e[0] * y, e[2]))
            e = times(side, matrix_times(frame, ROTATION, e))
            gap = gap_along(a, b, e, base, frames, pieces, rows)
            if gap > best + _GAINED:
                best, found = gap, e
    return found


@inner
def drawn_apart(a, b, n, far, base, frames, pieces, rows, work):
    """Return gap, normal and nearest points of pieces whose cores touch or overlap, from the direction ``n``.

    The gap is a local maximum over directions: the depth below zero that the pieces have to move apart.
    """
    swept = pieces[a, ROUNDING] + pieces[b, ROUNDING]
    gap = gap_along(a, b, n, base, frames, pieces, rows)
    p, q, apart = n, n, DRAWN_APART
    for _ in range(_ROUNDS):
        if gap > far:
            break
        shift = times(max(apart - gap - swept, 0.0), n)
        d, m, p, q = core_distance(a, b, n, shift, math.inf, base, frames, pieces, rows, work)
        if d < 0.0:
            break
        q = minus(q, shift)
        before, gap = gap, d - dot(shift, m) - swept
        same = dot(m, n) > 1.0 - _SAME
        n = m
        if same or gap - before < _GAINED:
            # round-off stopped some thin simplices early; the direction is more certain farther apart
            if apart >= _FARTHEST_APART or gap - gap_along(a, b, n, base, frames, pieces, rows) < _UNPROVEN:
                break
            apart *= 10.0
    return gap, n, p, q


@inner
def half_space(p, base, frames, pieces, rows):
    """Return a point of a half-space's plane, relative to ``base``, and its normal; world axes."""
    frame, k = frames[int(pieces[p, OWNER])], int(pieces[p, FIRST_FACE])
    point = minus(triple(frame, POSITION), base)
    first = int(pieces[p, FIRST_POINT])
    return (
        plus(point, matrix_times(frame, ROTATION, get(rows, first))),
        matrix_times(frame, ROTATION, get(rows, k)),
    )


@inner
def above_half_space(a, b, base, frames, pieces, rows):
    """Return gap, normal and nearest points of a half-space ``a`` and another piece ``b``."""
    o, n = half_space(a, base, frames, pieces, rows)
    q = minus(support(b, times(-1.0, n), base, frames, pieces, rows), times(pieces[b, ROUNDING], n))
    gap = dot(n, minus(q, o))
    return gap, n, minus(q, times(gap, n)), q


@inner
def nearest(a, b, n, known, far, base, frames, pieces, rows, work):
    """Return the gap of two pieces, the normal from a to b, and their nearest points.

    Parameters
    ----------
    a, b : int
        Rows of the pieces; only ``a`` may be a half-space.
    n : tuple
        Direction from a to b to begin with, a unit vector.
    known : bool
        Whether ``n`` is the normal of a contact of these pieces a short time ago.
    far : float
        Distance beyond which a lower bound suffices [m]; normal and points are then only those of the bound.
    base : tuple
        Point to which the nearest points are relative, world axes.

    Returns
    -------
    gap : float
        Below zero: least depth, as seen from ``n`` [m].
    normal, point_a, point_b : tuple
    """
    if pieces[a, KIND] == HALF_SPACE:
        return above_half_space(a, b, base, frames, pieces, rows)
    swept = pieces[a, ROUNDING] + pieces[b, ROUNDING]
    m, p, q, d = n, n, n, -1.0
    if known:
        gap = gap_along(a, b, n, base, frames, pieces, rows)
        if gap > far:
            return gap, n, p, q
    if not known or gap + swept > DRAWN_APART:
        d, m, p, q = core_distance(a, b, n, (0.0, 0.0, 0.0), far + swept, base, frames, pieces, rows, work)
    if d < 0.0:
        m = n if known else best_face_normal(a, b, n, base, frames, pieces, rows)
    elif d > _FARTHEST_APART or d - swept - gap_along(a, b, m, base, frames, pieces, rows) < _UNPROVEN:
        gap = d - swept
        return gap, m, plus(p, times(pieces[a, ROUNDING], m)), minus(q, times(pieces[b, ROUNDING], m))
    # overlapping, or so near that the direction between points of round surfaces is uncertain
    gap, m, p, q = drawn_apart(a, b, m, far, base, frames, pieces, rows, work)
    return gap, m, plus(p, times(pieces[a, ROUNDING], m)), minus(q, times(pieces[b, ROUNDING], m))
