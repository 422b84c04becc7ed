"""Environment and bodies from a URDF, SDF or MJCF file."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import chain, count
from typing import Any, NamedTuple

import numpy as np

from ..checks.errors import UncPhysicsError
from ..checks.validation import instance, integer
from ..scene.body import RigidBody
from ..scene.body_belief import BodyBelief
from ..scene.environment import Box, Capsule, Cylinder, Element, Plane, Sphere
from ..spatial.rotation import rotation_matrix
from .link_solid import packed_link
from .parts import PRIMITIVES, SOLIDS, Link, Shape
from .reading import read_description
from .shape_solid import mesh_triangles, simple_shape


class WorldDescription(NamedTuple):
    """Scene content of a description file.

    Attributes
    ----------
    environment : tuple of Element
        Fixed planes, boxes, spheres, cylinders and capsules.
    bodies : tuple of RigidBody
        Fixed meshes as fixed bodies, and free links.
    beliefs : dict of str to BodyBelief
        Poses of the bodies by name, without uncertainty.
    left_out : tuple of str
        All omitted parts with the reason, one line each.
    notes : tuple of str
        How ambiguous or unusual parts of the file are read, one line each.
    """

    environment: tuple[Element, ...]
    bodies: tuple[RigidBody, ...]
    beliefs: dict[str, BodyBelief]
    left_out: tuple[str, ...]
    notes: tuple[str, ...] = ()


def load_world(
    path: str | os.PathLike[str],
    *,
    spheres: int = 1000,
    configuration: Mapping[str, float] | None = None,
    uniform: bool = False,
    repair: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> WorldDescription:
    """Read environment and bodies from a URDF, SDF or MJCF file.

    Parameters
    ----------
    path : path-like
        ``.urdf``, ``.sdf``, ``.world``, ``.mjcf`` or ``.xml``.
    spheres : int
        Number of spheres of each packed body.
    configuration : mapping of str to float, optional
        Positions of joints [rad or m]. All links of a URDF are then fixed, with unnamed joints at 0; by
        default links behind a joint are omitted. Unnamed joints of an MJCF stay at their start.
    uniform : bool
        Whether to compute centre of mass and inertia from the shape at uniform density, instead of the file.
    repair : bool
        Whether to repair meshes that are not closed, by trimesh.
    progress : callable, optional
        Called before each link with the number of links that are done, and of all.

    Returns
    -------
    WorldDescription

    Raises
    ------
    InvalidRequestError, LimitExceededError, NotSupportedError
        If the file is not a description, or a library is missing.
    """
    integer(spheres, "spheres", low=1)
    instance(configuration, (Mapping, type(None)), "configuration")
    description = read_description(path, configuration)
    found = _Collected(list(description.left_out), list(description.notes))
    for k, link in enumerate(description.links):
        if progress:
            progress(k, len(description.links))
        if link.moves:
            found.left_out.append(f"{link.name}: {link.moves}")
            continue
        packed = link if link.free else found.without_elements(link)
        if not packed.shapes:
            continue
        try:
            found.add_body(description.path, packed, spheres, uniform or not link.free, repair)
        except UncPhysicsError as error:
            found.left_out.append(f"{link.name}: {error}")
    return WorldDescription(
        tuple(found.environment),
        tuple(found.bodies),
        found.beliefs,
        tuple(found.left_out),
        tuple(dict.fromkeys(found.notes)),
    )


class _Collected:
    """Content of a world so far."""

    def __init__(self, left_out, notes):
        self.left_out: list[str] = left_out
        self.notes: list[str] = notes
        self.environment: list[Element] = []
        self.bodies: list[RigidBody] = []
        self.beliefs: dict[str, BodyBelief] = {}
        self.names: set[str] = set()

    def free_name(self, name):
        """Return a name that nothing has yet, and note a change."""
        others = (f"{name}_{k}" for k in count(2))
        found = next(new for new in chain([name], others) if new not in self.names)
        if found != name:
            self.notes.append(f"{name}: is the name of several parts; this one is called {found}")
        self.names.add(found)
        return found

    def add_body(self, path, link, spheres, uniform, repair):
        """Pack a link and add it as a body."""
        model, notes = packed_link(path, link, spheres, uniform=uniform, repair=repair)
        fixed = not link.free
        friction, restitution = _surface(link.shapes)
        mass = model.mass if model.mass or fixed else None
        name = self.free_name(link.name)
        self.bodies.append(RigidBody(name, model, mass, fixed, friction=friction, restitution=restitution))
        self.beliefs[name] = _belief(link.pose, model)
        self.notes += notes

    def without_elements(self, link: Link) -> Link:
        """Add a fixed link's primitives, also as meshes, to the environment; return it with the rest."""
        meshes = []
        for k, shape in enumerate(link.shapes):
            name = link.name if len(link.shapes) == 1 else f"{link.name}_{k}"
            problem = shape.problem
            try:
                if shape.kind == "mesh" and not problem:
                    shape, notes = _as_primitive(shape)
                    self.notes += notes
                if shape.kind in PRIMITIVES and not problem:
                    element = _element(shape, link.pose @ shape.pose, name)
                    self.environment.append(replace(element, name=self.free_name(name)))
                    continue
                if shape.kind in SOLIDS and not problem:
                    meshes.append(shape)
                    continue
                problem = problem or f"a {shape.kind} is no shape that is known here"
            except UncPhysicsError as error:
                problem = str(error)
            self.left_out.append(f"{name}: {problem}")
        return replace(link, shapes=tuple(meshes))


def _as_primitive(shape: Shape):
    """Return a mesh as a primitive if it is one, and notes about its file; otherwise the shape."""
    if shape.points is not None:
        return shape, ()
    vertices, faces, notes = mesh_triangles(shape)
    if (found := simple_shape(vertices, faces)) is None:
        return shape, ()  # notes follow with its packing
    kind, pose, size = found
    return replace(shape, kind=kind, pose=shape.pose @ pose, size=size, file=None), notes


def _element(shape: Shape, pose, name) -> Element:
    position = pose[:3, 3]
    given: dict[str, Any] = {
        "name": name,
        "friction": shape.friction,
        "restitution": _share(shape.restitution),
    }
    if shape.kind == "plane":
        normal = pose[:3, :3] @ np.array(shape.size)
        normal = normal / np.linalg.norm(normal)
        return Plane(normal, float(normal @ position), **given)
    given["position"] = position
    if shape.kind == "sphere":
        return Sphere(radius=shape.size[0], **given)
    given["orientation"] = quaternion_of(pose)
    if shape.kind == "box":
        return Box(size=np.array(shape.size), **given)
    kind = Cylinder if shape.kind == "cylinder" else Capsule
    return kind(radius=shape.size[0], length=shape.size[1], **given)


def _surface(shapes):
    """Return friction and restitution of a body, from its first shapes that have them."""
    friction = next((shape.friction for shape in shapes if shape.friction is not None), None)
    restitution = next((shape.restitution for shape in shapes if shape.restitution is not None), None)
    return friction, _share(restitution)


def _share(restitution):
    return None if restitution is None else min(max(restitution, 0.0), 1.0)


def quaternion_of(pose) -> np.ndarray:
    """Return the quaternion (x, y, z, w) of a transform (4, 4)."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_matrix(pose[:3, :3]).as_quat()


def _belief(pose, model) -> BodyBelief:
    """Return the pose of a body's centre of mass if its model's origin has the pose ``pose``."""
    orientation = quaternion_of(pose)
    position = pose[:3, 3] - rotation_matrix(orientation) @ model.origin
    return BodyBelief(position=position, orientation=orientation)
