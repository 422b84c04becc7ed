"""Shapes of a description as solids: triangles, exact pieces and mass properties."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..checks.errors import InvalidRequestError
from ..checks.validation import positive
from ..shapes.mass_properties import MassProperties, mass_properties
from ..shapes.mesh_pieces import simple_pieces
from ..shapes.pieces import Hull, Lathe, Piece, frustum
from ..shapes.primitive_models import primitive_pieces
from ..shapes.primitives import cone, primitive
from ..shapes.solid_mesh import make_solid, mesh_notes, read_mesh, repaired
from .parts import Shape

_PROFILE = 64  # corners of a spheroid's profile: its piece lies 0.03 % of the radius inside
_BOX = 1e-4  # tolerance of a mesh that is a box, share of its edges and volume, and angle [rad]


class ShapeSolid(NamedTuple):
    """Solid of a shape, in the frame of its link.

    Attributes
    ----------
    vertices : (n, 3) array
        [m]
    faces : (m, 3) array
        Triangles of ``vertices``.
    pieces : tuple of Piece
        Exact for primitives; those of a mesh are empty if it is neither convex nor a simple shape.
    properties : MassProperties
        At uniform density.
    notes : tuple of str
        How the file of a mesh is read, and how it was repaired.
    """

    vertices: np.ndarray
    faces: np.ndarray
    pieces: tuple[Piece, ...]
    properties: MassProperties
    notes: tuple[str, ...] = ()


def shape_solid(shape: Shape, repair: bool = False) -> ShapeSolid:
    """Return the solid of a shape of `parts.SOLIDS`.

    Parameters
    ----------
    shape : Shape
    repair : bool
        Whether to repair a mesh that is not closed.

    Raises
    ------
    InvalidRequestError
        If a size is not positive.
    InvalidMeshError
        If a mesh is not a solid.
    """
    notes: tuple[str, ...] = ()
    pieces: tuple[Piece, ...] = ()
    R, p = shape.pose[:3, :3], shape.pose[:3, 3]
    if shape.convex:
        points = shape.points
        if points is None:
            points, _, notes = mesh_triangles(shape)
        pieces = (Hull(points),)
        vertices, faces = _hull_triangles(pieces[0])
    elif shape.kind == "mesh":
        vertices, faces, notes = mesh_triangles(shape, repair)
    else:
        for length in shape.size:
            positive(length, f"size of a {shape.kind}")
        vertices, faces, pieces = _primitive(shape.kind, shape.size)
    vertices = vertices @ R.T + p
    pieces = tuple(piece.moved(p, R) for piece in pieces)
    if shape.kind == "ellipsoid":
        a, b, c = shape.size
        inertia = R @ np.diag([b * b + c * c, a * a + c * c, a * a + b * b]) @ R.T / 5.0
        properties = MassProperties(4.0 / 3.0 * np.pi * a * b * c, p, inertia)
    elif pieces:
        properties = mass_properties(pieces)
    else:
        solid = make_solid("mesh", vertices, faces)
        simple = simple_pieces(solid)
        pieces = tuple(piece.moved(-solid.origin, np.eye(3)) for piece in simple[0]) if simple else ()
        properties = MassProperties(solid.volume, -solid.origin, solid.inertia)
    return ShapeSolid(vertices, faces, pieces, properties, notes)


def mesh_triangles(shape: Shape, repair: bool = False):
    """Return vertices [m], triangles and notes of a shape's mesh file, scaled, in the frame of the shape."""
    if shape.file is None:
        raise InvalidRequestError("must be there", field="file of a mesh")
    if not np.all(shape.scale):
        raise InvalidRequestError("must not be zero", field="scale of a mesh", value=shape.scale.tolist())
    vertices, faces, _ = read_mesh(shape.file)
    notes, did = mesh_notes(shape.file), []
    if repair:
        vertices, faces, did = repaired(vertices, faces)
    vertices = vertices * shape.scale
    notes = [*notes, *(f"repair: {line}" for line in did)]
    notes = tuple(f"mesh {shape.file.name}: {line}" for line in notes)
    return vertices, faces if np.prod(shape.scale) > 0.0 else faces[:, ::-1], notes


def box_of(vertices: np.ndarray, faces: np.ndarray):
    """Return pose (4, 4) and edges (3,) of a box [m] if triangles are the surface of one; None otherwise."""
    corners = vertices[faces]
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    sizes = np.linalg.norm(areas, axis=1)
    if not np.any(sizes > 0.0):
        return None
    normals, sizes = areas[sizes > 0.0] / sizes[sizes > 0.0, None], sizes[sizes > 0.0]
    first = normals[sizes.argmax()]
    across = np.abs(normals @ first) < _BOX
    if not across.any():
        return None
    second = normals[across][sizes[across].argmax()]
    axes = np.stack([first, second - (second @ first) * first, np.cross(first, second)], axis=1)
    axes /= np.linalg.norm(axes, axis=0)
    if np.abs(normals @ axes).max(axis=1).min() < 1.0 - 0.5 * _BOX**2:
        return None
    low, high = (f(vertices[faces].reshape(-1, 3) @ axes, axis=0) for f in (np.min, np.max))
    middle, edges = axes @ (0.5 * (low + high)), high - low
    arms = corners - middle
    volume = np.einsum("ij,ij->", arms[:, 0], np.cross(arms[:, 1], arms[:, 2])) / 6.0
    if not (edges > 0.0).all() or abs(volume / edges.prod() - 1.0) > _BOX:
        return None
    pose = np.eye(4)
    order = np.abs(axes).argmax(axis=0).argsort()  # the box's axes are near those of the mesh
    axes, edges = axes[:, order], edges[order]
    axes = axes * np.where(axes[np.arange(3), np.arange(3)] < 0.0, -1.0, 1.0)
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    pose[:3, :3], pose[:3, 3] = axes, middle
    return pose, edges


def _primitive(kind, size):
    """Return vertices, triangles and pieces of a primitive about its middle."""
    if kind == "ellipsoid":
        vertices, faces = primitive("sphere", [1.0])
        vertices = vertices * np.asarray(size)
        return vertices, faces, (_ellipsoid(vertices, np.asarray(size, float)),)
    if kind == "cone":
        return *cone(*size), (frustum(size[0], 0.0, size[1]),)
    return *primitive(kind, size), primitive_pieces(kind, size)


def _ellipsoid(vertices, radii):
    """Return the piece of an ellipsoid: a lathe if it is round about an axis, and else a hull."""
    for k, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
        if radii[i] == radii[j]:
            angle = np.linspace(-0.5 * np.pi, 0.5 * np.pi, _PROFILE)
            profile = np.column_stack([radii[i] * np.cos(angle), radii[k] * np.sin(angle)])
            profile[[0, -1], 0] = 0.0
            axes = np.zeros((3, 3))
            axes[i, 0] = axes[j, 1] = axes[k, 2] = 1.0
            return Lathe(profile, axes=axes)
    return Hull(vertices)


def _hull_triangles(hull):
    """Return vertices and triangles of a hull."""
    fans = [[(face[0], face[k], face[k + 1]) for k in range(1, len(face) - 1)] for face in hull.faces]
    return hull.points, np.array([triangle for fan in fans for triangle in fan], np.int64)
