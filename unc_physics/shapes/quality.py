"""Loss of extent of the first spheres of a packing against its mesh."""

from __future__ import annotations

import math

import numpy as np

from .distance import even_directions
from .solid_mesh import unique_rows

_STEPS = (1.0, 1.2, 1.4, 1.6, 1.8, 2.0, 2.5, 3.0, 3.5, 4.0, 4.5, 5.0, 6.0, 7.0, 8.0, 9.0)
_DIRECTIONS = 4096
#: Normals of the hull that are used, at most; heights of its corners along them, all and at once (128 MB).
_NORMALS, _HEIGHTS, _AT_ONCE = 8192, 200_000_000, 16_000_000
#: Directions that are improved for each number of spheres, the first and the last turn [rad].
_IMPROVED, _FIRST_TURN, _LAST_TURN, _SHORTER = 48, 0.05, 2e-4, 0.6
#: Points and spheres that are known near to such a direction: those that reach farthest there.
_CANDIDATES = 64
_TURNS = np.array([[1, 0], [0.5, 0.9], [-0.5, 0.9], [-1, 0], [-0.5, -0.9], [0.5, -0.9]])


def prefix_lengths(count: int) -> np.ndarray:
    """Return the numbers of first spheres (k,) for which quality is measured: round ones and ``count``."""
    decades = 10 ** np.arange(math.ceil(math.log10(count)) + 1)
    round_ones = np.unique(np.rint(np.outer(decades, _STEPS)).astype(np.int64))
    return np.append(round_ones[round_ones < count], count)


def extent_losses(corners, spheres, lengths) -> np.ndarray:
    """Return the largest loss of extent over all directions (k,) [m], for the first spheres of a packing.

    ``lengths`` (k,) are the numbers of first spheres, ascending. The loss in a direction is how much
    farther the mesh reaches than the spheres. The mesh's triangles have ``corners`` (m, 3, 3); ``spheres``
    (n, 4) are centres and radii [m].

    Notes
    -----
    The difference of the two support functions is taken in many directions, among them the normals of the
    mesh's hull, and improved from the largest ones by a pattern search.
    """
    points, normals = hull(corners.reshape(-1, 3))
    # a finer hull has no face that the even directions and the search from the best of them would miss
    normals = normals[:: -(-len(normals) // min(_NORMALS, _HEIGHTS // len(points))) or 1]
    directions = np.concatenate([even_directions(_DIRECTIONS), normals])
    parts = np.array_split(directions, -(-len(directions) * len(points) // _AT_ONCE))
    reach = np.concatenate([(part @ points.T).max(axis=1) for part in parts])
    covered = np.full(len(directions), -np.inf)
    losses, before = np.empty(len(lengths)), 0
    for i, length in enumerate(lengths):
        new = spheres[before:length]
        for part in np.array_split(np.arange(len(directions)), max(1, len(new) // 200)):
            heights = directions[part] @ new[:, :3].T + new[:, 3]
            covered[part] = np.maximum(covered[part], heights.max(axis=1, initial=-np.inf))
        before = length
        loss = reach - covered
        best = np.argsort(-loss, kind="stable")[:_IMPROVED]
        losses[i] = _improved(points, spheres[:length], directions[best])
    return _falling(losses)


def _falling(values):
    """Return values (k,) that never rise: each is at least the later ones, where a search missed more."""
    return np.maximum.accumulate(np.maximum(values, 0.0)[::-1])[::-1]


def _improved(points, spheres, directions):
    """Return the largest loss found by pattern searches from directions (d, 3) [m]."""
    balls = np.concatenate([points, np.zeros((len(points), 1))], axis=1)
    mesh, packing = _highest(balls, directions), _highest(spheres, directions)
    turn, loss = (
        _FIRST_TURN,
        _extent(mesh, directions[:, None])[:, 0] - _extent(packing, directions[:, None])[:, 0],
    )
    while turn > _LAST_TURN:
        a = np.cross(directions, np.eye(3)[np.abs(directions).argmin(axis=1)])
        a /= np.linalg.norm(a, axis=1, keepdims=True)
        frame = np.stack([a, np.cross(directions, a)], axis=1)
        near = directions[:, None] + turn * np.einsum("tk,dka->dta", _TURNS, frame)
        near /= np.linalg.norm(near, axis=2, keepdims=True)
        found = _extent(mesh, near) - _extent(packing, near)
        best = found.argmax(axis=1)
        better = found.max(axis=1) > loss
        directions = np.where(better[:, None], near[np.arange(len(near)), best], directions)
        loss = np.maximum(loss, found.max(axis=1))
        turn *= _SHORTER
    heights = (directions @ points.T).max(axis=1) - (directions @ spheres[:, :3].T + spheres[:, 3]).max(
        axis=1
    )
    return heights.max()


def _highest(balls, directions):
    """Return for each direction the balls (d, k, 4) that reach farthest."""
    heights = directions @ balls[:, :3].T + balls[:, 3]
    kept = min(_CANDIDATES, len(balls))
    return balls[np.argpartition(-heights, kept - 1, axis=1)[:, :kept]]


def _extent(balls, directions):
    """Return the reach of the balls (d, k, 4) of each group in directions (d, t, 3)."""
    return (directions @ balls[:, :, :3].transpose(0, 2, 1) + balls[:, None, :, 3]).max(axis=2)


def hull(points):
    """Return the corners (h, 3) of the convex hull of points, and its normals (f, 3)."""
    from scipy.spatial import ConvexHull, QhullError

    points, _ = unique_rows(points)
    try:
        found = ConvexHull(points)
    except QhullError:  # too flat
        return points, np.empty((0, 3))
    return points[found.vertices], unique_rows(found.equations[:, :3].round(9))[0]
