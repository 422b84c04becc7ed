"""Closed triangle meshes as solids: reading, checks, repair, mass properties. Reads meshes with trimesh."""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
from dataclasses import dataclass, replace
from functools import cached_property
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from ..checks.errors import InvalidMeshError, InvalidModelError, UncPhysicsError
from ..checks.memory import require_memory
from ..checks.shown import counted
from .packing_file import check_inertia
from .triangle_tree import build_triangle_tree, winding_numbers

_BYTES_PER_BYTE = 30.0  # of memory, for each of a mesh's file
#: Formats that state their unit; trimesh reads it.
_WITH_UNIT = {".3mf": "millimeter", ".dae": "meter", ".glb": "meter", ".gltf": "meter"}
_TURN = "where z is up, turn the body by orientation: [0.7071068, 0, 0, 0.7071068]"
_ARCHIVES = {"bz2", "gz", "tar.bz2", "tar.gz", "zip"}  # that trimesh unpacks, however much is in them
FLAT = 1e-12  # of the cube of the size: less volume than this is none
_PROBES = 200  # points on a surface, or in a box, whose winding numbers are looked at
_BELOW = 1e-9  # of the size, below the surface or above it
_FACES = 24  # of a component, at which it is checked what is around it
_UNITES = "(a repair unites the parts with trimesh.boolean.union)"
_CROSSED = 0.02  # of the surface, that may cross the rest: ears and seams spoil no volume
_TWICE = 0.01  # of the volume, that may count twice: handles may reach a little into walls
_LITTLE = 1e-3  # of the volume, where boxes around two components may overlap


@dataclass(frozen=True, eq=False)
class SolidMesh:
    """A solid of uniform density bounded by triangles, in its body frame (origin at the centre of mass).

    Attributes
    ----------
    name : str
    corners : ndarray (m, 3, 3)
        Corners of the triangles [m], counter-clockwise as seen from outside.
    origin : ndarray (3,)
        The mesh's own origin in the body frame [m]: minus the centre of mass in mesh coordinates.
    volume : float
        Volume [m^3].
    inertia : ndarray (3, 3)
        Inertia about the centre of mass per unit mass [m^2].
    sha256 : str
        Of the mesh's file; of its vertices and triangles when it has none.
    """

    name: str
    corners: np.ndarray
    origin: np.ndarray
    volume: float
    inertia: np.ndarray
    sha256: str

    @cached_property
    def parts(self) -> list[np.ndarray]:
        """Triangles (m, 3, 3) of each component that is no cavity [m]."""
        points, number = unique_rows(self.corners.reshape(-1, 3))
        label = components(number.reshape(-1, 3), len(points))
        a, b, c = self.corners.transpose(1, 0, 2)
        volumes = np.bincount(label, weights=np.einsum("ij,ij->i", a, np.cross(b, c)))
        return [self.corners[label == k] for k in np.flatnonzero(volumes > 0.0)]

    @property
    def bounds(self) -> np.ndarray:
        """Corners of the bounding box along the body axes [m], (2, 3)."""
        return np.stack([self.corners.min(axis=(0, 1)), self.corners.max(axis=(0, 1))])

    @property
    def bounding_radius(self) -> float:
        """Largest distance of a vertex from the centre of mass [m]."""
        return float(np.linalg.norm(self.corners, axis=2).max())

    def scaled(self, s) -> SolidMesh:
        """Return the solid with all lengths multiplied by s."""
        return replace(
            self,
            corners=self.corners * s,
            origin=self.origin * s,
            volume=self.volume * s**3,
            inertia=self.inertia * s**2,
        )


