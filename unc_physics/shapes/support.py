"""Kernels: farthest points and faces of pieces.

``frames`` (B, 12), ``pieces`` (n, PIECE) and ``rows`` (m, ROW) are as in `columns`. Points are in world axes,
relative to a point `base` (a tuple), so that scenes far from the world's origin lose no digits.
"""

import math

from ..compiler import inner
from ..spatial.rotation import cross
from ..spatial.vectors import dot, minus, plus, times, triple
from .columns import (
    AXES,
    AZIMUTH,
    CENTER,
    CORNERS_FROM,
    CORNERS_TO,
    COS_HALF,
    FIRST_FACE,
    FIRST_POINT,
    HULL,
    KIND,
    LAST_FACE,
    LAST_POINT,
    LATHE,
    ORIGIN,
    OWNER,
    POSITION,
    ROTATION,
    ROUNDING,
    SIN_HALF,
)

_NO_DIRECTION = 1e-12  # share of a direction across an axis below which it has no azimuth
_UPRIGHT = 1e-9  # radial part of an edge's normal below which its surface is a disc
_ALONG_CAPSULE = 0.3  # sine of the angle to a segment's normal plane up to which the segment is its face


@inner(forceinline=True)
def unit(a):
    """Return a vector scaled to length 1."""
    return times(1.0 / math.sqrt(dot(a, a)), a)


@inner(forceinline=True)
def matrix_times(row, at, a):
    """Return the product of the matrix stored row by row from column ``at`` on and a vector."""
    return dot(triple(row, at), a), dot(triple(row, at + 3), a), dot(triple(row, at + 6), a)


@inner(forceinline=True)
def transposed_times(row, at, a):
    """Return the product of the transposed matrix stored row by row from column ``at`` on and a vector."""
    return plus(
        plus(times(a[0], triple(row, at)), times(a[1], triple(row, at + 3))), times(a[2], triple(row, at + 6))
    )


@inner(forceinline=True)
def put(array, k, a):
    """Write a vector to the start of row k."""
    array[k, 0], array[k, 1], array[k, 2] = a[0], a[1], a[2]


@inner(forceinline=True)
def get(array, k):
    """Return the vector at the start of row k."""
    return array[k, 0], array[k, 1], array[k, 2]


@inner
def meridian(piece, b):
    """Return the azimuth of a lathe's sector that is nearest to a direction, and the component along it.

    The direction ``b`` and the azimuth (cosine, sine) are in the lathe's axes.
    """
    s = math.sqrt(b[0] * b[0] + b[1] * b[1])
    cx, cy, ca = piece[AZIMUTH], piece[AZIMUTH + 1], piece[COS_HALF]
    if s <= _NO_DIRECTION * abs(b[2]):
        return cx, cy, 0.0
    x, y = b[0] / s, b[1] / s
    if ca > -1.0 and x * cx + y * cy < ca:  # beyond the sector: its nearer end
        sa = piece[SIN_HALF] if cx * y - cy * x > 0.0 else -piece[SIN_HALF]
        x, y = cx * ca - cy * sa, cy * ca + cx * sa
    return x, y, x * b[0] + y * b[1]


@inner(forceinline=True)
def core_point(piece, rows, b):
    """Return the farthest point of a piece's core along ``b``, both in body axes."""
    first, last = int(piece[FIRST_POINT]), int(piece[LAST_POINT])
    best, found = -math.inf, first
    if piece[KIND] == LATHE:
        b = transposed_times(piece, AXES, b)
        x, y, s = meridian(piece, b)
        for k in range(first, last):
            t = rows[k, 0] * s + rows[k, 2] * b[2]
            if t > best:
                best, found = t, k
        r = rows[found, 0]
        return plus(triple(piece, ORIGIN), matrix_times(piece, AXES, (r * x, r * y, rows[found, 2])))
    for k in range(first, last):
        t = rows[k, 0] * b[0] + rows[k, 1] * b[1] + rows[k, 2] * b[2]
        if t > best:
            best, found = t, k
    return get(rows, found)


@inner
def support(p, d, base, frames, pieces, rows):
    """Return the farthest point of the core of piece ``p`` along ``d``, relative to ``base``; world axes."""
    frame = frames[int(pieces[p, OWNER])]
    point = core_point(pieces[p], rows, transposed_times(frame, ROTATION, d))
    return plus(minus(triple(frame, POSITION), base), matrix_times(frame, ROTATION, point))


@inner
def center(p, base, frames, pieces):
    """Return the centre of a piece's bounding sphere, relative to ``base``; world axes."""
    frame = frames[int(pieces[p, OWNER])]
    start = minus(triple(frame, POSITION), base)
    return plus(start, matrix_times(frame, ROTATION, triple(pieces[p], CENTER)))


