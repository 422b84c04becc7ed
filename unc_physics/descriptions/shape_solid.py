"""Shapes of a description as solids: triangles, exact pieces and mass properties."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..checks.errors import InvalidMeshError, InvalidRequestError
from ..checks.validation import positive
from ..shapes.mass_properties import MassProperties, mass_properties
from ..shapes.mesh_pieces import simple_pieces
from ..shapes.pieces import Hull, Lathe, Piece, frustum
from ..shapes.primitive_models import primitive_pieces
from ..shapes.primitives import cone, primitive
from ..shapes.recognition import CHORDS, recognized, rotation_to
from ..shapes.solid_mesh import make_solid, mesh_notes, read_mesh, repaired
from ..shapes.surface_error import distances_of_points
from .parts import PRIMITIVES, Shape

_PROFILE = 64  # corners of a spheroid's profile: its piece lies 0.03 % of the radius inside
#: Tolerance of a mesh that is a primitive: shares of its shortest edge, and of its longest one.
_NEAR, _ROUND_OFF = 1e-4, 1e-6


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


def simple_shape(vertices: np.ndarray, faces: np.ndarray):
    """Return kind, pose (4, 4) and sizes [m] of the primitive whose surface triangles are, or None.

    Kinds and sizes are those of `Shape`: box, sphere, cylinder and capsule.
    """
    try:
        solid = make_solid("mesh", vertices, faces)
    except InvalidMeshError:
        return None
    found = recognized(solid.corners, 1)
    if found is None or len(solid.parts[0]) < len(solid.corners):
        return None
    kind, (piece, *others) = found
    edges = np.ptp(solid.bounds, axis=0)
    points = solid.corners.reshape(-1, 3)
    if kind == "box":
        points = np.concatenate([points, solid.corners.mean(axis=1)])
    near = max(_NEAR * float(edges.min()), _ROUND_OFF * float(edges.max()))
    if kind not in PRIMITIVES or others:
        return None
    away = distances_of_points([piece], points)
    sagitta = 0.0 if kind == "box" else CHORDS * 0.5 * float(edges.min())
    if away.max() > near or away.min() < -near - sagitta:
        return None
    pose = np.eye(4)
    if isinstance(piece, Lathe):
        low, high = piece.profile[:, 1].min(), piece.profile[:, 1].max()
        pose[:3, :3] = piece.axes
        middle = piece.origin + 0.5 * (low + high) * piece.axes[:, 2]
        sizes = [piece.profile[:, 0].max(), high - low]
    else:
        assert isinstance(piece, Hull)
        ends = piece.points
        middle, sizes = ends.mean(axis=0), [piece.rounding]
        if kind == "capsule":
            sizes.append(float(np.linalg.norm(ends[1] - ends[0])))
            pose[:3, :3] = rotation_to((ends[1] - ends[0]) / sizes[1])
        elif kind == "box":
            arms = (ends[[4, 2, 1]] - ends[0]).T
            arms = arms[:, np.abs(arms / np.linalg.norm(arms, axis=0)).argmax(axis=0).argsort()]
            sizes = np.linalg.norm(arms, axis=0)
            axes = arms / sizes * np.where(np.diag(arms) < 0.0, -1.0, 1.0)  # near those of the mesh
            axes[:, 2] *= np.sign(np.linalg.det(axes))
            pose[:3, :3] = axes
    pose[:3, 3] = middle - solid.origin
    return kind, pose, tuple(map(float, sizes))


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
