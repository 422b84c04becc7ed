"""Rolling radii of a body from the hull of its packing, for the shape that the spheres approximate."""

import math

import numpy as np

from ..compiler import inner
from ..compiler.simd import LANES, lowest_bit
from ..dynamics.middle_arms import lower_spheres
from ..spatial.rotation import rotate_back
from ..spatial.vectors import dot, plus, times
from .tilt_simd import COS, DEPTH, LOWEST, SIN, lower_depths

#: Tilts at which supports are found [rad], and their number per side.
_LEAST_TILT, _MOST_TILT, _TILTS = 0.05, 0.8, 12
_JUMP = 0.15  # largest jump of the support, relative to the rolling radius
_ON_HULL = 0.02  # largest distance of the touching sphere from the hull, relative to the body's radius
_ROUNDS = 3  # corrections of a line's direction
_DIAGONAL = math.sqrt(0.5)
#: Results that are kept for each body; columns: direction, rolling matrix (11, 22, 33, 12, 13, 23) and centre
#: in the body frame, and whether the entry is filled. Counter of the next entry, in the first entry.
KEPT, KEPT_COLUMNS = 4, 14
_DIRECTION, _MATRIX, _CENTER, _FILLED, _NEXT = 0, 3, 9, 12, 13
#: Cosine between directions of one result: 1 urad. The tangential parts of the centre change by the tilt
#: times its part along the normal, which is large where the centre is far from the centre of mass.
_SAME = 1.0 - 5e-13


def _tilts():
    room = np.zeros((4, 2 * _TILTS))
    angle = np.linspace(_LEAST_TILT, _MOST_TILT, _TILTS)
    room[COS], room[SIN] = np.cos(np.tile(angle, 2)), np.concatenate([np.sin(angle), -np.sin(angle)])
    return room


#: Room for `rolling`: cosine and sine of each tilt, a depth, and the lowest sphere (rows of `tilt_simd`).
TILTS = _tilts()


