"""Signed distance of two bodies from Python."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..checks.errors import InvalidRequestError
from ..checks.validation import array, point, quaternion
from ..compiler import inner, kernel
from ..compiler.arrays import empty
from ..spatial.rotation import rotation_matrix
from ..spatial.vectors import dot, minus, plus, times, triple
from .columns import (
    CENTER,
    FIRST_FACE,
    FRAME,
    HALF_SPACE,
    KIND,
    LAST_FACE,
    LATHE,
    OWNER,
    POSITION,
    RADIUS,
    ROTATION,
    ROUNDING,
)
from .nearest import drawn_apart, nearest
from .pieces import piece_arrays
from .support import gap_along, get, matrix_times

_STARTS = 3  # directions from which depths are looked for, the most promising ones


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
def _middle(p, base, frames, pieces):
    """Return the centre of a piece's bounding sphere, relative to ``base``; world axes."""
    frame = frames[int(pieces[p, OWNER])]
    return plus(
        minus(triple(frame, POSITION), base), matrix_times(frame, ROTATION, triple(pieces[p], CENTER))
    )


@inner
def _least_depth(a, b, gap, n, p, q, directions, tried, base, frames, pieces, rows, work):
    """Return gap, normal and nearest points of overlapping pieces, from the best of many directions."""
    for k in range(_STARTS):
        tried[k, 3] = -math.inf
    for k in range(len(directions)):
        _insert(
            tried, a, b, (directions[k, 0], directions[k, 1], directions[k, 2]), base, frames, pieces, rows
        )
    for piece, side in ((a, 1.0), (b, -1.0)):
        if pieces[piece, KIND] != LATHE:
            frame = frames[int(pieces[piece, OWNER])]
            for k in range(int(pieces[piece, FIRST_FACE]), int(pieces[piece, LAST_FACE])):
                normal = times(side, matrix_times(frame, ROTATION, get(rows, k)))
                _insert(tried, a, b, normal, base, frames, pieces, rows)
    for k in range(_STARTS):
        if tried[k, 3] == -math.inf:
            continue
        other, m, s, t = drawn_apart(
            a, b, (tried[k, 0], tried[k, 1], tried[k, 2]), math.inf, base, frames, pieces, rows, work
        )
        if other > gap:
            gap, n = other, m
            p, q = plus(s, times(pieces[a, ROUNDING], m)), minus(t, times(pieces[b, ROUNDING], m))
    return gap, n, p, q


@inner
def _insert(tried, a, b, n, base, frames, pieces, rows):
    """Keep a direction if it is among the best ones so far."""
    gap = gap_along(a, b, n, base, frames, pieces, rows)
    worst = 0
    for k in range(1, _STARTS):
        if tried[k, 3] < tried[worst, 3]:
            worst = k
    if gap > tried[worst, 3]:
        tried[worst, 0], tried[worst, 1], tried[worst, 2], tried[worst, 3] = n[0], n[1], n[2], gap


@kernel
def distance_of_bodies(frames, pieces, rows, first, directions):
    """Return gap, normal and nearest points (3, 3) of the bodies in the first two frames, relative to the first.

    Depths are looked for from the most promising of the faces' normals and the unit vectors ``directions``.
    """
    work, out = empty((12, 3)), empty((3, 3))
    tried = empty((_STARTS, 4))
    base, best = triple(frames[0], POSITION), math.inf
    for i in range(first[0], first[1]):
        for j in range(first[1], first[2]):
            a, b, side = (j, i, -1.0) if pieces[j, KIND] == HALF_SPACE else (i, j, 1.0)
            if pieces[a, KIND] != HALF_SPACE:
                away = minus(_middle(b, base, frames, pieces), _middle(a, base, frames, pieces))
                length = math.sqrt(dot(away, away))
                if length - pieces[a, RADIUS] - pieces[b, RADIUS] > best:
                    continue
                n = times(1.0 / length, away) if length > 0.0 else (1.0, 0.0, 0.0)
            else:
                n = (1.0, 0.0, 0.0)
            gap, n, p, q = nearest(a, b, n, False, max(best, 0.0), base, frames, pieces, rows, work)
            if gap < 0.0 and pieces[a, KIND] != HALF_SPACE:
                gap, n, p, q = _least_depth(
                    a, b, gap, n, p, q, directions, tried, base, frames, pieces, rows, work
                )
            if gap < best:
                best = gap
                if side < 0.0:
                    p, q = q, p
                for k in range(3):
                    out[0, k], out[1, k], out[2, k] = side * n[k], p[k], q[k]
    return best, out


def _even_directions(count):
    """Return unit vectors (count, 3) that cover the sphere evenly (a Fibonacci lattice)."""
    k = np.arange(count) + 0.5
    z, turn = 1.0 - 2.0 * k / count, math.pi * (1.0 + math.sqrt(5.0)) * k
    r = np.sqrt(1.0 - z * z)
    return np.column_stack([r * np.cos(turn), r * np.sin(turn), z])


_DIRECTIONS = _even_directions(64)


def identity_frame() -> np.ndarray:
    """Return the row (12,) of a frame at the origin."""
    return np.array([0.0, 0.0, 0.0, *np.eye(3).ravel()])


def _frame(pose, field):
    """Return the row of a body's frame from its pose."""
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


def distance_of_pieces(pieces_a, frame_a, pieces_b, frame_b) -> SignedDistance:
    """Return the signed distance of two bodies from their pieces and the rows of their frames (12,)."""
    arrays = piece_arrays([pieces_a, pieces_b])
    frames = np.array([frame_a, frame_b])
    gap, found = distance_of_bodies(frames, arrays.pieces, arrays.rows, arrays.first, _DIRECTIONS)
    origin = frames[0, POSITION : POSITION + 3]
    return SignedDistance(float(gap), found[0], found[1] + origin, found[2] + origin)
