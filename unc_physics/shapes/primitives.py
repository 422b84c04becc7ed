"""Triangles of simple shapes about their middle: to be packed, or to be drawn."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..checks.errors import InvalidMeshError
from .household_meshes import lofted
from .pieces import convex_outline, polygon_area

_AROUND, _ALONG = 192, 64  # corners around what is round: 0.013 % of the radius are cut off
_SUBDIVISIONS = 3  # of a ball
#: Sides of what is round; the farthest that a side is from the circle is 0.1 % of its radius.
SEGMENTS = 64
_FLAT = 1e-9  # of a polygon's area, by which it may be less than that of its hull: round-off

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
    polygon = np.asarray(polygon, float)
    if polygon.ndim != 2 or len(polygon) < 3:
        raise InvalidMeshError("must have at least three corners", field="polygon", value=len(polygon))
    outline = convex_outline(polygon)
    area = polygon_area(outline)
    if abs(abs(polygon_area(polygon)) - area) > _FLAT * area:
        raise InvalidMeshError("must be convex", field="polygon")
    ends = [np.column_stack([outline, np.full(len(outline), z)]) for z in (-0.5 * height, 0.5 * height)]
    return lofted(ends, *(end.mean(axis=0) for end in ends))


def cone(radius: float, height: float) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices and triangles of a cone along z, tip up, with half of its height at z = 0 [m].

    Its base is a regular polygon that has the circle's area.
    """
    angle = np.linspace(0.0, 2.0 * np.pi, SEGMENTS, endpoint=False)
    radius = radius * np.sqrt(angle[1] / np.sin(angle[1]))
    base = [radius * np.cos(angle), radius * np.sin(angle), np.full(SEGMENTS, -0.5 * height)]
    return lofted([np.column_stack(base)], -0.5 * height, 0.5 * height)
