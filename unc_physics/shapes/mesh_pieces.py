"""Pieces of a mesh: a simple shape that is recognised, else its hull, else a convex decomposition."""

from __future__ import annotations

import contextlib
import math
import threading
import time
from collections.abc import Sequence
from importlib.util import find_spec
from typing import Any, NamedTuple

import numpy as np

from ..checks.errors import (
    InvalidMeshError,
    InvalidModelError,
    InvalidOptionError,
    NotSupportedError,
    UncPhysicsError,
)
from ..checks.shown import counted
from .convex_parts import convex_parts
from .packing_file import HULL
from .piece_file import PIECES_LIMIT
from .pieces import Hull, Piece
from .recognition import recognized
from .solid_mesh import SolidMesh, unique_rows
from .surface_error import SurfaceError, surface_error

#: Number of pieces of a mesh, if no other number is asked for.
PIECES = 32
#: Share of its hull that a mesh fills that is taken for convex.
CONVEX = 0.97
#: Surface errors as shares of the extent: the 99th percentile that deserves a note, the largest one allowed.
NOTED, REFUSED = 0.02, 0.10
#: Concavities at which coacd stops to cut. The first suits most meshes; a coarser one is at times nearer, and
#: finer ones are for thin walls. They are tried until the error is allowed, and deserves no note.
_THRESHOLDS = (0.05, 0.1, 0.02, 0.01)
#: Share of the extent by which a mesh is simplified before it is cut.
_SIMPLIFIED = 0.003
#: Share of the extent by which a mesh is outside its hull, at most: the hull's number of corners follows. Up
#: to some corners, as of polyhedra, all are kept.
HULL_DEPTH, _KEPT = 0.002, 96
#: Errors that differ by less, as a share of the extent, are equal: then fewer pieces are better.
_EQUAL = 0.001
#: Share of the extent that hollow surfaces of revolution stick out, at least, if a number of pieces is given.
_FINEST = 2e-4
#: How far they may stick out over the tolerance: up to twice, as half is on either side; once in thin walls.
_SHARES = (1.9, 1.4, 0.96)
_AT_ONCE = 4_000_000  # heights of points above faces: 32 MB
_STARTS = np.array([[x, y, z] for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if x or y or z])


class MeshPieces(NamedTuple):
    """Pieces of a mesh.

    Attributes
    ----------
    pieces : tuple of Piece
        In the body frame [m].
    kind : str
        What they are: the names of recognised shapes, 'hull' or 'convex decomposition'.
    error : SurfaceError
        Distances between the surfaces of the mesh and of the pieces [m].
    extent : float
        Longest edge of the mesh's bounding box [m].
    """

    pieces: tuple[Piece, ...]
    kind: str
    error: SurfaceError
    extent: float

    @property
    def entries(self) -> dict[str, Any]:
        """Fields of a `SpherePacking` that hold the pieces."""
        return {"pieces": self.pieces, "pieces_kind": self.kind, "pieces_error": np.array(self.error)}

    @property
    def note(self) -> str | None:
        """A sentence if the pieces are far from the mesh, or None."""
        if self.error.high <= NOTED * self.extent:
            return None
        share, finer = self.error.high / self.extent, 0.5 * self.error.largest
        return (
            f"1 % of the surface is {1e3 * self.error.high:.2g} mm or more off the pieces,"
            f" which is {share:.1%} of the extent; tolerance={finer:.1g} [m] asks for more and finer pieces"
        )


def simple_pieces(
    solid: SolidMesh, most: int | None = None, tolerance: float | None = None
) -> tuple[tuple[Piece, ...], str] | None:
    """Return pieces and their kind if each component of a solid is a simple shape or convex, else None.

    Sealed cavities are filled, as no other body gets there. The other arguments are those of `mesh_pieces`.
    """
    pieces: list[Piece] = []
    kinds: list[str] = []
    for corners in solid.parts:
        found = _component(corners, most, tolerance)
        if found is None:
            return None
        kinds.append(found[0])
        pieces += found[1]
    counts = {kind: kinds.count(kind) for kind in kinds}
    kind = ", ".join(name if n == 1 else f"{name} ({n} times)" for name, n in counts.items())
    return (tuple(pieces), kind) if len(pieces) <= PIECES_LIMIT else None


def hull_pieces(solid: SolidMesh) -> MeshPieces:
    """Return the convex hull of a solid that is not convex, as its piece.

    Raises `InvalidMeshError` if it is too flat.
    """
    hull = _hull_or_none(solid.corners.reshape(-1, 3), HULL_DEPTH * _extent(solid))
    if hull is None:
        raise InvalidMeshError("is too flat for a hull", field=f"mesh {solid.name}")
    return measured_pieces((hull,), HULL, solid)


