"""Triangles of simple shapes, by trimesh: to be packed, or to be drawn."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

_AROUND, _ALONG = 192, 64  # corners around what is round: 0.013 % of the radius are cut off
_SUBDIVISIONS = 3  # of a ball

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
    elif kind == "cylinder":
        mesh = create.cylinder(size[0], size[1], sections=_AROUND)
    else:
        mesh = create.capsule(height=size[1], radius=size[0], count=[_ALONG, _AROUND])
        mesh.apply_translation(-mesh.bounds.mean(axis=0))
    return np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64)
