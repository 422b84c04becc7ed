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
from ..spatial.rotation import rotation_matrix
from ..spatial.vectors import dot, minus, plus, times, triple
from .columns import (
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
from .pieces import joined, piece_arrays
from .support import center, gap_along, get, matrix_times

#: Directions from which depths are looked for, the most promising ones.
STARTS = 3


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
def _least_depth(a, b, gap, n, p, q, directions, tried, base, frames, pieces, rows, work):
    """Return gap, normal and nearest points of overlapping pieces, from the best of many directions."""
    for k in range(STARTS):
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
    for k in range(STARTS):
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
    for k in range(1, STARTS):
        if tried[k, 3] < tried[worst, 3]:
            worst = k
    if gap > tried[worst, 3]:
        tried[worst, 0], tried[worst, 1], tried[worst, 2], tried[worst, 3] = n[0], n[1], n[2], gap


@inner
def least_gap(a, b, far, directions, tried, base, frames, pieces, rows, work):
    """Return gap (a lower bound beyond ``far``), normal and nearest points of two pieces.

    Only ``a`` may be a half-space. A depth is the least one, as seen from the faces' normals and
    ``directions``.
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
    if gap < 0.0 and pieces[a, KIND] != HALF_SPACE:
        return _least_depth(a, b, gap, n, p, q, directions, tried, base, frames, pieces, rows, work)
    return gap, n, p, q


@kernel
def distance_of_bodies(frames, pieces, rows, first, directions):
    """Return gap, normal and nearest points (3, 3) of two bodies, relative to the first one's frame.

    Depths are looked for from the most promising of the faces' normals and the unit vectors ``directions``.
    """
    work, out = empty((12, 3)), empty((3, 3))
    tried = empty((STARTS, 4))
    base, best = triple(frames[0], POSITION), math.inf
    for i in range(first[0], first[1]):
        for j in range(first[1], first[2]):
            a, b, side = (j, i, -1.0) if pieces[j, KIND] == HALF_SPACE else (i, j, 1.0)
            gap, n, p, q = least_gap(a, b, best, directions, tried, base, frames, pieces, rows, work)
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


#: Unit vectors from which depths are looked for.
DIRECTIONS = even_directions(64)


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
    return _distance(arrays, frames)


def distance_of_pieces(pieces_a, frame_a, pieces_b, frame_b) -> SignedDistance:
    """Return the signed distance of two bodies from their pieces and the rows of their frames (12,)."""
    return _distance(piece_arrays([pieces_a, pieces_b]), np.array([frame_a, frame_b]))


def _distance(arrays, frames):
    kinds = arrays.pieces[:, KIND]
    if all(np.any(kinds[i:j] == HALF_SPACE) for i, j in pairwise(arrays.first)):
        raise InvalidRequestError("are both half-spaces, which have no distance", field="bodies")
    gap, found = distance_of_bodies(frames, arrays.pieces, arrays.rows, arrays.first, DIRECTIONS)
    origin = frames[0, POSITION : POSITION + 3]
    return SignedDistance(float(gap), found[0], found[1] + origin, found[2] + origin)