def load_solid(path: str | os.PathLike[str], repair: bool = False) -> tuple[SolidMesh, list[str]]:
    """Read a mesh file of any format that trimesh reads.

    Coordinates are metres, unless the file states another unit (COLLADA, 3MF).

    Parameters
    ----------
    path : str or path-like
        The mesh.
    repair : bool
        Try trimesh's repairs on a mesh that is no solid, and unite parts that overlap (needs manifold3d).

    Returns
    -------
    solid : SolidMesh
    repairs : list of str
        What the repair did.

    Raises
    ------
    InvalidMeshError
        If the file is no mesh, or the mesh no solid, in which case the message tells whether ``repair`` may
        help.
    """
    path = Path(path)
    vertices, faces, sha256 = read_mesh(path)
    repairs: list[str] = []
    try:
        if repair:
            vertices, faces, repairs = repaired(vertices, faces)
        solid = make_solid(path.stem, vertices, faces, sha256=sha256)
    except InvalidMeshError as error:
        problem, hint, _ = error.problem.partition(" (a repair")
        if hint:
            problem = (
                f"{problem}; the repair could not mend it: mend it in a mesh editor"
                if repair
                else error.problem
            )
        raise InvalidMeshError(problem, field=f"mesh {path}", value=error.value) from error
    return solid, repairs


def read_mesh(path: Path) -> tuple[np.ndarray, np.ndarray, str]:
    """Return vertices (n, 3) [m] and triangles (m, 3) of a mesh file, and the file's SHA-256.

    Coordinates of formats without a unit are taken as metres. Axes are those of the file.
    Raises `InvalidMeshError` or `LimitExceededError` if it is no mesh, or larger than the memory allows.
    """
    import trimesh

    formats = sorted(set(trimesh.available_formats()) - _ARCHIVES)
    if path.suffix.lower().removeprefix(".") not in formats:
        raise InvalidMeshError(f"must end in one of {', '.join(formats)}", field=f"mesh {path}")
    try:
        if path.exists() and not path.is_file():
            raise InvalidMeshError("is no file", field=f"mesh {path}")
        size = path.stat().st_size
        require_memory(_BYTES_PER_BYTE * size, "reading it", f"mesh {path}: bytes", size)
        data = path.read_bytes()
        mesh = trimesh.load_mesh(path, process=False)
        vertices, faces = np.asarray(mesh.vertices, dtype=float), np.asarray(mesh.faces, dtype=np.int64)
        if path.suffix.lower() in _WITH_UNIT:
            vertices = vertices * mesh_unit(path, mesh.units)
    except UncPhysicsError:
        raise
    except OSError as error:
        raise InvalidMeshError(
            f"cannot be read: {error.strerror or error}; check the path", field=f"mesh {path}"
        ) from error
    except Exception as error:  # trimesh's readers raise whatever the file makes them stumble over
        reason = (str(error).splitlines() or [type(error).__name__])[0][:100]
        raise InvalidMeshError(
            f"is no mesh of a format that trimesh reads: {reason}", field=f"mesh {path}"
        ) from error
    return vertices, faces, hashlib.sha256(data).hexdigest()


def mesh_unit(path: Path, stated: str | None) -> float:
    """Return the unit of a mesh file's coordinates [m]; ``stated`` is the name of the unit in the file."""
    import trimesh

    if path.suffix.lower() == ".dae":
        found = re.search(rb"<unit\b[^>]*\bmeter\s*=\s*[\"']([^\"']*)", _collada_asset(path))
        return float(found.group(1)) if found else 1.0
    return trimesh.units.unit_conversion(stated or _WITH_UNIT[path.suffix.lower()], "meters")


def mesh_notes(path: Path) -> list[str]:
    """Return lines about a mesh file's unit and axes: what the file says, and how it is read."""
    suffix = path.suffix.lower()
    if suffix in (".gltf", ".glb"):
        return [f"glTF files are in metres, with y up by convention; {_TURN}"]
    if suffix == ".3mf":
        return ["3MF files state their unit, millimetres by default: coordinates are converted to metres"]
    if suffix != ".dae":
        return []
    unit, axis = mesh_unit(path, None), re.search(rb"<up_axis>\s*(\w+)", _collada_asset(path))
    notes = []
    if unit != 1.0:
        notes.append(f"the COLLADA file has a unit of {unit:g} m: coordinates are converted to metres")
    up = axis.group(1).decode("ascii", "replace") if axis else "Y_UP"
    if up != "Z_UP":
        said = "says" if axis else "says no up_axis, which means"
        notes.append(f"the COLLADA file {said} {up}: its axes are taken as they are, as RViz does; {_TURN}")
    return notes


