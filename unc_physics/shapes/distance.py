"""Signed distance of two bodies from Python."""

from __future__ import annotations

import math
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ..checks.errors import InvalidRequestError
from ..checks.validation import array, point, quaternion
from ..compiler import inner, kernel
from ..compiler.arrays import empty
from ..spatial.rotation import cross, rotation_matrix
from ..spatial.vectors import dot, minus, plus, times, triple
from .columns import FRAME, HALF_SPACE, KIND, POSITION, RADIUS, ROTATION, ROUNDING
from .hollow import AGREE, hollow_contact, hollow_surface, is_hollow
from .nearest import drawn_apart, nearest
from .pieces import joined, piece_arrays
from .support import center, get, put, support, unit

#: Columns of the polytope inside the difference of two cores. A row holds a point, a triangle (numbers of its
#: corners, outward normal, distance from the origin), and an edge of the rim around what a new point sees.
_CORNERS, _OUTWARD, _HEIGHT, _RIM = 3, 6, 9, 10
_MOST_POINTS = 256  # smooth pieces are then within 1e-4 of their size
#: Shape of the array of a polytope: at most twice as many triangles as points.
POLYTOPE = 2 * _MOST_POINTS, 12
#: Shares of the size by which points of the polytope are moved, and to which the least overlap is found.
_MOVED, _ACCURACY = 1e-9, 1e-6
_ROUND_OFF = 1e-12  # of a distance from a surface [m]


class SignedDistance(NamedTuple):
    """Distance of two bodies, in world axes.

    Attributes
    ----------
    distance : float
        Below zero: depth of the pieces that overlap most [m].
    normal : (3,) array
        Unit vector from a to b.
    point_a, point_b : (3,) array
        Nearest points of the surfaces; where bodies overlap, those that touch last when they part along the
        normal [m].
    """

    distance: float
    normal: np.ndarray
    point_a: np.ndarray
    point_b: np.ndarray


@inner
def _difference(a, b, n, k, base, frames, pieces, rows):
    """Return the point of the cores' difference a - b that is farthest along ``n``, as point number ``k``.

    Points are moved a little, so that no four of them are in a plane.
    """
    q = support(b, times(-1.0, n), base, frames, pieces, rows)
    w = minus(support(a, n, base, frames, pieces, rows), q)
    moved = (0.8191725 * k % 1.0 - 0.5, 0.6710436 * k % 1.0 - 0.5, 0.5497005 * k % 1.0 - 0.5)
    return plus(w, times(_MOVED * (pieces[a, RADIUS] + pieces[b, RADIUS]), moved))


@inner
def _write_triangle(polytope, count, i, j, k):
    """Write the corners of a triangle, its outward normal, and its distance from the origin."""
    p = get(polytope, i)
    n = unit(cross(minus(get(polytope, j), p), minus(get(polytope, k), p)))
    row = polytope[count]
    row[_CORNERS], row[_CORNERS + 1], row[_CORNERS + 2] = i, j, k
    row[_OUTWARD], row[_OUTWARD + 1], row[_OUTWARD + 2], row[_HEIGHT] = n[0], n[1], n[2], dot(n, p)