@inner(error_model="numpy")
def rolling(n, first, second, i, sphere, R, world, room, kept, out):
    """Compute how the support of body i moves over its surface as it rolls, from its packing's hull.

    A packing is rough: a rolling body moves from sphere to sphere, and local derivatives do not fit the
    original shape. On a round shape the support moves with the tilt. On a flat face it jumps at once and then
    stays, as at an edge. Therefore the motion is fitted over several tilts, separate from an initial jump.

    Parameters
    ----------
    n, first, second : tuples of 3 floats
        Direction from the contact into the body, and two tangents, world frame.
    i, sphere : int
        Body, and its touching sphere. A sphere that is not on the hull near the contact does not roll.
    R : (3, 3) array
        ``R_world_body``.
    world : World
    room : array
        A copy of `TILTS`.
    kept : (B, 4, 14) array
        (`KEPT`, `KEPT_COLUMNS`), zeros at first. Results, which serve all contacts with the same direction
        in the body frame.
    out : (5,) array
        Entries 11, 12 and 22 of the symmetric matrix of rolling radii. Then the centre of the shape in both
        tangent directions, relative to the centre of mass [m].
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
    for block in range(low, high, LANES):
        mask = lower_spheres(hull, block, high, (m[0], m[1], m[2], 0.0), least)
        while mask != 0:
            k = block + lowest_bit(mask)
            mask &= mask - np.uint64(1)
            least = min(least, hull[0, k] * m[0] + hull[1, k] * m[1] + hull[2, k] * m[2] - hull[3, k])
    if own - least > _ON_HULL * world.bodies.radius[i]:
        return
    for k in range(KEPT):
        row = kept[i, k]
        if row[_FILLED] > 0.0 and row[0] * m[0] + row[1] * m[1] + row[2] * m[2] > _SAME:
            _recall(row, a, b, out)
            return
    _fit_rolling(m, a, b, low, high, hull, room, out)
    k = int(kept[i, 0, _NEXT])
    kept[i, 0, _NEXT] = (k + 1) % KEPT
    _keep(m, a, b, out, kept[i, k])


@inner
def forget_rolling(kept):
    """Empty the results that `rolling` keeps."""
    for i in range(len(kept)):
        for k in range(KEPT):
            kept[i, k, _FILLED] = 0.0
        kept[i, 0, _NEXT] = 0.0


@inner
def _keep(m, a, b, out, row):
    """Keep the result ``out`` for the direction ``m`` and the tangents ``a`` and ``b``, body frame."""
    for k in range(3):
        row[_DIRECTION + k] = m[k]
        row[_CENTER + k] = out[3] * a[k] + out[4] * b[k]
        row[_MATRIX + k] = out[0] * a[k] * a[k] + 2.0 * out[1] * a[k] * b[k] + out[2] * b[k] * b[k]
    place = _MATRIX + 3
    for k in range(2):
        for c in range(k + 1, 3):
            mixed = out[1] * (a[k] * b[c] + b[k] * a[c])
            row[place] = out[0] * a[k] * a[c] + mixed + out[2] * b[k] * b[c]
            place += 1
    row[_FILLED] = 1.0


@inner
def _recall(row, a, b, out):
    """Write a kept result for the tangents ``a`` and ``b``, body frame."""
    center = (row[_CENTER], row[_CENTER + 1], row[_CENTER + 2])
    along_a, along_b = _times_matrix(row, a), _times_matrix(row, b)
    out[0], out[1], out[2] = dot(a, along_a), dot(b, along_a), dot(b, along_b)
    out[3], out[4] = dot(a, center), dot(b, center)


@inner(forceinline=True)
def _times_matrix(row, e):
    xx, yy, zz = row[_MATRIX], row[_MATRIX + 1], row[_MATRIX + 2]
    xy, xz, yz = row[_MATRIX + 3], row[_MATRIX + 4], row[_MATRIX + 5]
    return (
        xx * e[0] + xy * e[1] + xz * e[2],
        xy * e[0] + yy * e[1] + yz * e[2],
        xz * e[0] + yz * e[1] + zz * e[2],
    )


@inner(error_model="numpy")
def _fit_rolling(m, a, b, low, high, hull, room, out):
    """Fit the result of `rolling` for the direction ``m`` and the tangents ``a`` and ``b``, body frame."""
    s11, s21, j11, j21 = _support_way(m, a, a, b, low, high, hull, room)
    s12, s22, j12, j22 = _support_way(m, b, a, b, low, high, hull, room)
    # the support jumps farthest in one direction, and least in the perpendicular one
    p, q, r = j11 * j11 + j12 * j12, j11 * j21 + j12 * j22, j21 * j21 + j22 * j22
    half, spread = 0.5 * (p + r), math.sqrt(0.25 * (p - r) ** 2 + q * q)
    angle = 0.5 * math.atan2(2.0 * q, p - r)
    rolls, slope, x, y = 0, 0.0, 1.0, 0.0
    for k in range(2):
        jump = math.sqrt(max(half + spread if k == 0 else half - spread, 0.0))
        u, v = (math.cos(angle), math.sin(angle)) if k == 0 else (-math.sin(angle), math.cos(angle))
        along = s11 * u * u + (s12 + s21) * u * v + s22 * v * v
        if along > 0.0 and jump < _JUMP * along:
            rolls, slope, x, y = rolls + 1, along, u, v
    if rolls == 1:
        longest = math.sqrt(max(j11 * j11 + j21 * j21, j12 * j12 + j22 * j22))
        for _ in range(_ROUNDS):
            d, e = plus(times(x, a), times(y, b)), plus(times(-y, a), times(x, b))
            turn = _turned(m, d, e, longest, slope, low, high, hull, room)
            x, y = x + turn * y, y - turn * x
            size = math.sqrt(x * x + y * y)
            x, y = x / size, y / size
    for _ in range(rolls):
        radius, middle = _round_shape(m, plus(times(x, a), times(y, b)), low, high, hull, room)
        out[0] += radius * x * x
        out[1] += radius * x * y
        out[2] += radius * y * y
        out[3] += middle * x
        out[4] += middle * y
        x, y = -y, x


@inner
def _write_depths(m, e, low, high, hull, room):
    """Write the negative height of a body's lowest point [m] at tilts to both sides, and its sphere.

    The height is relative to the centre of mass. ``m`` points up and ``e`` along the tilt, body frame.
    """
    tilts = room.shape[1]
    for t in range(tilts):
        room[DEPTH, t] = math.inf
    for k in range(low, high):
        x, y, z, r = float(hull[0, k]), float(hull[1, k]), float(hull[2, k]), float(hull[3, k])
        p, q = m[0] * x + m[1] * y + m[2] * z, e[0] * x + e[1] * y + e[2] * z
        for t in range(0, tilts, LANES):
            lower_depths(room, t, p, q, r, float(k))


@inner(error_model="numpy")
def _support_way(m, e, a, b, low, high, hull, room):
    """Fit lines to the support's motion along ``a`` and ``b`` as the body tilts along ``e``.

    Returns their slopes, and their values at zero tilt, which are jumps [m].
    """
    _write_depths(m, e, low, high, hull, room)
    count = room.shape[1] // 2
    mean = square = 0.0
    for t in range(count):
        mean += room[SIN, t] / count
    for t in range(count):
        square += (room[SIN, t] - mean) ** 2
    slope_a = slope_b = jump_a = jump_b = 0.0
    for t in range(count):
        u = v = 0.0
        for side in range(2):
            k = int(room[LOWEST, t + side * count])
            sign, reach = (0.5 if side else -0.5), hull[3, k] * room[SIN, t + side * count]
            x, y, z = hull[0, k] - reach * e[0], hull[1, k] - reach * e[1], hull[2, k] - reach * e[2]
            u += sign * dot(a, (x, y, z))
            v += sign * dot(b, (x, y, z))
        share = (room[SIN, t] - mean) / square
        slope_a, slope_b = slope_a + share * u, slope_b + share * v
        jump_a, jump_b = jump_a + u / count, jump_b + v / count
    return slope_a, slope_b, jump_a - mean * slope_a, jump_b - mean * slope_b


@inner(error_model="numpy")
def _turned(m, d, e, longest, radius, low, high, hull, room):
    """Return the rotation of the line on which a body lies from ``e`` towards ``d`` [rad].

    It is found from depths at diagonal tilts, which are equal on both sides without rotation. Depths vary far
    less between spheres than supports do. A rotated line of half length ``longest`` adds to the tilt on one
    side; on the other the cylinder's radius matters.
    """
    count, total, square = room.shape[1] // 2, 0.0, 0.0
    for side in range(2):
        sign = 1.0 if side == 0 else -1.0
        _write_depths(m, plus(times(_DIAGONAL, d), times(sign * _DIAGONAL, e)), low, high, hull, room)
        for t in range(2 * count):
            sine = abs(room[SIN, t])
            grows = (
                2.0 * sine * (_DIAGONAL * longest - 0.5 * radius * sine / math.sqrt(1.0 - 0.5 * sine * sine))
            )
            total -= sign * grows * room[DEPTH, t]
            square += 0.5 * grows * grows
    return total / square


@inner(error_model="numpy")
def _round_shape(m, e, low, high, hull, room):
    """Return radius and centre [m] of the circle that fits a body's depths at tilts along ``e``.

    If the line is not exactly perpendicular to ``e``, depths also grow with the sine of the tilt, equally on
    both sides.
    """
    _write_depths(m, e, low, high, hull, room)
    count = room.shape[1] // 2
    square = sine = cosine = mean = middle = 0.0
    for t in range(count):
        square += room[SIN, t] ** 2
        sine += room[SIN, t] / count
        cosine += room[COS, t] / count
        mean += 0.5 * (room[DEPTH, t] + room[DEPTH, t + count]) / count
        middle += 0.5 * room[SIN, t] * (room[DEPTH, t] - room[DEPTH, t + count])
    cc = cs = ss = cy = sy = 0.0
    for t in range(count):
        c, s = room[COS, t] - cosine, room[SIN, t] - sine
        y = 0.5 * (room[DEPTH, t] + room[DEPTH, t + count]) - mean
        cc, cs, ss, cy, sy = cc + c * c, cs + c * s, ss + s * s, cy + c * y, sy + s * y
    whole = cc * ss - cs * cs
    by_cosine, by_sine = (cy * ss - sy * cs) / whole, (sy * cc - cy * cs) / whole
    return max(by_cosine * cosine + by_sine * sine - mean, 0.0), middle / square
