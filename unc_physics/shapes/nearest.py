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
    AZIMUTH,
    COS_HALF,
    FIRST_FACE,
    FIRST_POINT,
    HALF_SPACE,
    KIND,
    LAST_FACE,
    LATHE,
    ORIGIN,
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
_REFINED = 1e-2  # relative error of squared distances from which on the features may be the right ones
_AGAIN = 1e-2  # after a failure: when the error is this share of what it was
_NEWTON_STEPS = 8
_CONVERGED = 1e-20  # squared step [rad^2]; the next one, which is not made, is its square
_ON_AXIS = 1e-7  # share of a direction across an axis below which its azimuth is uncertain
_SAME_POINT = 1e-18  # squared distance of points of the same features [m^2]
_ROUND_OFF_OF_WEIGHTS = 1e-9
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
def _rim(p, d, base, frames, pieces):
    """Return how points of piece ``p`` move with the direction ``d`` of which they are the farthest ones.

    Points of a lathe are on its rims, at the azimuth of ``d``. The result is whether they move, a point of
    the axis relative to ``base``, the axis, the unit vector along the azimuth, and the share of ``d`` along
    it; world axes.
    """
    piece = pieces[p]
    o = (0.0, 0.0, 0.0)
    if piece[KIND] != LATHE:
        return False, o, o, o, 1.0
    frame = frames[int(piece[OWNER])]
    axis = matrix_times(frame, ROTATION, (piece[AXES + 2], piece[AXES + 5], piece[AXES + 8]))
    e = minus(d, times(dot(d, axis), axis))
    s = math.sqrt(dot(e, e))
    if s < _ON_AXIS:
        return False, o, o, o, 1.0
    e = times(1.0 / s, e)
    if piece[COS_HALF] > -1.0:
        middle = (piece[AZIMUTH], piece[AZIMUTH + 1], 0.0)
        middle = matrix_times(frame, ROTATION, matrix_times(piece, AXES, middle))
        if dot(e, middle) < piece[COS_HALF]:
            return False, o, o, o, 1.0  # at the sector's end
    start = minus(triple(frame, POSITION), base)
    return True, plus(start, matrix_times(frame, ROTATION, triple(piece, ORIGIN))), axis, e, s


@inner
def _turned(x, moves, o, axis, e):
    """Return a point turned about an axis to the azimuth ``e``, and its radius; zero if it does not move."""
    if not moves:
        return x, 0.0
    x = minus(x, o)
    z = times(dot(x, axis), axis)
    x = minus(x, z)
    r = math.sqrt(dot(x, x))
    return plus(o, plus(z, times(r, e))), r