@inner
def _least_overlap(a, b, n, base, frames, pieces, rows, polytope):
    """Return the direction from a to b along which two cores overlap least, or one that parts them.

    A polytope inside the cores' difference grows where its surface is nearest to the origin, until the
    difference reaches no farther there (van den Bergen 2001). ``polytope`` is scratch.
    """
    for k, (x, y) in enumerate(((1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0))):
        put(polytope, k, _difference(a, b, (x, y, x * y), k, base, frames, pieces, rows))
    first = get(polytope, 0)
    e, f = minus(get(polytope, 1), first), minus(get(polytope, 2), first)
    i, j = (1, 2) if dot(cross(e, f), minus(get(polytope, 3), first)) < 0.0 else (2, 1)
    _write_triangle(polytope, 0, 0, i, j)
    _write_triangle(polytope, 1, 0, j, 3)
    _write_triangle(polytope, 2, 0, 3, i)
    _write_triangle(polytope, 3, i, 3, j)
    count, least = 4, math.inf
    for k in range(4, _MOST_POINTS):
        nearest = 0
        for c in range(1, count):
            if polytope[c, _HEIGHT] < polytope[nearest, _HEIGHT]:
                nearest = c
        e = triple(polytope[nearest], _OUTWARD)
        w = _difference(a, b, e, k, base, frames, pieces, rows)
        if dot(e, w) < least:
            least, n = dot(e, w), e
        if least - polytope[nearest, _HEIGHT] < _ACCURACY * (pieces[a, RADIUS] + pieces[b, RADIUS]):
            break
        # triangles that the new point sees go; the rim of the hole is joined to it
        rim, c = 0, 0
        while c < count:
            if dot(triple(polytope[c], _OUTWARD), w) <= polytope[c, _HEIGHT]:
                c += 1
                continue
            for v in range(3):
                start, end = polytope[c, _CORNERS + v], polytope[c, _CORNERS + (v + 1) % 3]
                back = 0
                while back < rim and (polytope[back, _RIM] != end or polytope[back, _RIM + 1] != start):
                    back += 1
                if back < rim:
                    rim -= 1
                    start, end = polytope[rim, _RIM], polytope[rim, _RIM + 1]
                    polytope[back, _RIM], polytope[back, _RIM + 1] = start, end
                else:
                    polytope[rim, _RIM], polytope[rim, _RIM + 1] = start, end
                    rim += 1
            count -= 1
            for column in range(_CORNERS, _RIM):
                polytope[c, column] = polytope[count, column]
        put(polytope, k, w)
        for r in range(rim):
            i, j = int(polytope[r, _RIM]), int(polytope[r, _RIM + 1])
            _write_triangle(polytope, count, i, j, k)
            count += 1
    return n


@inner
def least_gap(a, b, far, base, frames, pieces, rows, work, polytope):
    """Return gap (a lower bound beyond ``far``), normal and nearest points of two pieces.

    Only ``a`` may be a half-space. Below zero, the gap is the least depth.
    """
    n = (1.0, 0.0, 0.0)
    if pieces[a, KIND] != HALF_SPACE:
        away = minus(center(b, base, frames, pieces), center(a, base, frames, pieces))
        length = math.sqrt(dot(away, away))
        if length > 0.0:
            n = times(1.0 / length, away)
        if length - pieces[a, RADIUS] - pieces[b, RADIUS] > far:
            return length - pieces[a, RADIUS] - pieces[b, RADIUS], n, n, n
    gap, n, p, q = nearest(a, b, n, False, max(far, 0.0), base, frames, pieces, rows, work)
    swept = pieces[a, ROUNDING] + pieces[b, ROUNDING]
    deep = gap + swept < 0.0 and gap < far and pieces[a, KIND] != HALF_SPACE
    if deep:
        m = _least_overlap(a, b, n, base, frames, pieces, rows, polytope)
        other, m, s, t = drawn_apart(a, b, m, math.inf, base, frames, pieces, rows, work)
        if other > gap:
            p, q = plus(s, times(pieces[a, ROUNDING], m)), minus(t, times(pieces[b, ROUNDING], m))
            gap, n = other, m
    gap, n, p, q, _ = hollow_contact(a, b, gap, n, p, q, False, base, frames, pieces, rows)
    for own, other, side in ((a, b, 1.0), (b, a, -1.0)):
        if deep and gap < 0.0 and is_hollow(own, pieces):
            # sides rise through half of a thin wall, so that pieces part outwards, or at an end of the piece:
            # what is in the hollow is at least as far as its point that reaches farthest towards the surface
            rho, r = pieces[other, ROUNDING], pieces[own, ROUNDING]
            x = plus(q, times(rho, n)) if side > 0.0 else minus(p, times(rho, n))
            found, m, _, _ = hollow_surface(own, x, base, frames, pieces, rows)
            y = support(other, times(-1.0, m), base, frames, pieces, rows)
            away, e, _, _ = hollow_surface(own, y, base, frames, pieces, rows)
            way = dot(m, minus(y, x))
            if (
                found < math.inf
                and abs(away - found - way) <= AGREE * abs(way) + _ROUND_OFF
                and away - r - rho > gap
            ):
                gap, n = away - r - rho, times(side, e)
                p, q = minus(y, times(away - r, e)), minus(y, times(rho, e))
                if side < 0.0:
                    p, q = q, p
    return gap, n, p, q