def mesh_pieces(
    solid: SolidMesh,
    most: int | None = None,
    tolerance: float | None = None,
    seconds: float | None = None,
    threads: int | None = None,
    stop: threading.Event | None = None,
) -> MeshPieces:
    """Return the pieces of a solid.

    A component of boxes, a cylinder, sphere, capsule or surface of revolution is recognised, and one that
    fills 97 % of its hull is its hull. Other solids are cut by the library coacd. Up to four settings are
    tried, and the result with the smallest surface error is kept: more pieces are not always nearer.

    Parameters
    ----------
    solid : SolidMesh
    most : int, optional
        Number of pieces, at most; a hollow surface of revolution may need more. By default 32, or with a
        tolerance as many as it takes.
    tolerance : float, optional
        Largest surface error [m]; pieces are made finer until they are within it. By default 10 % of the
        extent, for which nothing is made finer.
    seconds : float, optional
        Time for cutting; the best result until then is kept.
    threads : int, optional
        Threads for cutting; the result does not depend on it.
    stop : threading.Event, optional
        Cutting ends when it is set, as when the time is over.

    Raises
    ------
    InvalidOptionError
        If ``most`` is not an integer from 1 to 10 000, or the tolerance is not positive.
    InvalidMeshError
        If the surface error is larger than the tolerance.
    NotSupportedError
        If the solid must be cut and coacd is not installed.
    TimeoutError
        If the time was not enough for a first result.
    """
    is_number = isinstance(most, (int, np.integer)) and not isinstance(most, bool)
    if most is not None and not (is_number and 1 <= most <= PIECES_LIMIT):
        raise InvalidOptionError(f"must be an integer from 1 to {PIECES_LIMIT}", field="pieces", value=most)
    if tolerance is not None and not 0.0 < tolerance < np.inf:
        raise InvalidOptionError("must be a positive number", field="tolerance", value=tolerance)
    simple = simple_pieces(solid, most, tolerance)
    found = (
        measured_pieces(*simple, solid)
        if simple
        else _decomposed(solid, most, tolerance, seconds, threads, stop)
    )
    limit = REFUSED * found.extent if tolerance is None else tolerance
    if found.error.largest > limit:
        allowed = f"tolerance={1.1 * found.error.largest:.2g} [m] allows it"
        if most is not None or tolerance is None:  # else there are as many pieces as it takes
            allowed = f"most={2 * (most or PIECES)} asks for more pieces, and {allowed}"
        raise InvalidMeshError(
            f"is {1e3 * found.error.largest:.3g} mm off its {counted(len(found.pieces), 'piece')}, and"
            f" {1e3 * limit:.3g} mm are allowed; {allowed}",
            field=f"mesh {solid.name}",
        )
    return found


def best_pieces(
    solid: SolidMesh, seconds: float | None = None, threads: int | None = None
) -> MeshPieces | None:
    """Return the pieces of a solid, or its hull if it cannot be cut; None if it is too flat for one.

    The arguments are those of `mesh_pieces`.
    """
    try:
        return mesh_pieces(solid, seconds=seconds, threads=threads)
    except (UncPhysicsError, TimeoutError):
        with contextlib.suppress(InvalidMeshError):
            return hull_pieces(solid)
    return None


def hull_piece(points: np.ndarray, depth: float) -> Hull:
    """Return the convex hull of points (n, 3), without corners that are not needed if there are many.

    Corners are added where points are farthest from the hull's faces, until none is farther outside than a
    depth [m].
    """
    from scipy.spatial import ConvexHull

    corners = points[ConvexHull(points).vertices]
    if len(corners) <= _KEPT:
        return Hull(corners)
    chosen = np.unique((corners @ _STARTS.T).argmax(axis=0))
    left = np.setdiff1d(np.arange(len(corners)), chosen)
    while True:
        inner = ConvexHull(corners[chosen])  # anew, as Qhull fails where it adds coplanar points
        face, outside = _farthest_face(corners[left], inner.equations)
        far = outside > depth
        left, face, outside = left[far], face[far], outside[far]
        if not far.any():
            return Hull(corners[np.sort(chosen)])
        blocked, new = np.zeros(len(inner.simplices), bool), []
        for k in np.argsort(-outside, kind="stable"):
            if not blocked[face[k]]:  # one for each face, and none beside another of this round
                new.append(k)
                blocked[[face[k], *inner.neighbors[face[k]]]] = True
        chosen, left = np.append(chosen, left[new]), np.delete(left, new)