@inner
def gap_along(a, b, n, base, frames, pieces, rows):
    """Return the gap of two pieces along a unit vector ``n`` from a to b; below zero: overlap [m]."""
    q = support(b, times(-1.0, n), base, frames, pieces, rows)
    p = support(a, n, base, frames, pieces, rows)
    return dot(n, minus(q, p)) - pieces[a, ROUNDING] - pieces[b, ROUNDING]


@inner
def face(p, n, lean, load, base, frames, pieces, rows, out):
    """Write the surface of piece ``p`` that faces along the unit vector ``n`` to rows of ``out``.

    A surface is a polygon, a segment or a point, the ball's sweep included. A disc is an octagon whose first
    corner is where a line from the point ``load`` along ``lean`` leaves the circle, so that the octagon
    supports a load there as the circle does; its lowest point along ``n`` is one more corner.

    Returns the number of corners and the surface's normal (``n`` itself for segments of a capsule and
    points).
    """
    piece = pieces[p]
    frame = frames[int(piece[OWNER])]
    b = transposed_times(frame, ROTATION, n)
    start = minus(triple(frame, POSITION), base)
    if piece[KIND] == HULL:
        count, normal = _hull_face(piece, frame, start, rows, b, out)
    else:
        count, normal = _lathe_face(piece, frame, start, rows, b, lean, load, out)
    if count > 0:
        return count, normal
    point = matrix_times(frame, ROTATION, core_point(piece, rows, b))
    put(out, 0, plus(plus(start, point), times(piece[ROUNDING], n)))
    return 1, n


@inner
def best_face(piece, rows, b):
    """Return the row of the face whose normal is nearest to ``b``; -1 without faces."""
    best, found = -math.inf, -1
    for k in range(int(piece[FIRST_FACE]), int(piece[LAST_FACE])):
        t = rows[k, 0] * b[0] + rows[k, 1] * b[1] + rows[k, 2] * b[2]
        if t > best:
            best, found = t, k
    return found


@inner
def _hull_face(piece, frame, start, rows, b, out):
    """Write the face of a hull as `face`, with ``b`` in body axes; without one the number is zero."""
    found = best_face(piece, rows, b)
    first, last = int(piece[FIRST_POINT]), int(piece[LAST_POINT])
    if found >= 0:
        normal, count = matrix_times(frame, ROTATION, get(rows, found)), 0
        start = plus(start, times(piece[ROUNDING], normal))
        for k in range(int(rows[found, CORNERS_FROM]), int(rows[found, CORNERS_TO])):
            put(out, count, plus(start, matrix_times(frame, ROTATION, get(rows, k))))
            count += 1
        return count, normal
    n = matrix_times(frame, ROTATION, b)
    if last - first == 2:
        if abs(dot(unit(minus(get(rows, first + 1), get(rows, first))), b)) < _ALONG_CAPSULE:
            start = plus(start, times(piece[ROUNDING], n))
            put(out, 0, plus(start, matrix_times(frame, ROTATION, get(rows, first))))
            put(out, 1, plus(start, matrix_times(frame, ROTATION, get(rows, first + 1))))
            return 2, n
    return 0, n


@inner
def _lathe_face(piece, frame, start, rows, b, lean, load, out):
    """Write the face of a lathe as `face`, with ``b`` in body axes; without one the number is zero."""
    b = transposed_times(piece, AXES, b)
    x, y, s = meridian(piece, b)
    found = best_face(piece, rows, (s, 0.0, b[2]))
    if found < 0:
        return 0, (0.0, 0.0, 0.0)
    nr, nz = rows[found, 0], rows[found, 2]
    k = int(rows[found, CORNERS_FROM])
    rho = piece[ROUNDING]
    r0, z0 = rows[k, 0] + rho * nr, rows[k, 2] + rho * nz
    r1, z1 = rows[k + 1, 0] + rho * nr, rows[k + 1, 2] + rho * nz
    whole = piece[COS_HALF] <= -1.0
    axis = matrix_times(frame, ROTATION, (piece[AXES + 2], piece[AXES + 5], piece[AXES + 8]))
    away = matrix_times(frame, ROTATION, matrix_times(piece, AXES, (x, y, 0.0)))
    o = plus(start, matrix_times(frame, ROTATION, triple(piece, ORIGIN)))
    if whole and abs(nr) < _UPRIGHT:
        middle, normal = plus(o, times(z0, axis)), times(nz, axis)
        return _octagon(max(r0, r1), middle, normal, away, s > _UPRIGHT, lean, load, out), normal
    if not whole and nr < _UPRIGHT and max(r0, r1) > 0.0:  # an edge on the axis is a segment
        return _flat(piece, frame, o, axis, r0, z0, r1, z1, nr, nz, lean, load, out)
    put(out, 0, plus(o, plus(times(r0, away), times(z0, axis))))
    put(out, 1, plus(o, plus(times(r1, away), times(z1, axis))))
    return 2, plus(times(nr, away), times(nz, axis))


