"""Convex bodies as spheres in their corners, which rest, tip and roll on planes like the solids."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial import ConvexHull

from unc_physics.shapes.packing_file import SpherePacking
from unc_physics.spatial.rotation import rotation_matrix

SHARP = 1e-4  # m, radius of a sharp corner
_ALIKE = 0.02  # rad, within which two facets are one face
_MOST = 24  # faces, above which a body is round


class Polyhedron(NamedTuple):
    """A convex solid.

    Attributes
    ----------
    name : str
    vertices : (n, 3) array
        In the body frame [m].
    inertia : (3, 3) array
        Per unit mass, about the centre of mass [m^2].
    """

    name: str
    vertices: np.ndarray
    inertia: np.ndarray

    def packing(self, corner_radius: float = SHARP) -> SpherePacking:
        """Return a packing with a sphere in each corner, with the solid's faces and rounded corners."""
        normals, offsets = _faces(self.vertices)
        reach = 1e-6 * np.abs(offsets).max()
        centers = []
        for vertex in self.vertices:
            at = np.abs(normals @ vertex - offsets) < reach
            centers.append(np.linalg.lstsq(normals[at], offsets[at] - corner_radius, rcond=None)[0])
        centers = np.array(centers)
        return SpherePacking(
            self.name,
            centers,
            np.full(len(centers), corner_radius),
            inertia=self.inertia,
            volume=float(ConvexHull(self.vertices).volume),
            origin=np.zeros(3),
            bounding_radius=float(np.linalg.norm(centers, axis=1).max() + corner_radius),
        )


def box(name: str, sides: np.ndarray) -> Polyhedron:
    """A solid box with sides (3,) [m]."""
    half = 0.5 * np.asarray(sides, float)
    corners = np.stack(np.meshgrid(*[(-1.0, 1.0)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    return Polyhedron(name, half * corners, np.diag((half @ half - half**2) / 3.0))


def face_normals(packing: SpherePacking) -> np.ndarray | None:
    """Return the outward normals (F, 3) of a body's faces in the body frame; None if it is round."""
    if len(packing.centers) < 4 or np.linalg.matrix_rank(packing.centers - packing.centers[0], 1e-6) < 3:
        return None
    normals = _faces(packing.centers)[0]
    return normals if len(normals) <= _MOST else None


def lowest_face(states: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Return the index (n,) of the most downward face in each of the states (n, 13)."""
    downwards = np.array([-rotation_matrix(q)[2] for q in states[:, 6:10]])
    return np.argmax(downwards @ normals.T, axis=1)


def _faces(points):
    """Return normals (F, 3) and offsets (F,) of the hull's faces; coplanar facets are one face."""
    normals, offsets = [], []
    for *normal, offset in ConvexHull(points).equations:
        if all(np.dot(normal, other) < np.cos(_ALIKE) for other in normals):
            normals.append(normal)
            offsets.append(-offset)
    return np.array(normals), np.array(offsets)