@kernel
def distance_of_bodies(frames, pieces, rows, first):
    """Return gap, normal and nearest points (3, 3) of two bodies, relative to the first one's frame."""
    work, polytope, out = empty((12, 3)), empty(POLYTOPE), empty((3, 3))
    base, best = triple(frames[0], POSITION), math.inf
    for i in range(first[0], first[1]):
        for j in range(first[1], first[2]):
            a, b, side = (j, i, -1.0) if pieces[j, KIND] == HALF_SPACE else (i, j, 1.0)
            gap, n, p, q = least_gap(a, b, best, base, frames, pieces, rows, work, polytope)
            if gap < best:
                best = gap
                if side < 0.0:
                    p, q = q, p
                for k in range(3):
                    out[0, k], out[1, k], out[2, k] = side * n[k], p[k], q[k]
    return best, out


def even_directions(count: int) -> np.ndarray:
    """Return evenly spread unit vectors (count, 3), a Fibonacci lattice."""
    k = np.arange(count) + 0.5
    z, turn = 1.0 - 2.0 * k / count, math.pi * (1.0 + math.sqrt(5.0)) * k
    r = np.sqrt(1.0 - z * z)
    return np.column_stack([r * np.cos(turn), r * np.sin(turn), z])


def identity_frame() -> np.ndarray:
    """Return the row (12,) of a frame at the origin."""
    return np.array([0.0, 0.0, 0.0, *np.eye(3).ravel()])


def _frame(pose, field):
    """Return the row of a body's frame from its pose."""
    if pose is None:
        return identity_frame()
    try:
        position, orientation = pose
    except (TypeError, ValueError):
        raise InvalidRequestError("must be a position (3,) and a quaternion (4,)", field=field) from None
    row = np.empty(FRAME)
    row[POSITION : POSITION + 3] = point(array(position, (3,), f"{field}[0]"), f"{field}[0]")
    row[ROTATION:] = rotation_matrix(
        quaternion(array(orientation, (4,), f"{field}[1]"), f"{field}[1]")
    ).ravel()
    return row


@lru_cache(maxsize=64)
def _arrays(body):
    """Return the arrays of a body's pieces."""
    return piece_arrays([body.pieces])


def _checked_arrays(body, field):
    try:
        return _arrays(body)
    except (AttributeError, TypeError):
        raise InvalidRequestError(
            "must be a model, as load_model and primitive_model return, or an element of the environment",
            field=field,
            value=type(body).__name__,
        ) from None


def signed_distance(model_a, pose_a, model_b, pose_b) -> SignedDistance:
    """Return the signed distance of two bodies, by their pieces.

    Parameters
    ----------
    model_a, model_b : SpherePacking or Element
        Models as `load_model` and `primitive_model` return them, or elements of the environment. A model
        without pieces has one for each sphere.
    pose_a, pose_b : (position (3,), quaternion (4,)) or None
        Position [m] of the centre of mass and orientation (x, y, z, w), world frame. None is the identity: an
        element of the environment has a pose of its own, and this one moves it on.

    Returns
    -------
    SignedDistance
        Distance [m], below zero the depth of the pieces that overlap most; normal from a to b; point on a;
        point on b; world frame. Where nearest points are not unique, they are one pair of them.

    Raises
    ------
    InvalidRequestError
        If an argument is no model or pose, or both are half-spaces.
    """
    frames = np.array([_frame(pose_a, "pose_a"), _frame(pose_b, "pose_b")])
    arrays = joined([_checked_arrays(model_a, "model_a"), _checked_arrays(model_b, "model_b")])
    kinds = arrays.pieces[:, KIND]
    if all(np.any(kinds[i:j] == HALF_SPACE) for i, j in pairwise(arrays.first)):
        raise InvalidRequestError("are both half-spaces, which have no distance", field="bodies")
    gap, found = distance_of_bodies(frames, arrays.pieces, arrays.rows, arrays.first)
    origin = frames[0, POSITION : POSITION + 3]
    return SignedDistance(float(gap), found[0], found[1] + origin, found[2] + origin)