@inner
def _where_load_leaves(r, middle, n, away, lean, load):
    """Return the unit vector from a disc's centre to where a load that moves along ``lean`` leaves the disc.

    Without a direction in the disc's plane it leads to the load, and ``away`` is the last resort.
    """
    c, along = minus(load, middle), minus(lean, times(dot(lean, n), n))
    c = minus(c, times(dot(c, n), n))
    cc, length = dot(c, c), dot(along, along)
    if length > _NO_DIRECTION * _NO_DIRECTION and cc < r * r:
        t = dot(c, along) / length
        c = plus(c, times(math.sqrt(t * t + (r * r - cc) / length) - t, along))
        cc = dot(c, c)
    if cc > _NO_DIRECTION * _NO_DIRECTION:
        return times(1.0 / math.sqrt(cc), c)
    return away


@inner
def _octagon(r, middle, n, away, leans, lean, load, out):
    """Write the octagon that stands for a disc as `face`; return the number of its corners.

    They go around counter-clockwise as seen from the side of the normal ``n``. ``away`` leads to the lowest
    point of a disc that ``leans``.
    """
    h, count = math.sqrt(0.5), 0
    u = times(r, _where_load_leaves(r, middle, n, away, lean, load))
    v, p = cross(n, u), times(r, away)
    for _ in range(8):
        put(out, count, plus(middle, u))
        count += 1
        turned = times(h, plus(u, v))
        v = times(h, minus(v, u))
        if leans and dot(cross(u, p), n) > 0.0 and dot(cross(p, turned), n) > 0.0:
            put(out, count, plus(middle, p))
            count += 1
        u = turned
    return count


@inner
def _flat(piece, frame, o, axis, r0, z0, r1, z1, nr, nz, lean, load, out):
    """Write the corners of a sector's surface that is flat between its ends; return number and normal.

    Surfaces across the axis are flat, and have a corner where the load leaves their outer arc; the ones that
    face the axis are chords.
    """
    if r0 > r1:
        r0, z0, r1, z1 = r1, z1, r0, z0
    cx, cy, ca, sa = piece[AZIMUTH], piece[AZIMUTH + 1], piece[COS_HALF], piece[SIN_HALF]
    middle = matrix_times(frame, ROTATION, matrix_times(piece, AXES, (cx, cy, 0.0)))
    side = cross(axis, middle)
    a, b = minus(times(ca, middle), times(sa, side)), plus(times(ca, middle), times(sa, side))
    low, high, count = plus(o, times(z0, axis)), plus(o, times(z1, axis)), 3
    put(out, 0, plus(low, times(r0, a)))
    put(out, 1, plus(low, times(r0, b)))
    put(out, 2, plus(high, times(r1, b)))
    if abs(nr) < _UPRIGHT:
        e = _where_load_leaves(r1, high, axis, middle, lean, load)
        if dot(e, middle) > ca:
            put(out, 3, plus(high, times(r1, e)))
            count = 4
    put(out, count, plus(high, times(r1, a)))
    normal = unit(cross(minus(get(out, 2), get(out, count)), minus(get(out, count), get(out, 0))))
    if dot(normal, middle) * nr + dot(normal, axis) * nz < 0.0:
        normal = times(-1.0, normal)
        for k in range((count + 1) // 2):
            p = get(out, k)
            put(out, k, get(out, count - k))
            put(out, count - k, p)
    return count + 1, normal


@inner
def round_outline(p, base, frames, pieces, out):
    """Widen the segment in the first two rows of ``out`` to the outline of a sector's round surface.

    The segment is one that `face` has written. Its ends stay corners, and those of the surface are added: a
    flat face may end between a sector's farthest meridian and its ends. Returns the number of corners.
    """
    piece, q0, q1 = pieces[p], get(out, 0), get(out, 1)
    frame = frames[int(piece[OWNER])]
    axis = matrix_times(frame, ROTATION, (piece[AXES + 2], piece[AXES + 5], piece[AXES + 8]))
    o = matrix_times(frame, ROTATION, triple(piece, ORIGIN))
    o = plus(minus(triple(frame, POSITION), base), o)
    ca, sa = piece[COS_HALF], piece[SIN_HALF]
    way = matrix_times(piece, AXES, (piece[AZIMUTH], piece[AZIMUTH + 1], 0.0))
    middle = matrix_times(frame, ROTATION, way)
    side = cross(axis, middle)
    count = 0
    for k in range(2):
        q = q0 if k == 0 else q1
        d = minus(q, o)
        z = dot(d, axis)
        d = minus(d, times(z, axis))
        r, foot = math.sqrt(dot(d, d)), plus(o, times(z, axis))
        if r <= _NO_DIRECTION:  # on the axis
            put(out, count, q)
            count += 1
            continue
        turn = sa if k == 0 else -sa
        put(out, count, plus(foot, times(r, minus(times(ca, middle), times(turn, side)))))
        count += 1
        if dot(d, middle) > r * (ca + _UPRIGHT):
            put(out, count, q)
            count += 1
        put(out, count, plus(foot, times(r, plus(times(ca, middle), times(turn, side)))))
        count += 1
    return count