def _collada_asset(path):
    """Return the element of a COLLADA file that states its unit and axis."""
    found = re.search(rb"<asset\b.*?</asset>", path.read_bytes(), re.DOTALL)
    return found.group(0) if found else b""


def make_solid(name, vertices, faces, sha256=None) -> SolidMesh:
    """Return a solid from vertices (n, 3) [m] and triangles (m, 3).

    Several components are one body, and must not overlap. A component that is wound inside out is a cavity of
    the one around it.
    Raises `InvalidMeshError` if the triangles are not the boundary of a solid.
    """
    import trimesh

    vertices = np.asarray(vertices, dtype=float)
    faces = np.asarray(faces, dtype=np.int64)
    _check_triangles(vertices, faces)
    used, faces = np.unique(faces, return_inverse=True)
    middle, size, unit = normalization(vertices[used])
    if not size > 0.0:
        raise InvalidMeshError("has no volume: all its vertices are one point")
    points, same = unique_rows((vertices[used] - middle) / unit)
    faces = same[faces.reshape(-1, 3)]
    faces = faces[(faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])]
    check_closed(faces)
    check_components(points, faces)
    check_overlaps(points, faces)
    properties = trimesh.triangles.mass_properties(points[faces], density=1.0)
    inertia = np.asarray(properties.inertia) / properties.volume
    inertia = 0.5 * (inertia + inertia.T)
    try:
        check_inertia(inertia)
    except InvalidModelError as error:
        raise InvalidMeshError(
            f"is too thin for its size: round-off spoils its inertia, which {error.problem}"
        ) from error
    center = np.asarray(properties.center_mass)
    if sha256 is None:
        sha256 = hashlib.sha256(vertices.astype("<f8").tobytes() + faces.astype("<i8").tobytes()).hexdigest()
    return SolidMesh(
        name=name,
        corners=np.ascontiguousarray((points[faces] - center) * unit),
        origin=-(center * unit + middle),
        volume=float(properties.volume * unit**3),
        inertia=inertia * unit**2,
        sha256=sha256,
    )


def normalization(points):
    """Return middle (3,) and size of the bounding box, and the largest power of two up to the size.

    Scaling by a power of two is exact.
    """
    low, high = points.min(axis=0), points.max(axis=0)
    size = float((high - low).max())
    return 0.5 * (low + high), size, float(2.0 ** np.floor(np.log2(size))) if size > 0.0 else 1.0


def edge_balance(faces):
    """Return for each undirected edge its number of triangles, and the difference between its directions."""
    edges = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    low, high = edges.min(axis=1), edges.max(axis=1)
    number = low * (int(edges.max()) + 1) + high
    _, index, uses = np.unique(number, return_inverse=True, return_counts=True)
    return uses, np.bincount(index, weights=np.where(edges[:, 0] < edges[:, 1], 1.0, -1.0))


def check_closed(faces):
    """Raise `InvalidMeshError` if a surface has a border, or its triangles are wound against each other."""
    if len(faces) == 0:
        raise InvalidMeshError("has no volume: all its triangles are degenerate")
    uses, balance = edge_balance(faces)
    border = int(np.sum(uses % 2 == 1))
    if border:
        raise InvalidMeshError(
            f"is open: {border} of its {len(uses)} edges belong to an odd number of triangles, so it has no"
            " inside (a repair closes small holes with trimesh.repair.fill_holes)"
        )
    crossed = int(np.sum(balance != 0))
    if crossed:
        raise InvalidMeshError(
            f"is wound inconsistently: at {crossed} of its {len(uses)} edges the triangles disagree about"
            " which side is out (a repair turns them with trimesh.repair.fix_winding)"
        )


