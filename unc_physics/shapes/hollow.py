"""Kernels: the hollow surfaces of revolution that flat sides of convex pieces stand for.

A hollow side is cut into convex pieces whose flat sides rise into it. What touches such a side touches the
surface itself: its gap, normal and curvature come from the arcs of the profile.
"""

import math

from ..compiler import inner
from ..spatial.vectors import dot, minus, plus, times, triple
from .columns import (
    AXES,
    FACE_OF,
    FACE_OF_A,
    FACE_OF_B,
    FIRST_ARC,
    GAP,
    LAST_ARC,
    NO_FACE,
    NORMAL,
    ORIGIN,
    OWNER,
    PIECE_A,
    PIECE_B,
    POINT,
    POSITION,
    RADIUS,
    ROTATION,
    ROUNDING,
)
from .support import matrix_times, transposed_times

_FACES = 0.5  # cosine between the normals of a contact and of the surface, at least: else it is an edge's
_BULGE = 0.005  # share of a piece's radius by which its surface may be outside of its sides, where it bulges
_RISE = 0.25  # share of a piece's radius by which its sides are within its surface, at most
#: Share of a way along which two distances from a surface agree, if they are from the same side of it.
AGREE = 0.25
_BEYOND = 1e-9  # share of an arc by which a foot may be beyond its ends
_CENTRE = 0.1  # share of a radius of curvature beyond which a centre of curvature is no nearer
_ON_AXIS = 1e-9  # m, from the axis up to which a surface is as round across as along its profile


@inner(error_model="numpy")
def hollow_surface(p, x, base, frames, pieces, rows):
    """Return the distance of a point from the hollow surface of piece ``p``, its normal and its curvature.

    Parameters
    ----------
    p : int
        Row of the piece.
    x : tuple
        Point from ``base``, world axes.

    Returns
    -------
    gap : float
        Along the normal; infinite where no normal leads to the point [m].
    normal : tuple
        Outward one, world axes.
    along : tuple
        Direction of the profile, world axes.
    curvatures : (float, float)
        Change of the normal with the point along the profile, and across it; below zero in what is hollow
        [1/m].
    """
    piece = pieces[p]
    frame = frames[int(piece[OWNER])]
    c = transposed_times(frame, ROTATION, minus(x, minus(triple(frame, POSITION), base)))
    c = transposed_times(piece, AXES, minus(c, triple(piece, ORIGIN)))
    r, best, nr, nz, bent = math.sqrt(c[0] * c[0] + c[1] * c[1]), math.inf, 0.0, 0.0, 0.0
    for k in range(int(piece[FIRST_ARC]), int(piece[LAST_ARC]), 2):
        wr, wz = rows[k + 1, 0] - rows[k, 0], rows[k + 1, 1] - rows[k, 1]
        ar, az = rows[k, 2], rows[k, 3]
        br, bz = rows[k + 1, 2] - ar, rows[k + 1, 3] - az
        dr, dz = r - rows[k, 0], c[2] - rows[k, 1]
        # the point is on the line along the normal at share s: on circles linear in s, elsewhere nearly
        start, slope, square = dr * az - dz * ar, dr * bz - dz * br - wr * az + wz * ar, wr * bz - wz * br
        s = -start / slope
        s = -(start - s * s * square) / slope
        if not -_BEYOND <= s <= 1.0 + _BEYOND:
            continue
        ur, uz = ar + s * br, az + s * bz
        size, turn = math.sqrt(ur * ur + uz * uz), br * br + bz * bz
        gap = ((dr - s * wr) * ur + (dz - s * wz) * uz) / size
        if turn > 0.0:
            gap -= (wr * br + wz * bz) / turn * (1.0 - size)
        if abs(gap) < abs(best):
            best, nr, nz, bent = gap, ur / size, uz / size, (wr * br + wz * bz) / (wr * wr + wz * wz)
    if best == math.inf:
        return best, (0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 0.0)
    x, y = 1.0, 0.0
    if r > _ON_AXIS:
        x, y = c[0] / r, c[1] / r
    normal = matrix_times(frame, ROTATION, matrix_times(piece, AXES, (nr * x, nr * y, nz)))
    along = matrix_times(frame, ROTATION, matrix_times(piece, AXES, (nz * x, nz * y, -nr)))
    bent /= max(1.0 + bent * best, _CENTRE)
    return best, normal, along, (bent, nr / r if r > _ON_AXIS else bent)


@inner
def is_hollow(p, pieces):
    """Return whether sides of piece ``p`` stand for a hollow surface."""
    return pieces[p, LAST_ARC] > pieces[p, FIRST_ARC]


@inner
def hollow_contact(a, b, gap, n, p, q, edges, base, frames, pieces, rows):
    """Return gap, normal and nearest points of two pieces that touch each other's sides, and whose it is.

    Where the side stands for a hollow surface, they are those of the surface. The nearest points, and the
    normal from a to b, are those of the pieces. What is deeper than its rounding has passed the side, and
    may have passed the wall: at the side's own point the surface must then be about as far.

    With ``edges``, what touches an edge beside the surface keeps its normal; otherwise the surface's counts
    where it is farther.
    """
    whose = NO_FACE
    for own, other, side in ((a, b, 1.0), (b, a, -1.0)):
        if not is_hollow(own, pieces):
            continue
        rho, r = pieces[other, ROUNDING], pieces[own, ROUNDING]
        y, x = (p, plus(q, times(rho, n))) if side > 0.0 else (q, minus(p, times(rho, n)))
        found, m, _, _ = hollow_surface(own, x, base, frames, pieces, rows)
        passed, away, size = gap + rho < 0.0, found - r - rho, pieces[own, RADIUS]
        if passed:
            rise, e, _, _ = hollow_surface(own, y, base, frames, pieces, rows)
            there = rise - r + side * dot(e, n) * gap
            if rise < math.inf and not abs(there - away) < AGREE * abs(gap):
                found, m, x, away = rise, e, y, gap + rise - r
        # others are gaps of another surface, through a wall
        if not min(gap, 0.0) - _BULGE * size <= away <= gap + _RISE * size:
            continue
        if side * dot(m, n) < _FACES and (edges or passed or away < gap):
            continue
        gap, n, whose = away, times(side, m), FACE_OF_A if side > 0.0 else FACE_OF_B
        p = minus(x, times(found - r, m))
        q = plus(p, times(away, m))
        if side < 0.0:
            p, q = q, p
    return gap, n, p, q, whose


@inner(noinline=True)
def touch_hollow(first, last, base, frames, pieces, rows, out):
    """Bring contacts with sides of pieces to the hollow surfaces that these stand for."""
    for k in range(first, last):
        a, b, gap, n = int(out[k, PIECE_A]), int(out[k, PIECE_B]), out[k, GAP], triple(out[k], NORMAL)
        if is_hollow(a, pieces) or is_hollow(b, pieces):
            half = times(0.5 * gap, n)
            p, q = minus(triple(out[k], POINT), half), plus(triple(out[k], POINT), half)
            gap, n, p, q, whose = hollow_contact(a, b, gap, n, p, q, True, base, frames, pieces, rows)
            if whose != NO_FACE:
                middle = times(0.5, plus(p, q))
                for j in range(3):
                    out[k, POINT + j], out[k, NORMAL + j] = middle[j], n[j]
                out[k, GAP], out[k, FACE_OF] = gap, whose
