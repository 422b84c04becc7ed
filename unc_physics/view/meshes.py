"""Triangles of what is drawn: bodies and elements of the environment."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from ..checks.errors import InvalidMeshError
from ..geometry.packing_file import SpherePacking
from ..geometry.primitives import primitive
from ..scene.environment import Element

_PLANE = 0.01  # m, thickness of what a plane is drawn as
_OFF = 0.02  # of a model's size, how far its mesh may be from it


def joined_spheres(model: SpherePacking, count: int, subdivisions: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and triangles of a model's largest spheres together, body frame [m]."""
    vertices, faces = primitive("sphere", (1.0,), subdivisions)
    centers, radii = model.centers[:count], model.radii[:count]
    points = centers[:, None] + radii[:, None, None] * vertices
    shift = len(vertices) * np.arange(len(centers))
    return points.reshape(-1, 3), (faces + shift[:, None, None]).reshape(-1, 3)


def fitted_mesh(path: str | os.PathLike[str], model: SpherePacking) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and triangles of the mesh that a model was packed from, body frame [m], in the model's scale.

    Raises
    ------
    InvalidMeshError
        If the file is no mesh, or one of other proportions than the model.
    """
    from ..geometry.solid_mesh import read_mesh

    vertices, faces, _ = read_mesh(Path(path))
    if model.bounds is not None:
        size = np.linalg.norm(model.bounds[1] - model.bounds[0])
        vertices = vertices * float(size / np.linalg.norm(np.ptp(vertices, axis=0)))
        corners = np.stack([vertices.min(axis=0), vertices.max(axis=0)]) + model.origin
        if not np.abs(corners - model.bounds).max() < _OFF * size:
            raise InvalidMeshError(f"is not what model '{model.name}' was packed from", field=f"mesh {path}")
    return vertices + model.origin, faces


def element_mesh(element: Element, extent: float) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and triangles of an element of the environment, its own frame [m].

    A shape that is not known here is drawn as its bounding box, a plane as a slab that reaches as far as
    ``extent`` to each side.
    """
    size = element.size_row
    if element.shape == "plane":
        vertices, faces = primitive("box", (2.0 * extent, 2.0 * extent, _PLANE))
        return vertices - [0.0, 0.0, 0.5 * _PLANE], faces
    if element.shape == "sphere":
        return primitive("sphere", (size[0],))
    if element.shape in ("cylinder", "capsule"):
        return primitive(element.shape, (size[0], 2.0 * size[1]))
    low, high = element.bounds
    vertices, faces = primitive("box", tuple((high - low).tolist()))
    return vertices + 0.5 * (low + high), faces


def quaternion_of(R: np.ndarray) -> np.ndarray:
    """(4,): quaternion (w, x, y, z), as the page has them, of a rotation matrix."""
    from trimesh.transformations import quaternion_from_matrix

    T = np.eye(4)
    T[:3, :3] = R
    return quaternion_from_matrix(T)
