"""Triangles of prisms and cones, their middle at the origin."""

from __future__ import annotations

import numpy as np

from ..checks.errors import InvalidMeshError

#: Sides of what is round; the farthest that a side is from the circle is 0.1 % of its radius.
SEGMENTS = 64
_FLAT = 1e-9  # of a polygon's size squared: a corner that turns by less is straight


def prism(polygon: np.ndarray, height: float) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and triangles of a convex polygon (n, 2) in the plane z = 0, spread over a height along z [m].

    Raises `InvalidMeshError` if the polygon has fewer than three corners, or is not convex.
    """
    polygon = _convex(polygon)
    count, half = len(polygon), 0.5 * height
    level = np.ones((count, 1))
    vertices = np.vstack([np.hstack([polygon, -half * level]), np.hstack([polygon, half * level])])
    k, following = np.arange(count), np.roll(np.arange(count), -1)
    sides = np.vstack(
        [
            np.column_stack([k, following, following + count]),
            np.column_stack([k, following + count, k + count]),
        ]
    )
    fan = np.column_stack([np.zeros(count - 2, int), k[1:-1], k[2:]])
    return vertices, np.vstack([sides, fan[:, ::-1], fan + count])


def cone(radius: float, height: float) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and triangles of a cone along z, its tip up, its middle halfway between base and tip [m]."""
    circle, half = _circle(radius), 0.5 * height
    base = np.hstack([circle, np.full((SEGMENTS, 1), -half)])
    vertices = np.vstack([base, [[0.0, 0.0, half]]])
    k = np.arange(SEGMENTS)
    sides = np.column_stack([k, np.roll(k, -1), np.full(SEGMENTS, SEGMENTS)])
    return vertices, np.vstack([sides, np.column_stack([np.zeros(SEGMENTS - 2, int), k[2:], k[1:-1]])])


def _circle(radius):
    """(n, 2): corners of a polygon of the circle's area."""
    angle = 2.0 * np.pi * np.arange(SEGMENTS) / SEGMENTS
    step = 2.0 * np.pi / SEGMENTS
    return radius * np.sqrt(step / np.sin(step)) * np.column_stack([np.cos(angle), np.sin(angle)])


def _convex(polygon):
    """The polygon (n, 2), counter-clockwise."""
    polygon = np.asarray(polygon, float)
    if polygon.ndim != 2 or len(polygon) < 3:
        raise InvalidMeshError("must have at least three corners", field="polygon", value=len(polygon))
    edges = np.roll(polygon, -1, axis=0) - polygon
    after = np.roll(edges, -1, axis=0)
    turns = edges[:, 0] * after[:, 1] - edges[:, 1] * after[:, 0]
    slack = _FLAT * np.ptp(polygon, axis=0).max() ** 2
    once = np.abs(np.arctan2(turns, (edges * after).sum(axis=1))).sum() < 2.0 * np.pi + 1e-6
    if not once or not ((turns > -slack).all() or (turns < slack).all()):
        raise InvalidMeshError("must be convex", field="polygon")
    return polygon if turns.sum() > 0.0 else polygon[::-1]
