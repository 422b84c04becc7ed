"""Links of a description as solids or packings, with the mass properties of the file."""

from __future__ import annotations

from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..checks.errors import InvalidMeshError, InvalidModelError, InvalidRequestError
from ..checks.names import hint
from ..checks.validation import instance, positive
from ..shapes.mass_properties import MassProperties
from ..shapes.mesh_pieces import best_pieces
from ..shapes.packing import pack_solid
from ..shapes.packing_file import HULL, SpherePacking, spheres_reach
from ..shapes.pieces import Hull, Piece
from ..shapes.solid_mesh import SolidMesh, make_solid
from .inertia import check_inside, check_moments, combined, unusual_inertia
from .parts import SOLIDS, Description, Link
from .reading import read_description
from .shape_solid import shape_solid

_UNIFORM = "to take it from the shape, use --uniform, or uniform=True in Python"


def from_urdf(
    path,
    link: str | None = None,
    *,
    spheres: int = 1000,
    scale: float = 1.0,
    uniform: bool = False,
    repair: bool = False,
) -> SpherePacking:
    """Pack a link of a URDF, SDF or MJCF file with spheres.

    The collision shapes are united and packed, or the visual ones if there are no others. Mass and inertia
    come from the file. The model's origin is the link's origin.

    Parameters
    ----------
    path : path-like
        ``.urdf``, ``.sdf``, ``.world``, ``.mjcf`` or ``.xml``. Meshes named by ``package://`` or ``model://``
        are searched in folders around it and in the folders of ROS and Gazebo.
    link : str, optional
        Name of the link; in an SDF the name of the model, or ``MODEL::LINK`` if it has several links; in an
        MJCF the name of the body. Optional if only one link has a shape.
    spheres : int
        Number of spheres.
    scale : float
        Scale of all lengths, in addition to the scale of meshes in the file; densities do not change.
    uniform : bool
        Whether to compute centre of mass and inertia from the shape at uniform density, instead of the file.
    repair : bool
        Whether to repair meshes that are not closed, by trimesh.

    Returns
    -------
    SpherePacking
        Packing; ``mass`` is None if the file has none.

    Raises
    ------
    InvalidRequestError
        If the file is not a description, or the link does not exist or has no shape.
    InvalidMeshError, InvalidModelError
        If a mesh is not a solid, or the inertia is not physical.
    NotSupportedError
        If a library is missing.
    """
    instance(link, (str, type(None)), "link")
    scale = positive(scale, "scale")
    description = read_description(path)
    found = find_link(description, link)
    return packed_link(description.path, found, spheres, scale=scale, uniform=uniform, repair=repair)[0]


class LinkSolid(NamedTuple):
    """Solid of a link about its centre of mass, with what the file says.

    Attributes
    ----------
    solid : SolidMesh
    mass : float or None
        [kg]
    pieces : tuple of Piece
        In the body frame; empty if a shape is a mesh that is neither convex nor simple.
    notes : tuple of str
        How ambiguous parts of the file are read.
    """

    solid: SolidMesh
    mass: float | None
    pieces: tuple[Piece, ...]
    notes: tuple[str, ...]

    def scaled(self, s: float) -> LinkSolid:
        """Return the link with all lengths multiplied by ``s``; its density does not change."""
        mass = None if self.mass is None else self.mass * s**3
        return LinkSolid(
            self.solid.scaled(s), mass, tuple(piece.scaled(s) for piece in self.pieces), self.notes
        )


def packed_link(path: Path, link: Link, spheres: int, *, scale=1.0, uniform=False, repair=False):
    """Return the packing of a link (`from_urdf`), and notes about how the file is read."""
    found = link_solid(path, link, uniform=uniform, repair=repair).scaled(scale)
    solid, about = found.solid, {"mass": found.mass, "source": f"link {link.name} of {path.name}"}
    piece = found.pieces[0] if len(found.pieces) == 1 else None
    if isinstance(piece, Hull) and len(piece.points) == 1:  # a ball is a sphere
        radius = np.array([piece.rounding])
        packing = SpherePacking(
            name=solid.name,
            centers=piece.points,
            radii=radius,
            inertia=solid.inertia,
            volume=solid.volume,
            origin=solid.origin,
            bounding_radius=spheres_reach(piece.points, radius),
            bounds=piece.points + np.outer([-1.0, 1.0], np.repeat(radius, 3)),
            pieces=found.pieces,
            **about,
        )
        return packing, found.notes
    if found.pieces:
        return pack_solid(solid, spheres, pieces=found.pieces, **about), found.notes
    best, notes = best_pieces(solid), found.notes
    if best is not None and best.kind == HULL:
        off = f"{1e3 * best.error.largest:.1f} mm off its mesh"
        without = "" if find_spec("coacd") else "; the library coacd cuts it into convex pieces"
        notes = (*notes, f"{link.name}: its shape is the convex hull, up to {off}{without}")
    pieces: dict[str, Any] = best.entries if best is not None else {"pieces": ()}
    return pack_solid(solid, spheres, **pieces, **about), notes