def check_components(points, faces):
    """Raise `InvalidMeshError` if a surface is flat, or it or a component is inside out or crosses itself.

    A component may be inside another one only as a cavity. On the inner side of its own surface a solid winds
    once around each point, and a cavity never. ``points`` are normalized to a size between 1 and 2.
    """
    label, corners = components(faces, len(points)), points[faces]
    volumes = np.bincount(label, weights=np.linalg.det(corners) / 6.0)
    volume = volumes.sum()
    if abs(volume) < FLAT and np.all(np.abs(volumes) < FLAT):
        raise InvalidMeshError("encloses no volume")
    if volume <= 0.0:
        raise InvalidMeshError(
            "is inside out: its volume is negative, as its triangles are wound clockwise "
            "(a repair turns them with trimesh.repair.fix_inversion)"
        )
    whole = build_triangle_tree(corners)
    for k in np.flatnonzero(np.abs(volumes) > FLAT):
        own = corners[label == k]
        tree = whole if len(own) == len(corners) else build_triangle_tree(own)
        normals = np.cross(own[:, 1] - own[:, 0], own[:, 2] - own[:, 0])
        areas = np.linalg.norm(normals, axis=1)
        middles, below = own.mean(axis=1), _BELOW * normals / np.maximum(areas, 1e-300)[:, None]
        some = np.linspace(0, len(own) - 1, min(len(own), _FACES)).astype(int)
        # beside the surface, on its convex side: on a face that components share the number is not defined
        probes = (middles + np.sign(volumes[k]) * below)[some]
        others = winding_numbers(whole, probes) - winding_numbers(tree, probes)
        name = f"has a component ({len(own)} of {len(faces)} triangles)"
        if volumes[k] < 0.0 and np.median(others) < 0.75:
            raise InvalidMeshError(
                f"{name} that is inside out and no cavity of another (a repair turns it with"
                " trimesh.repair.fix_inversion)"
            )
        if volumes[k] > 0.0 and others.min() > 0.75:
            raise InvalidMeshError(
                f"{name} inside another, so that its volume would count twice (unite them first; a cavity is"
                " wound the other way round)"
            )
        chosen = np.searchsorted(np.cumsum(areas) / areas.sum(), (np.arange(_PROBES) + 0.5) / _PROBES)
        inner = winding_numbers(tree, (middles - below)[chosen])
        share = float(np.mean(inner != (volumes[k] > 0.0)))
        if share > _CROSSED:
            raise InvalidMeshError(
                f"passes through itself: about {share:.0%} of its surface lies inside it, or inside out,"
                " where its volume counts twice or not at all; unite its parts in a mesh editor"
            )


def check_overlaps(points, faces):
    """Raise `InvalidMeshError` if components overlap, as their common volume counts twice.

    Everywhere the components together wind once around a point, or never. ``points`` are normalized to a size
    between 1 and 2.
    """
    label, corners = components(faces, len(points)), points[faces]
    parts = [corners[label == k] for k in range(label.max() + 1)]
    if len(parts) == 1:
        return
    low, high = (np.array([f(part, axis=(0, 1)) for part in parts]) for f in (np.min, np.max))
    volume, tree = np.linalg.det(corners).sum() / 6.0, build_triangle_tree(corners)
    twice, rng = 0.0, np.random.default_rng(0)
    for k in range(len(parts)):
        for j in range(k):
            corner = np.maximum(low[j], low[k])
            size = np.maximum(np.minimum(high[j], high[k]) - corner, 0.0)
            if size.prod() > _LITTLE * volume:
                total = winding_numbers(tree, corner + size * rng.random((_PROBES, 3)))
                twice += size.prod() * float(np.mean((total < 0) | (total > 1)))
    if twice > _TWICE * volume:
        raise InvalidMeshError(
            f"has parts that overlap: about {twice / volume:.0%} of its volume counts twice {_UNITES}"
        )


