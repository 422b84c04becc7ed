"""Triangle meshes of bodies and elements of the environment."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from ..checks.errors import InvalidMeshError
from ..scene.environment import Element
from ..shapes.packing_file import SpherePacking
from ..shapes.primitives import primitive

_PLANE = 0.01  # m, thickness of a drawn plane
_RAYS, _HALVINGS = 4, 40  # subdivisions of an icosahedron, and steps of bisection along each of its corners
_OFF = 0.02  # tolerance between a mesh and its model, relative to the model's size


def joined_spheres(model: SpherePacking, count: int, subdivisions: int) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices and triangles of a model's largest spheres, body frame [m]."""
    vertices, faces = primitive("sphere", (1.0,), subdivisions)
    centers, radii = model.centers[:count], model.radii[:count]
    points = centers[:, None] + radii[:, None, None] * vertices
    shift = len(vertices) * np.arange(len(centers))
    return points.reshape(-1, 3), (faces + shift[:, None, None]).reshape(-1, 3)


def fitted_mesh(path: str | os.PathLike[str], model: SpherePacking) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices and triangles of the mesh from which a model was packed, scaled to it, body frame [m].

    Raises `InvalidMeshError` if the file is not a mesh, or its proportions differ from the model.
    """
    from ..shapes.solid_mesh import read_mesh

    vertices, faces, _ = read_mesh(Path(path))
    if model.bounds is not None:
        size = np.linalg.norm(model.bounds[1] - model.bounds[0])
        vertices = vertices * float(size / np.linalg.norm(np.ptp(vertices, axis=0)))
        corners = np.stack([vertices.min(axis=0), vertices.max(axis=0)]) + model.origin
        if not np.abs(corners - model.bounds).max() < _OFF * size:
            raise InvalidMeshError(f"is not what model '{model.name}' was packed from", field=f"mesh {path}")
    return vertices + model.origin, faces


def element_mesh(element: Element, extent: float) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices and triangles of an element of the environment, element frame [m].

    A plane is a slab that extends ``extent`` to each side. A shape without a mesh of its own is drawn by
    `surface_mesh`.
    """
    size = element.size_row
    if element.shape == "plane":
        vertices, faces = primitive("box", (2.0 * extent, 2.0 * extent, _PLANE))
        return vertices - [0.0, 0.0, 0.5 * _PLANE], faces
    if element.shape == "sphere":
        return primitive("sphere", (size[0],))
    if element.shape in ("cylinder", "capsule"):
        return primitive(element.shape, (size[0], 2.0 * size[1]))
    if element.shape == "box":
        return primitive("box", tuple((2.0 * size).tolist()))
    return surface_mesh(element)


def surface_mesh(element: Element) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices and triangles of a bounded convex element from its signed distance, element frame [m].

    The vertices are where rays from a point inside leave the solid, so sharp edges are cut.
    """

    def surface(points):
        distance, normal = element.surface(points @ element.rotation.T + element.position)
        return distance, normal @ element.rotation

    low, high = element.bounds
    middle = 0.5 * (low + high)
    (distance,), (normal,) = surface(middle[None])
    if distance >= 0.0:  # move to the nearest surface point, and as far below it
        middle = middle - (distance + 1e-3 * np.linalg.norm(high - low)) * normal
    rays, faces = primitive("sphere", (1.0,), _RAYS)
    near, far = np.zeros(len(rays)), np.full(len(rays), np.linalg.norm(high - low))
    for _ in range(_HALVINGS):
        half = 0.5 * (near + far)
        inside = surface(middle + half[:, None] * rays)[0] < 0.0
        near, far = np.where(inside, half, near), np.where(inside, far, half)
    return middle + near[:, None] * rays, faces


def quaternion_of(R: np.ndarray) -> np.ndarray:
    """Return the quaternion (w, x, y, z) of a rotation matrix, as viser expects."""
    from scipy.spatial.transform import Rotation

    return np.roll(Rotation.from_matrix(R).as_quat(), 1)
