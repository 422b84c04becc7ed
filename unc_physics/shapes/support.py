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


@inner
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
def gap_along(a, b, n, base, frames, pieces, rows):
    """Return the gap of two pieces along a unit vector ``n`` from a to b; below zero: overlap [m]."""
    q = support(b, times(-1.0, n), base, frames, pieces, rows)
    p = support(a, n, base, frames, pieces, rows)
    return dot(n, minus(q, p)) - pieces[a, ROUNDING] - pieces[b, ROUNDING]


@inner
def face(p, n, lean, base, frames, pieces, rows, out):
    """Write the surface of piece ``p`` that faces along the unit vector ``n`` to rows of ``out``.

    A surface is a polygon, a segment or a point, the ball's sweep included. A disc is an octagon whose first
    corner lies along ``n``, or, where the disc faces along ``n``, along the world vector ``lean``: where the
    disc's partner is loaded or slides to, so that the octagon supports it there as the circle does.

    Returns the number of corners and the surface's normal (``n`` itself for segments of a capsule and
    points).
    """
    piece = pieces[p]
    frame = frames[int(piece[OWNER])]
    b = transposed_times(frame, ROTATION, n)
    if piece[KIND] == HULL:
        count, normal = _hull_face(piece, rows, b, out)
    else:
        count, normal = _lathe_face(piece, rows, b, transposed_times(frame, ROTATION, lean), out)
    if count == 0:
        put(out, 0, plus(core_point(piece, rows, b), times(piece[ROUNDING], b)))
        count = 1
    start = minus(triple(frame, POSITION), base)
    for k in range(count):
        put(out, k, plus(start, matrix_times(frame, ROTATION, get(out, k))))
    return count, matrix_times(frame, ROTATION, normal)


@inner
def _best_face(piece, rows, b):
    """Return the row of the face whose normal is nearest to ``b``; -1 without faces."""
    best, found = -math.inf, -1
    for k in range(int(piece[FIRST_FACE]), int(piece[LAST_FACE])):
        t = rows[k, 0] * b[0] + rows[k, 1] * b[1] + rows[k, 2] * b[2]
        if t > best:
            best, found = t, k
    return found


@inner
def _hull_face(piece, rows, b, out):
    """Write the face of a hull as `face`, in body axes."""
    found = _best_face(piece, rows, b)
    first, last = int(piece[FIRST_POINT]), int(piece[LAST_POINT])
    if found >= 0:
        normal, count = get(rows, found), 0
        for k in range(int(rows[found, CORNERS_FROM]), int(rows[found, CORNERS_TO])):
            put(out, count, plus(get(rows, k), times(piece[ROUNDING], normal)))
            count += 1
        return count, normal
    if last - first == 2:
        if abs(dot(unit(minus(get(rows, first + 1), get(rows, first))), b)) < _ALONG_CAPSULE:
            put(out, 0, plus(get(rows, first), times(piece[ROUNDING], b)))
            put(out, 1, plus(get(rows, first + 1), times(piece[ROUNDING], b)))
            return 2, b
    return 0, b


@inner
def _lathe_face(piece, rows, b, lean, out):
    """Write the face of a lathe as `face`, in body axes."""
    b = transposed_times(piece, AXES, b)
    x, y, s = meridian(piece, b)
    found = _best_face(piece, rows, (s, 0.0, b[2]))
    if found < 0:
        return 0, matrix_times(piece, AXES, b)
    nr, nz = rows[found, 0], rows[found, 2]
    k = int(rows[found, CORNERS_FROM])
    rho = piece[ROUNDING]
    r0, z0 = rows[k, 0] + rho * nr, rows[k, 2] + rho * nz
    r1, z1 = rows[k + 1, 0] + rho * nr, rows[k + 1, 2] + rho * nz
    whole = piece[COS_HALF] <= -1.0
    if whole and abs(nr) < _UPRIGHT:
        if s <= _UPRIGHT:  # it faces along n: the octagon's first corner lies where it is loaded
            along = transposed_times(piece, AXES, lean)
            length = math.sqrt(along[0] * along[0] + along[1] * along[1])
            if length > _NO_DIRECTION:
                x, y = along[0] / length, along[1] / length
        count, normal = _octagon(max(r0, r1), z0, x, y, nz, out), (0.0, 0.0, nz)
    elif not whole and nr < _UPRIGHT:
        count, normal = _flat(piece, r0, z0, r1, z1, nr, nz, out)
    else:
        put(out, 0, (r0 * x, r0 * y, z0))
        put(out, 1, (r1 * x, r1 * y, z1))
        count, normal = 2, (nr * x, nr * y, nz)
    origin = triple(piece, ORIGIN)
    for c in range(count):
        put(out, c, plus(origin, matrix_times(piece, AXES, get(out, c))))
    return count, matrix_times(piece, AXES, normal)


@inner
def _octagon(r, z, x, y, side, out):
    """Write the corners of an octagon in a circle, the first one at the azimuth (x, y); return their number.

    They go around counter-clockwise as seen from the ``side`` (1: above, -1: below).
    """
    h = math.sqrt(0.5)
    c, s = 1.0, 0.0
    for k in range(8):
        put(out, k, (r * (c * x - s * side * y), r * (c * y + s * side * x), z))
        c, s = h * (c - s), h * (c + s)
    return 8


@inner
def _flat(piece, r0, z0, r1, z1, nr, nz, out):
    """Write the four corners of a sector's surface that is flat between its ends, and return its normal.

    Surfaces across the axis are flat; the ones that face the axis are chords.
    """
    cx, cy, ca, sa = piece[AZIMUTH], piece[AZIMUTH + 1], piece[COS_HALF], piece[SIN_HALF]
    xa, ya, xb, yb = cx * ca + cy * sa, cy * ca - cx * sa, cx * ca - cy * sa, cy * ca + cx * sa
    put(out, 0, (r0 * xa, r0 * ya, z0))
    put(out, 1, (r0 * xb, r0 * yb, z0))
    put(out, 2, (r1 * xb, r1 * yb, z1))
    put(out, 3, (r1 * xa, r1 * ya, z1))
    u, v = minus(get(out, 1), get(out, 0)), minus(get(out, 3), get(out, 0))
    if r0 == 0.0:
        u = minus(get(out, 2), get(out, 3))
    normal = unit(cross(u, v))
    if normal[0] * cx * nr + normal[1] * cy * nr + normal[2] * nz < 0.0:
        normal = times(-1.0, normal)
        q = get(out, 1)
        put(out, 1, get(out, 3))
        put(out, 3, q)
    return 4, normal