def components(faces, count):
    """Return the number of the component of each triangle (m,); triangles of one share edges."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    ends = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    edges = ends[:, 0] * count + ends[:, 1]
    order = np.argsort(edges, kind="stable")
    same = np.flatnonzero(edges[order[1:]] == edges[order[:-1]])
    pairs = order[same] // 3, order[same + 1] // 3
    graph = coo_array((np.ones(len(same), dtype=np.int8), pairs), shape=(len(faces), len(faces)))
    return connected_components(graph, directed=False)[1]


def unique_rows(rows):
    """Return the distinct rows in lexicographic order, and the number of each row among them.

    `numpy.unique` does the same in four times the time.
    """
    order = np.lexsort(rows.T[::-1])
    ordered = rows[order]
    new = np.append(True, np.any(ordered[1:] != ordered[:-1], axis=1))
    number = np.empty(len(rows), np.int64)
    number[order] = np.cumsum(new) - 1
    return ordered[new], number


def _check_triangles(vertices, faces):
    """Raise `InvalidMeshError` if there are no triangles, or vertices are not finite: no repair helps."""
    if len(faces) == 0:
        raise InvalidMeshError("has no triangles")
    if not np.isfinite(vertices[faces]).all():
        raise InvalidMeshError("has vertices that are not finite numbers")


def repaired(vertices, faces):
    """Return vertices and triangles after trimesh's repairs, and a phrase about each repair."""
    import trimesh

    _check_triangles(vertices, faces)
    middle, _, unit = normalization(vertices)
    mesh = trimesh.Trimesh((vertices - middle) / unit, faces, process=False)
    did: list[str] = []
    volume = mesh.volume
    before = len(mesh.vertices), len(mesh.faces)
    mesh.merge_vertices(merge_tex=True, merge_norm=True)
    mesh.update_faces(mesh.nondegenerate_faces())
    mesh.update_faces(_single_faces(mesh.faces))
    mesh.remove_unreferenced_vertices()
    if len(mesh.vertices) < before[0]:
        did.append(f"merged {before[0]} vertices into {len(mesh.vertices)}")
    if (dropped := before[1] - len(mesh.faces)) > 0:
        did.append(f"dropped {counted(dropped, 'degenerate or double triangle')}")
    filled = len(mesh.faces)
    trimesh.repair.fill_holes(mesh, use_fan=True)
    if (added := len(mesh.faces) - filled) > 0:
        did.append(f"closed holes with {counted(added, 'triangle')}")
    old = mesh.faces.copy()
    trimesh.repair.fix_normals(mesh, multibody=mesh.is_watertight)
    turned = int(np.sum(np.any(lowest_first(old) != lowest_first(mesh.faces), axis=1)))
    if turned:
        did.append(f"turned {counted(turned, 'triangle')} round")
    mesh = _with_united_parts(mesh, did)
    if did:
        share = f" ({mesh.volume / volume - 1.0:+.1%})" if volume > FLAT else ""
        did.append(
            f"volume in units of the mesh: {volume * unit**3:.4g}, now {mesh.volume * unit**3:.4g}{share}"
        )
    return np.asarray(mesh.vertices) * unit + middle, np.asarray(mesh.faces, dtype=np.int64), did


def _with_united_parts(mesh, did):
    """Return a mesh whose parts are united where they overlap, and add a sentence about it to ``did``."""
    import trimesh

    parts = mesh.split(only_watertight=False)
    apart: Any = trimesh.util.concatenate(parts)  # parts that share an edge have vertices of their own
    try:
        check_components(apart.vertices, apart.faces)
        check_overlaps(apart.vertices, apart.faces)
    except InvalidMeshError as error:
        if _UNITES not in error.problem or find_spec("manifold3d") is None:
            return mesh
        with contextlib.suppress(ValueError):  # a part is open, or its faces are at edges of another part
            mesh = trimesh.boolean.union(parts, engine="manifold")
            did.append(f"united {len(parts)} parts, which overlapped")
    return mesh


def _single_faces(faces):
    """Return which triangles (m,) stay if each stands once, and none where two parts touch.

    Two opposite triangles are a wall between parts if the surface is closed without them, and else the two
    sides of one surface.
    """
    _, first, index = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_inverse=True)
    index = index.reshape(-1)
    ordered = lowest_first(faces)
    once = np.zeros(len(faces), dtype=bool)
    once[first] = True
    wound = np.bincount(index, weights=np.where(ordered[:, 1] < ordered[:, 2], 1.0, -1.0))
    apart = once & (wound[index] != 0.0)
    closed = apart.any() and np.all(edge_balance(faces[apart])[0] % 2 == 0)
    return apart if closed else once


def lowest_first(faces):
    """Return triangles with the lowest vertex first; equal triangles then differ only by their winding."""
    first = np.argmin(faces, axis=1)
    return np.take_along_axis(faces, (first[:, None] + np.arange(3)) % 3, axis=1)
