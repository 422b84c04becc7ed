"""Links of a description as solids or packings, with the mass properties of the file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from ..checks.errors import InvalidMeshError, InvalidModelError, InvalidRequestError
from ..checks.names import hint
from ..checks.validation import instance, positive
from ..geometry.packing import pack_solid
from ..geometry.packing_file import SpherePacking, check_inertia
from ..geometry.primitives import primitive
from ..geometry.solid_mesh import SolidMesh, make_solid, read_mesh, repaired
from .parts import SOLIDS, Description, Link, Shape
from .reading import read_description


def from_urdf(
    path,
    link: str | None = None,
    *,
    spheres: int = 1000,
    scale: float = 1.0,
    uniform: bool = False,
    repair: bool = False,
) -> SpherePacking:
    """Pack a link of a URDF or SDF file with spheres.

    The collision shapes are united and packed, or the visual ones if there are no others. Mass and inertia
    come from the file. The model's origin is the link's origin.

    Parameters
    ----------
    path : path-like
        ``.urdf``, ``.sdf`` or ``.world``. Meshes named by ``package://`` or ``model://`` are searched in
        folders around it and in the folders of ROS and Gazebo.
    link : str, optional
        Name of the link; in an SDF the name of the model, or ``MODEL::LINK`` if it has several links.
        Optional if only one link has a shape.
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
    return packed_link(description.path, found, spheres, scale=scale, uniform=uniform, repair=repair)


def packed_link(path: Path, link: Link, spheres: int, *, scale=1.0, uniform=False, repair=False, **options):
    """Return the packing of a link (`from_urdf`); ``options`` are passed to `pack_solid`."""
    solid = link_solid(path, link, uniform=uniform, repair=repair).scaled(scale)
    mass = None if link.inertial is None else link.inertial.mass * scale**3
    options = {"mass": mass, "source": f"link {link.name} of {path.name}"} | options
    return pack_solid(solid, spheres, **options)


def find_link(description: Description, name: str | None) -> Link:
    """Return the link with a name, or the only link with a shape.

    Raises
    ------
    InvalidRequestError
    """
    links = {link.name: link for link in description.links if link.shapes}
    field = f"link of {description.path}"
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


def link_solid(path: Path, link: Link, *, uniform=False, repair=False) -> SolidMesh:
    """Return the union of a link's shapes, with the file's centre of mass and inertia if given.

    Raises
    ------
    InvalidRequestError, InvalidMeshError, InvalidModelError
    """
    field = f"link {link.name} of {path}"
    for shape in link.shapes:
        problem = shape.problem or ("" if shape.kind in SOLIDS else f"is a {shape.kind}, which is not packed")
        if problem:
            raise InvalidRequestError(problem, field=field)
    try:
        parts = [_moved(_triangles(shape, repair), shape.pose) for shape in link.shapes]
        vertices, faces = parts[0] if len(parts) == 1 else _united(parts)
        solid = make_solid(link.name.replace("::", "_").replace("/", "_"), vertices, faces)
    except InvalidMeshError as error:
        problem = error.problem.partition(" (a repair")[0]
        hint_ = "" if repair or problem == error.problem else "; repair may help"
        raise InvalidMeshError(f"has a mesh that {problem}{hint_}", field=field) from None
    if uniform or link.inertial is None:
        return solid
    return _with_inertial(solid, link, field)


def _with_inertial(solid, link, field):
    """Return the solid relative to the file's centre of mass, with the file's inertia."""
    inertial = link.inertial
    shift = inertial.pose[:3, 3] + solid.origin  # from the shape's centre to the centre of mass
    moved = replace(solid, corners=solid.corners - shift, origin=solid.origin - shift)
    if inertial.inertia is None:
        return moved
    R = inertial.pose[:3, :3]
    inertia = R @ inertial.inertia @ R.T / inertial.mass
    inertia = 0.5 * (inertia + inertia.T)
    try:
        check_inertia(inertia)
    except InvalidModelError as error:
        raise InvalidModelError(
            f"has an inertia that {error.problem}; uniform (--uniform) takes it from the shape", field=field
        ) from None
    return replace(moved, inertia=inertia)


def _triangles(shape: Shape, repair):
    """Return vertices and triangles of a shape, in its own frame."""
    if shape.kind == "mesh" and shape.file is not None:
        vertices, faces, _ = read_mesh(shape.file)
        if repair:
            vertices, faces, _ = repaired(vertices, faces)
        vertices = vertices * shape.scale
        return vertices, faces if np.prod(shape.scale) > 0.0 else faces[:, ::-1]
    for length in shape.size:
        positive(length, f"size of a {shape.kind}")
    return primitive(shape.kind, shape.size)


def _moved(triangles, pose):
    vertices, faces = triangles
    return vertices @ pose[:3, :3].T + pose[:3, 3], faces


def _united(parts):
    """Return the union of several solids; raise an error if a part is not a solid."""
    import trimesh

    for vertices, faces in parts:
        make_solid("part", vertices, faces)
    meshes = [trimesh.Trimesh(*part, process=True) for part in parts]
    try:
        union = trimesh.boolean.union(meshes, engine="manifold")
    except ValueError as error:  # for parts that it does not accept as volumes
        raise InvalidMeshError(f"cannot be united with the other shapes: {error}") from None
    return np.asarray(union.vertices, float), np.asarray(union.faces, np.int64)
