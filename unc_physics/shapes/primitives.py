"""Triangles of simple shapes about their middle: to be packed, or to be drawn."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..checks.errors import InvalidMeshError

_AROUND, _ALONG = 192, 64  # corners around what is round: 0.013 % of the radius are cut off
_SUBDIVISIONS = 3  # of a ball
#: Sides of what is round; the farthest that a side is from the circle is 0.1 % of its radius.
SEGMENTS = 64
_FLAT = 1e-9  # of a polygon's size squared: a corner that turns by less is straight

#: The shapes, and how many numbers their size has.
PRIMITIVES = {"box": 3, "sphere": 1, "cylinder": 2, "capsule": 2}


def primitive(kind: str, size: Sequence[float], subdivisions: int = _SUBDIVISIONS):
    """Return vertices (n, 3) and triangles (m, 3) of a shape of `PRIMITIVES` about its middle.

    Its size is of a box the edges, of a sphere the radius, of a cylinder and a capsule the radius and the
    length of the straight part, along z [m]. ``subdivisions`` says how fine a sphere is.
    """
    import trimesh

    create = trimesh.creation
    if kind == "box":
        mesh = create.box(size)
    elif kind == "sphere":
        mesh = create.icosphere(subdivisions=subdivisions, radius=size[0])
    else:
        # trimesh joins corners by their distance in metres; a power of two as the unit rounds nothing
        unit = 2.0 ** np.floor(np.log2(size[0]))
        radius, length = size[0] / unit, size[1] / unit
        if kind == "cylinder":
            mesh = create.cylinder(radius, length, sections=_AROUND)
        else:
            mesh = create.capsule(height=length, radius=radius, count=[_ALONG, _AROUND])
            mesh.apply_translation(-mesh.bounds.mean(axis=0))
        mesh.apply_scale(unit)
    return np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64)


def prism(polygon: np.ndarray, height: float) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices and triangles of a prism along z, of a convex polygon (n, 2), centred at z = 0 [m].

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
    """Return vertices and triangles of a cone along z, tip up, with half of its height at z = 0 [m]."""
    circle, half = _circle(radius), 0.5 * height
    base = np.hstack([circle, np.full((SEGMENTS, 1), -half)])
    vertices = np.vstack([base, [[0.0, 0.0, half]]])
    k = np.arange(SEGMENTS)
    sides = np.column_stack([k, np.roll(k, -1), np.full(SEGMENTS, SEGMENTS)])
    return vertices, np.vstack([sides, np.column_stack([np.zeros(SEGMENTS - 2, int), k[2:], k[1:-1]])])


def _circle(radius):
    """Return corners (n, 2) of a regular polygon that has the circle's area."""
    angle = 2.0 * np.pi * np.arange(SEGMENTS) / SEGMENTS
    step = 2.0 * np.pi / SEGMENTS
    return radius * np.sqrt(step / np.sin(step)) * np.column_stack([np.cos(angle), np.sin(angle)])


def _convex(polygon):
    """Return a polygon (n, 2) counter-clockwise; raise `InvalidMeshError` if it is not convex."""
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