@inner
def refined(a, b, n, count, weights, shift, base, frames, pieces, rows, work):
    """Return nearest points of two cores by Newton's method, from a simplex that has the right features.

    GJK approaches rims by chords; here their points move with the normal. Between cores that overlap, the
    result is a direction along which they overlap least; the simplex is then of cores that are drawn apart.

    Parameters
    ----------
    n : tuple
        Approximate direction from a to b.
    count, weights : int, tuple
        Number of points of the simplex in ``work``, and the weights of its nearest point.
    shift : tuple
        Of b.

    Returns
    -------
    proven : bool
        Whether the points are farthest along the normal, so that the result is right.
    distance, normal, point_a, point_b
    """
    moves_a, o_a, axis_a, e_a, s_a = _rim(a, n, base, frames, pieces)
    moves_b, o_b, axis_b, e_b, s_b = _rim(b, times(-1.0, n), base, frames, pieces)
    # one corner for all points of the same two rims
    corners, first, second, third, x0, x1 = 0, 0, 0, 0, n, n
    l0, l1, l2 = 0.0, 0.0, 0.0
    for k in range(count):
        s, _ = _turned(get(work, 4 + k), moves_a, o_a, axis_a, e_a)
        t, _ = _turned(get(work, 8 + k), moves_b, o_b, axis_b, e_b)
        w = minus(t, s)
        d0, d1 = minus(w, x0), minus(w, x1)
        if corners == 0:
            first, x0, l0, corners = k, w, weights[k], 1
        elif dot(d0, d0) < _SAME_POINT:
            l0 += weights[k]
        elif corners == 1:
            second, x1, l1, corners = k, w, weights[k], 2
        elif dot(d1, d1) < _SAME_POINT:
            l1 += weights[k]
        else:
            third, l2, corners = k, weights[k], 3
    p, q, gap, converged = n, n, 0.0, False
    for _ in range(_NEWTON_STEPS):
        x0, f1, f2, bend_a, bend_b = n, n, n, 0.0, 0.0
        p, q = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        for c in range(corners):
            k, share = (first, l0) if c == 0 else ((second, l1) if c == 1 else (third, l2))
            s, r_a = _turned(get(work, 4 + k), moves_a, o_a, axis_a, e_a)
            t, r_b = _turned(get(work, 8 + k), moves_b, o_b, axis_b, e_b)
            w = plus(minus(t, s), shift)
            if c == 0:
                x0 = w
            elif c == 1:
                f1 = minus(w, x0)
            else:
                f2 = minus(w, x0)
            p, q = plus(p, times(share, s)), plus(q, times(share, t))
            bend_a += share * r_a / s_a
            bend_b += share * r_b / s_b
        y = plus(minus(q, p), shift)
        gap = dot(n, y)
        if converged:
            break
        # second derivatives of the gap over directions u and v across n: rims bend it, and so does the turn
        u = unit(cross(n, (1.0, 0.0, 0.0))) if abs(n[0]) < 0.7 else unit(cross(n, (0.0, 1.0, 0.0)))
        v = cross(n, u)
        t, w = cross(axis_a, e_a), cross(axis_b, e_b)
        tu, tv, wu, wv = dot(t, u), dot(t, v), dot(w, u), dot(w, v)
        h11 = gap + bend_a * tu * tu + bend_b * wu * wu
        h12 = bend_a * tu * tv + bend_b * wu * wv
        h22 = gap + bend_a * tv * tv + bend_b * wv * wv
        g1, g2, e1, e2 = dot(x0, u), dot(x0, v), dot(f1, u), dot(f1, v)
        if corners == 1:
            det = h11 * h22 - h12 * h12
            if h11 + h22 <= 0.0 or det <= 0.0:
                break
            y1, y2 = (h22 * g1 - h12 * g2) / det, (h11 * g2 - h12 * g1) / det
        elif corners == 2:
            ee = e1 * e1 + e2 * e2
            across = h11 * e2 * e2 - 2.0 * h12 * e1 * e2 + h22 * e1 * e1
            if ee <= _SAME_POINT or across <= 0.0:
                break
            c = -dot(f1, n) / ee
            i1, i2 = h11 * e1 + h12 * e2, h12 * e1 + h22 * e2
            z = (e1 * g2 - e2 * g1 - c * (e1 * i2 - e2 * i1)) / across
            y1, y2 = c * e1 - z * e2, c * e2 + z * e1
            l1 = (e1 * (h11 * y1 + h12 * y2 - g1) + e2 * (h12 * y1 + h22 * y2 - g2)) / ee
            l0 = 1.0 - l1
        else:
            d1, d2 = dot(f2, u), dot(f2, v)
            det = e1 * d2 - e2 * d1
            if det * det <= _SAME_POINT * (e1 * e1 + e2 * e2 + d1 * d1 + d2 * d2):
                break
            c1, c2 = -dot(f1, n), -dot(f2, n)
            y1, y2 = (d2 * c1 - e2 * c2) / det, (e1 * c2 - d1 * c1) / det
            z1, z2 = h11 * y1 + h12 * y2 - g1, h12 * y1 + h22 * y2 - g2
            l1, l2 = (d2 * z1 - d1 * z2) / det, (e1 * z2 - e2 * z1) / det
            l0 = 1.0 - l1 - l2
        step = y1 * y1 + y2 * y2
        if not step < 1.0:
            break
        converged = step < _CONVERGED
        n = unit(plus(n, plus(times(y1, u), times(y2, v))))
        moves_a, o_a, axis_a, e_a, s_a = _rim(a, n, base, frames, pieces)
        moves_b, o_b, axis_b, e_b, s_b = _rim(b, times(-1.0, n), base, frames, pieces)
    if not converged or min(l0, l1, l2) < -_ROUND_OFF_OF_WEIGHTS:
        return False, gap, n, p, q
    swept = pieces[a, ROUNDING] + pieces[b, ROUNDING]
    reached = gap_along(a, b, n, base, frames, pieces, rows) + swept + dot(n, shift)
    return gap - reached < _UNPROVEN, gap, n, p, q


