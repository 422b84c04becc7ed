"""How far pieces are from the surface of a mesh."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..compiler import kernel
from ..compiler.arrays import empty
from .distance import DIRECTIONS, STARTS, identity_frame, least_gap
from .pieces import Hull, Piece, piece_arrays

_POINT = 1e-12  # radius of a ball that stands for a point [m]


class SurfaceError(NamedTuple):
    """Distances of points of a mesh's surface from pieces [m].

    Attributes
    ----------
    mean, high : float
        Mean and 99th percentile, either way.
    outside, inside : float
        Farthest that the mesh lies outside the pieces, and deepest that it lies inside one, where the piece
        sticks out of the mesh.
    """

    mean: float
    high: float
    outside: float
    inside: float


def surface_error(pieces: Sequence[Piece], corners: np.ndarray, count: int = 4000) -> SurfaceError:
    """Return the distances of a mesh's surface from pieces.

    Parameters
    ----------
    pieces : sequence of Piece
    corners : (m, 3, 3) array
        Corners of the mesh's triangles, in the axes of the pieces [m].
    count : int
        Number of points, evenly chosen by area.
    """
    distances = distances_of_points(pieces, surface_points(corners, count))
    apart = np.abs(distances)
    return SurfaceError(
        float(apart.mean()),
        float(np.quantile(apart, 0.99)),
        float(max(distances.max(), 0.0)),
        float(max(-distances.min(), 0.0)),
    )


def surface_points(corners: np.ndarray, count: int) -> np.ndarray:
    """Return points (count, 3) of triangles (m, 3, 3), evenly by area; the same ones in each call."""
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    chosen = np.searchsorted(np.cumsum(areas) / areas.sum(), (np.arange(count) + 0.5) / count)
    u, v = np.random.default_rng(0).random((2, count, 1))
    root = np.sqrt(u)
    a, b, c = np.moveaxis(corners[np.minimum(chosen, len(corners) - 1)], 1, 0)
    return (1.0 - root) * a + root * (1.0 - v) * b + root * v * c


def distances_of_points(pieces: Sequence[Piece], points: np.ndarray) -> np.ndarray:
    """Return signed distances (n,) of points (n, 3) from pieces; below zero inside the deepest [m]."""
    arrays = piece_arrays([pieces, [Hull([[0.0, 0.0, 0.0]], _POINT)]])
    frames = np.stack([identity_frame(), identity_frame()])
    return _distances(np.ascontiguousarray(points), frames, arrays.pieces, arrays.rows, DIRECTIONS) + _POINT


@kernel
def _distances(points, frames, pieces, rows, directions):
    """Return the distances of points from all pieces but the last one, which stands for the point."""
    work, tried, found = empty((12, 3)), empty((STARTS, 4)), empty((len(points),))
    last = len(pieces) - 1
    base = (0.0, 0.0, 0.0)
    for k in range(len(points)):
        frames[1, 0], frames[1, 1], frames[1, 2] = points[k, 0], points[k, 1], points[k, 2]
        best = math.inf
        for p in range(last):
            best = min(best, least_gap(p, last, best, directions, tried, base, frames, pieces, rows, work)[0])
        found[k] = best
    return found
