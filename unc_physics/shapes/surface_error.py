"""How far the surfaces of a mesh and of its pieces are apart."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..compiler import inner, kernel
from ..compiler.arrays import empty
from .columns import CORNERS_FROM, FIRST_FACE, HULL, KIND, LAST_FACE, ROUNDING
from .distance import POLYTOPE, identity_frame, least_gap
from .piece_mesh import piece_mesh
from .pieces import Hull, Piece, piece_arrays
from .triangle_tree import build_triangle_tree, nearest_on_mesh, winding_number

_POINT = 1e-12  # radius of a ball that stands for a point [m]
_ROUND_OFF = 1e-9  # share of the extent by which a point on a surface may be inside


class SurfaceError(NamedTuple):
    """Distances between the surfaces of a mesh and of its pieces [m].

    Sides that stand for a hollow surface do not count, but that surface does.

    Attributes
    ----------
    mean, high : float
        Mean and 99th percentile over points of both surfaces, evenly by area. Parts of pieces that are inside
        the mesh, or inside other pieces, do not count.
    outside : float
        Largest distance by which the mesh is outside the pieces.
    inside : float
        Largest distance by which pieces are outside the mesh, or the mesh inside a piece.
    """

    mean: float
    high: float
    outside: float
    inside: float

    @property
    def largest(self) -> float:
        """Largest distance, either way [m]."""
        return max(self.outside, self.inside)


def surface_error(pieces: Sequence[Piece], corners: np.ndarray, count: int = 4000) -> SurfaceError:
    """Return the distances between the surfaces of a mesh and of its pieces.

    Parameters
    ----------
    pieces : sequence of Piece
    corners : (m, 3, 3) array
        Corners of the mesh's triangles, counter-clockwise from outside, in the axes of the pieces [m].
    count : int
        Number of points on each of the two surfaces. Up to as many corners of the mesh are added for the
        largest distances.
    """
    points = surface_points(corners, count)
    step = -(-len(corners) // count)
    signed = distances_of_points(pieces, np.concatenate([points, corners[::step, 0]]))
    exposed = surface_points(np.concatenate([piece_mesh(piece) for piece in pieces]), count)
    slack = _ROUND_OFF * float(np.ptp(corners, axis=(0, 1)).max())
    exposed = exposed[np.abs(distances_of_points(pieces, exposed)) <= slack]
    beyond = distances_outside(corners, exposed)
    both = np.concatenate([np.abs(signed[: len(points)]), beyond[beyond > 0.0]])
    return SurfaceError(
        float(both.mean()),
        float(np.quantile(both, 0.99)),
        float(max(signed.max(), 0.0)),
        float(max(-signed.min(), beyond.max(initial=0.0))),
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
    return _distances(np.ascontiguousarray(points), frames, arrays.pieces, arrays.rows) + _POINT


def distances_outside(corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return distances (n,) of points (n, 3) from a closed mesh; 0 inside it [m]."""
    return _outside(build_triangle_tree(corners), np.ascontiguousarray(points))


@kernel
def _distances(points, frames, pieces, rows):
    """Return the distances of points from all pieces but the last one, which stands for the point."""
    work, polytope, found = empty((12, 3)), empty(POLYTOPE), empty((len(points),))
    last = len(pieces) - 1
    base = (0.0, 0.0, 0.0)
    for k in range(len(points)):
        frames[1, 0], frames[1, 1], frames[1, 2] = points[k, 0], points[k, 1], points[k, 2]
        best = math.inf
        for p in range(last):
            height = _height_above_faces(pieces[p], rows, points[k])
            if height <= 0.0:  # inside the core: no search is needed
                best = min(best, height - pieces[p, ROUNDING] - pieces[last, ROUNDING])
            elif height == math.inf or height - pieces[p, ROUNDING] < best:
                best = min(best, least_gap(p, last, best, base, frames, pieces, rows, work, polytope)[0])
        found[k] = best
    return found


@inner
def _height_above_faces(piece, rows, point):
    """Return how far a point is above the faces of a hull's core, at most: it is farther from the core.

    Below zero the point is inside, and that deep. Infinite for pieces without flat faces.
    """
    first, last = int(piece[FIRST_FACE]), int(piece[LAST_FACE])
    if piece[KIND] != HULL or first == last:
        return math.inf
    highest = -math.inf
    for k in range(first, last):
        c = int(rows[k, CORNERS_FROM])
        height = rows[k, 0] * (point[0] - rows[c, 0]) + rows[k, 1] * (point[1] - rows[c, 1])
        highest = max(highest, height + rows[k, 2] * (point[2] - rows[c, 2]))
    return highest


@kernel
def _outside(tree, points):
    """Return the distance of each point from a mesh, or 0 inside."""
    found = np.zeros(len(points))
    for k in range(len(points)):
        x, y, z = points[k, 0], points[k, 1], points[k, 2]
        if winding_number(tree, x, y, z) < 1:
            found[k] = nearest_on_mesh(tree, x, y, z, math.inf)[0]
    return found