def find_link(description: Description, name: str | None) -> Link:
    """Return the link with a name, or the only link with a shape.

    Raises
    ------
    InvalidRequestError
    """
    links = {link.name: link for link in description.links if link.shapes}
    field = f"link of {description.path}"
    for line in description.left_out:
        if name not in links and (line.startswith(f"{name}: ") if name else not links):
            raise InvalidRequestError(f"is left out: {line}", field=field, value=name)
    if name is None and len(links) == 1:
        return next(iter(links.values()))
    if name is None:
        some = ", ".join(list(links)[:10]) + ", ..." * (len(links) > 10)
        raise InvalidRequestError(
            f"must be named: there {'are ' + some if links else 'is none with a shape'}", field=field
        )
    if name not in links:
        without = any(link.name == name for link in description.links)
        problem = "has no shape" if without else f"is none with a shape{hint(name, links)}"
        raise InvalidRequestError(problem, field=field, value=name)
    return links[name]


def link_solid(path: Path, link: Link, *, uniform=False, repair=False) -> LinkSolid:
    """Return the union of a link's shapes, with the file's mass, centre of mass and inertia if given.

    Raises
    ------
    InvalidRequestError, InvalidMeshError, InvalidModelError
    """
    field = f"link {link.name} of {path}"
    for shape in link.shapes:
        problem = shape.problem or ("" if shape.kind in SOLIDS else f"is a {shape.kind}, which is not packed")
        if problem:
            raise InvalidRequestError(problem, field=field)
    name = link.name.replace("::", "_").replace("/", "_")
    try:
        parts = [shape_solid(shape, repair) for shape in link.shapes]
        if len(parts) == 1:
            solid = _with_properties(make_solid(name, *parts[0][:2]), parts[0].properties)
        else:
            solid = make_solid(name, *_united(parts))
    except InvalidMeshError as error:
        problem = error.problem.partition(" (a repair")[0]
        hint_ = "" if repair or problem == error.problem else "; repair may help"
        raise InvalidMeshError(f"has a mesh that {problem}{hint_}", field=field) from None
    mass, notes = None, [note for part in parts for note in part.notes]
    if link.inertial is not None:
        solid, mass, more = _with_inertial(solid, link, parts, uniform, field)
        notes += [f"{link.name}: {note}" for note in more]
    known = all(part.pieces for part in parts)
    pieces = [piece.moved(solid.origin, np.eye(3)) for part in parts for piece in part.pieces]
    return LinkSolid(solid, mass, tuple(pieces) if known else (), tuple(notes))


def _with_properties(solid, properties):
    """Return a solid about another centre of mass, with exact volume and inertia."""
    moved = _about(solid, properties.center)
    return replace(moved, volume=properties.volume, inertia=properties.inertia)


def _about(solid, center):
    """Return a solid about another centre of mass (3,), in the link's frame."""
    shift = center + solid.origin
    return replace(solid, corners=solid.corners - shift, origin=solid.origin - shift)


def _with_inertial(solid, link, parts, uniform, field):
    """Return the solid with the file's centre of mass and inertia, the mass, and notes."""
    inertial = link.inertial
    if inertial.density is not None:
        mass, properties = _by_density(link.shapes, parts, inertial.density)
        if not uniform:
            moved = _about(solid, properties.center)
            solid = replace(moved, inertia=properties.inertia)
        return solid, mass if inertial.mass is None else inertial.mass, []
    if uniform:
        return solid, inertial.mass, []
    shape_inertia = solid.inertia * inertial.mass
    if inertial.pose is not None:
        solid = _about(solid, inertial.pose[:3, 3])
    if inertial.inertia is None:
        return solid, inertial.mass, []
    R = np.eye(3) if inertial.pose is None else inertial.pose[:3, :3]
    try:
        check_moments(inertial.inertia)
        inertia = R @ inertial.inertia @ R.T
        inertia = 0.5 * (inertia + inertia.T)
        check_inside(inertia, inertial.mass, solid.corners.reshape(-1, 3))
    except InvalidModelError as error:
        raise InvalidModelError(
            f"has an inertia that does not fit: {error.problem}; {_UNIFORM}", field=field
        ) from None
    note = unusual_inertia(inertia, shape_inertia)
    return replace(solid, inertia=inertia / inertial.mass), inertial.mass, [note] if note else []


def _by_density(shapes, parts, density):
    """Return mass [kg] and mass properties of shapes from their densities; common volume counts twice."""
    given = [density if shape.density is None else shape.density for shape in shapes]
    masses = np.array([d * part.properties.volume for d, part in zip(given, parts, strict=True)])
    shares = masses / masses.sum()
    own = [share * part.properties.inertia for share, part in zip(shares, parts, strict=True)]
    center, inertia = combined(shares, [part.properties.center for part in parts], own)
    volume = sum(part.properties.volume for part in parts)
    return float(masses.sum()), MassProperties(volume, center, inertia)


def _united(parts):
    """Return the union of several solids; raise an error if a part is not a solid."""
    import trimesh

    for part in parts:
        make_solid("part", part.vertices, part.faces)
    meshes = [trimesh.Trimesh(part.vertices, part.faces, process=True) for part in parts]
    try:
        union = trimesh.boolean.union(meshes, engine="manifold")
    except ValueError as error:  # for parts that it does not accept as volumes
        raise InvalidMeshError(f"cannot be united with the other shapes: {error}") from None
    return np.asarray(union.vertices, float), np.asarray(union.faces, np.int64)
