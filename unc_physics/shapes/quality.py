"""Measures of the first spheres of a packing against its mesh: loss of extent, and sink of a ball."""

from __future__ import annotations

import math

import numpy as np

from ..compiler import kernel
from .distance import even_directions
from .solid_mesh import unique_rows
from .triangle_tree import build_triangle_tree, nearest_on_mesh

#: Radius of the ball whose sink is measured [m].
PROBE = 0.010
_STEPS = (1.0, 1.2, 1.4, 1.6, 1.8, 2.0, 2.5, 3.0, 3.5, 4.0, 4.5, 5.0, 6.0, 7.0, 8.0, 9.0)
_DIRECTIONS = 4096
#: Normals of the hull that are used, at most; heights of its corners along them, all and at once (128 MB).
_NORMALS, _HEIGHTS, _AT_ONCE = 8192, 200_000_000, 16_000_000
#: Directions that are improved for each number of spheres, the first and the last turn [rad].
_IMPROVED, _FIRST_TURN, _LAST_TURN, _SHORTER = 48, 0.05, 2e-4, 0.6
#: Points and spheres that are known near to such a direction: those that reach farthest there.
_CANDIDATES = 64
_TURNS = np.array([[1, 0], [0.5, 0.9], [-0.5, 0.9], [-1, 0], [-0.5, -0.9], [0.5, -0.9]])
_PLACES = 12_000  # of the ball on the surface
_CORNERED = 0.01  # of a triangle: how far in from its corners the ball is placed as well
_CLEAR = 1e-6  # of the ball's radius: overlap with the mesh that is round-off


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


def sinks(corners, spheres, lengths) -> np.ndarray:
    """Return how far a ball sinks below the mesh until it touches the first spheres of a packing (k,) [m].

    The ball has the radius `PROBE`. The result is the maximum over places on the surface, at most the ball's
    diameter. The arguments are those of `extent_losses`, with corners
    counter-clockwise as seen from outside.

    Notes
    -----
    The ball touches the mesh from outside at places all over the surface, wherever it has room there, and is
    pushed along the normal.
    """
    places, normals = _places(corners)
    tree = build_triangle_tree(corners)
    clear = PROBE * (1.0 - _CLEAR)
    free = [nearest_on_mesh(tree, *(p + PROBE * n), clear)[0] >= clear for p, n in zip(places, normals)]
    places, normals = places[free], normals[free]
    found = np.empty(len(lengths))
    write_sinks(places, normals, np.ascontiguousarray(spheres), np.asarray(lengths, np.int64), PROBE, found)
    return found


def _places(corners):
    """Return points (p, 3) of the surface, evenly by area and near corners, and the normals there (p, 3)."""
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    double_areas = np.linalg.norm(cross, axis=1)
    corners, cross, double_areas = (x[double_areas > 0.0] for x in (corners, cross, double_areas))
    normals = cross / double_areas[:, None]
    cumulative = np.cumsum(double_areas)
    # the R2 sequence within, steps along the area
    k = np.arange(_PLACES)
    index = np.searchsorted(cumulative, (k + 0.5) / _PLACES * cumulative[-1]).clip(0, len(corners) - 1)
    v, w = (0.7548776662466927 * k) % 1.0, (0.5698402909980532 * k) % 1.0
    v, w = np.where(v + w > 1.0, 1.0 - v, v)[:, None], np.where(v + w > 1.0, 1.0 - w, w)[:, None]
    a, b, c = corners[index].transpose(1, 0, 2)
    middles = corners.mean(axis=1, keepdims=True)
    step = max(1, 3 * len(corners) // _PLACES)
    cornered = (corners + _CORNERED * (middles - corners))[::step]
    return (
        np.concatenate([a + v * (b - a) + w * (c - a), cornered.reshape(-1, 3)]),
        np.concatenate([normals[index], np.repeat(normals[::step], 3, axis=0)]),
    )


@kernel
def write_sinks(places, normals, spheres, lengths, radius, out):
    """Write the maximum over places of how far a ball sinks, for each number of first spheres, to ``out``."""
    for i in range(len(lengths)):
        out[i] = 0.0
    for p in range(len(places)):
        least, begin = 2.0 * radius, 0
        for i in range(len(lengths)):
            for k in range(begin, lengths[i]):
                x, y, z = (
                    places[p, 0] - spheres[k, 0],
                    places[p, 1] - spheres[k, 1],
                    places[p, 2] - spheres[k, 2],
                )
                up = x * normals[p, 0] + y * normals[p, 1] + z * normals[p, 2]
                reach = radius + spheres[k, 3]
                under = reach * reach - (x * x + y * y + z * z - up * up)
                if under > 0.0:
                    # depth at contact; the ball never meets spheres that are wholly above its start
                    sunk = up + radius - math.sqrt(under)
                    if sunk < least and up + radius + math.sqrt(under) > 0.0:
                        least = max(sunk, 0.0)
            begin = lengths[i]
            out[i] = max(out[i], least)


def hull(points):
    """Return the corners (h, 3) of the convex hull of points, and its normals (f, 3)."""
    from scipy.spatial import ConvexHull, QhullError

    points, _ = unique_rows(points)
    try:
        found = ConvexHull(points)
    except QhullError:  # too flat
        return points, np.empty((0, 3))
    return points[found.vertices], unique_rows(found.equations[:, :3].round(9))[0]