@inner
def core_distance(a, b, start, shift, far, base, frames, pieces, rows, work):
    """Return the distance of two cores, the direction from a to b, and the nearest points; b is shifted.

    ``start`` is a first guess of the direction. A distance of more than ``far`` is a lower bound. It is -1
    where the cores overlap or touch. The points are those of b without the shift.

    Returns
    -------
    distance, direction, point_a, point_b
    proven : bool
        Whether the points are known to be the nearest ones up to round-off.
    count, weights : int, tuple
        Number of points of the simplex in ``work``, and the weights of its nearest point.
    """
    v, p, q, kept_weights = start, start, start, (0.0, 0.0, 0.0)
    count, last, apart = 0, math.inf, False
    round_ = pieces[a, KIND] == LATHE or pieces[b, KIND] == LATHE
    tried = _REFINED
    for _ in range(_ITERATIONS):
        s = support(a, v, base, frames, pieces, rows)
        t = support(b, times(-1.0, v), base, frames, pieces, rows)
        w = plus(minus(t, s), shift)
        vv, vw = dot(v, v), dot(v, w)
        apart = apart or (vw > 0.0 and vw * vw > _OVERLAPPING * _OVERLAPPING * vv)
        if count > 0:
            if vw > 0.0 and vw * vw > far * far * vv:
                return vw / math.sqrt(vv), unit(v), s, t, False, 0, kept_weights
            if vv - vw <= _ACCURACY * vv + _ROUND_OFF * math.sqrt(vv):
                break
            known = False
            for k in range(count):
                e = minus(w, get(work, k))
                known = known or dot(e, e) == 0.0
            if known:
                break
            if round_ and apart and vv - vw <= tried * vv:
                proven, d, n, s_, t_ = refined(
                    a, b, unit(v), count, kept_weights, shift, base, frames, pieces, rows, work
                )
                if proven and d > _OVERLAPPING:
                    return d, n, s_, t_, True, count, kept_weights
                tried = _AGAIN * (vv - vw) / vv
        put(work, count, w)
        put(work, 4 + count, s)
        put(work, 8 + count, t)
        weights, inside = _simplex_weights(work, count + 1)
        if inside:
            if apart:
                break  # round-off of a flat tetrahedron: a plane parts the cores
            return -1.0, start, s, t, False, 0, kept_weights
        kept, new, s, t = 0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        l0, l1, l2 = 0.0, 0.0, 0.0
        for k in range(count + 1):
            if weights[k] > 0.0:
                new = plus(new, times(weights[k], get(work, k)))
                s = plus(s, times(weights[k], get(work, 4 + k)))
                t = plus(t, times(weights[k], get(work, 8 + k)))
                put(work, kept, get(work, k))
                put(work, 4 + kept, get(work, 4 + k))
                put(work, 8 + kept, get(work, 8 + k))
                if kept == 0:
                    l0 = weights[k]
                elif kept == 1:
                    l1 = weights[k]
                else:
                    l2 = weights[k]
                kept += 1
        vv = dot(new, new)
        if vv < _OVERLAPPING * _OVERLAPPING:
            return -1.0, start, s, t, False, 0, kept_weights
        count, kept_weights = kept, (l0, l1, l2)
        if vv >= last:
            break  # round-off: the point before is as near
        v, p, q, last = new, s, t, vv
    d = math.sqrt(dot(v, v))
    return d, times(1.0 / d, v), p, q, False, count, kept_weights


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
        d, m, p, q, _, count, weights = core_distance(
            a, b, n, shift, math.inf, base, frames, pieces, rows, work
        )
        if d < 0.0:
            break
        proven, deep, e, s, t = refined(
            a, b, m, count, weights, (0.0, 0.0, 0.0), base, frames, pieces, rows, work
        )
        if proven and deep - swept >= gap - _GAINED:
            return deep - swept, e, s, t
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
    m, p, q, d, proven = n, n, n, -1.0, False
    if known:
        gap = gap_along(a, b, n, base, frames, pieces, rows)
        if gap > far:
            return gap, n, p, q
    if not known or gap + swept > DRAWN_APART:
        d, m, p, q, proven, _, _ = core_distance(
            a, b, n, (0.0, 0.0, 0.0), far + swept, base, frames, pieces, rows, work
        )
    if d < 0.0:
        m = n if known else best_face_normal(a, b, n, base, frames, pieces, rows)
    if d > 0.0 and not proven:
        proven = d > _FARTHEST_APART or d - swept - gap_along(a, b, m, base, frames, pieces, rows) < _UNPROVEN
    if proven:
        gap = d - swept
    else:  # overlapping, or so near that the direction between points of round surfaces is uncertain
        gap, m, p, q = drawn_apart(a, b, m, far, base, frames, pieces, rows, work)
    return gap, m, plus(p, times(pieces[a, ROUNDING], m)), minus(q, times(pieces[b, ROUNDING], m))
