"""Triangles of a piece's surface, to be drawn and to be measured."""

from __future__ import annotations

import numpy as np

from .distance import even_directions
from .pieces import HalfSpace, Hull, Piece

#: Corners around a whole turn of a lathe: 0.01 % of the radius is cut off.
AROUND = 192
_ROUND = 96  # directions on the ball that sweeps a piece


def piece_mesh(piece: Piece, around: int = AROUND) -> np.ndarray:
    """Return triangles (m, 3, 3) of a piece's surface, counter-clockwise from outside [m].

    What is round has corners on the surface, ``around`` of them around a whole turn of a lathe. A half-space
    has none.
    """
    from scipy.spatial import ConvexHull

    if isinstance(piece, HalfSpace):
        return np.zeros((0, 3, 3))
    points = piece.points if isinstance(piece, Hull) else _arcs(piece, around)
    if piece.rounding > 0.0:
        swept = points[:, None] + piece.rounding * even_directions(_ROUND)
        points = swept.reshape(-1, 3)
    found = ConvexHull(points)
    triangles = points[found.simplices]
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    inward = np.einsum("ij,ij->i", normals, found.equations[:, :3]) < 0.0
    triangles[inward] = triangles[inward, ::-1]
    return triangles


def _arcs(lathe, around):
    """Return points (n, 3) on the arcs of a lathe's profile."""
    count = max(2, round(around * lathe.half_angle / np.pi)) + 1
    angles = lathe.azimuth + np.linspace(-lathe.half_angle, lathe.half_angle, count)
    radius, height = lathe.profile.T
    local = [np.column_stack([radius * np.cos(a), radius * np.sin(a), height]) for a in angles]
    return np.concatenate(local) @ lathe.axes.T + lathe.origin