def _farthest_face(points, planes):
    """Return for each point (n, 3) the plane (f, 4) that it is farthest above, and how far."""
    parts = np.array_split(points, len(points) * len(planes) // _AT_ONCE + 1)
    face, height = np.empty(0, np.int64), np.empty(0)
    for part in parts:
        heights = part @ planes[:, :3].T + planes[:, 3]
        face, height = np.append(face, heights.argmax(axis=1)), np.append(height, heights.max(axis=1))
    return face, height


def _extent(solid):
    return float(np.ptp(solid.bounds, axis=0).max())


def measured_pieces(pieces: Sequence[Piece], kind: str, solid: SolidMesh) -> MeshPieces:
    """Return given pieces of a solid with their surface error."""
    error = surface_error(pieces, np.concatenate(solid.parts))
    return MeshPieces(tuple(pieces), kind, error, _extent(solid))


def _component(corners, most, tolerance):
    """Return the name and the pieces of a component that is a simple shape or fills its hull, else None."""
    finest = None if most is None else _FINEST * float(np.ptp(corners, axis=(0, 1)).max())
    found = recognized(corners, most or PIECES, finest)
    if found is None or tolerance is None:
        return found or _convex(corners, tolerance)
    for share in (0.0, *(_SHARES if most is None else ())):
        finer = recognized(corners, PIECES_LIMIT, share * tolerance) if share else found
        if finer is not None and surface_error(finer[1], corners).largest <= tolerance:
            return finer
    return _convex(corners, tolerance) or found  # few sides are nearer to their hull than to a cylinder


def _convex(corners, tolerance):
    """Return the hull of a component if it fills it, else None."""
    from scipy.spatial import ConvexHull, QhullError

    points = corners.reshape(-1, 3)
    try:
        volume = ConvexHull(points).volume
        inside = np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6.0
        if inside < CONVEX * volume:
            return None
        return "hull", (hull_piece(points, _hull_depth(float(np.ptp(points, axis=0).max()), tolerance)),)
    except (QhullError, InvalidModelError):  # too flat
        return None


def _hull_depth(extent, tolerance):
    """Return how far a mesh of an extent may be outside its hull [m]."""
    return HULL_DEPTH * extent if tolerance is None else min(HULL_DEPTH * extent, tolerance)


def _decomposed(solid, most, tolerance, seconds, threads, stop) -> MeshPieces:
    """Return the best of a few decompositions."""
    if find_spec("coacd") is None:
        raise NotSupportedError(
            "is not convex, and coacd, which cuts it into convex pieces, is not installed: pip install coacd",
            field=f"mesh {solid.name}",
        )
    extent = _extent(solid)
    end = math.inf if seconds is None else time.monotonic() + seconds

    def goes_on():
        return time.monotonic() < end and not (stop is not None and stop.is_set())

    vertices, faces = _simplified(np.concatenate(solid.parts), _SIMPLIFIED * extent)
    count = most or (PIECES if tolerance is None else PIECES_LIMIT)
    depth = _hull_depth(extent, tolerance)
    best: MeshPieces | None = None
    limit = REFUSED * extent if tolerance is None else tolerance
    for threshold in _THRESHOLDS:
        try:
            parts = convex_parts(vertices, faces, threshold, count, goes_on, threads)
        except TimeoutError:
            if best is None:
                raise
            break
        hulls = [hull for part in parts if (hull := _hull_or_none(part, depth)) is not None]
        found = measured_pieces(hulls, "convex decomposition", solid)
        if best is None or _rank(found) < _rank(best):
            best = found
        if best.error.largest <= limit and not best.note:
            break
    assert best is not None
    return best


def _rank(found):
    return round(found.error.high / (_EQUAL * found.extent)), len(found.pieces), found.error.largest


def _hull_or_none(points, tolerance):
    """Return the hull of points, or None if they are in a plane."""
    from scipy.spatial import QhullError

    try:
        return hull_piece(points, tolerance)
    except (QhullError, InvalidModelError):
        return None


def _simplified(corners, tolerance):
    """Return vertices and triangles of a mesh, with fewer of them if manifold3d is installed."""
    vertices, number = unique_rows(corners.reshape(-1, 3))
    faces = number.reshape(-1, 3)
    if find_spec("manifold3d") is not None:
        import manifold3d

        mesh = manifold3d.Mesh(vertices.astype(np.float32), faces.astype(np.uint32))
        less = manifold3d.Manifold(mesh).simplify(tolerance)
        if less.status() == manifold3d.Error.NoError and less.num_tri() > 0:
            mesh = less.to_mesh()
            return np.asarray(mesh.vert_properties, float)[:, :3], np.asarray(mesh.tri_verts, np.int64)
    return vertices, faces
