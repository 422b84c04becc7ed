"""Environment and bodies from a URDF or SDF file."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from ..checks.errors import UncPhysicsError
from ..checks.validation import instance, integer
from ..scene.body import RigidBody
from ..scene.body_belief import BodyBelief
from ..scene.environment import Box, Capsule, Cylinder, Element, Plane, Sphere
from ..spatial.rotation import rotation_matrix
from .link_solid import packed_link
from .parts import PRIMITIVES, Link, Shape
from .reading import read_description


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
    """

    environment: tuple[Element, ...]
    bodies: tuple[RigidBody, ...]
    beliefs: dict[str, BodyBelief]
    left_out: tuple[str, ...]


def load_world(
    path: str | os.PathLike[str],
    *,
    spheres: int = 1000,
    configuration: Mapping[str, float] | None = None,
    repair: bool = False,
) -> WorldDescription:
    """Read environment and bodies from a URDF or SDF file.

    Parameters
    ----------
    path : path-like
        ``.urdf``, ``.sdf`` or ``.world``.
    spheres : int
        Number of spheres of each packed body.
    configuration : mapping of str to float, optional
        Positions of a URDF's joints [rad or m]; all links are then fixed, with unnamed joints at 0. By
        default links behind a joint are omitted.
    repair : bool
        Whether to repair meshes that are not closed, by trimesh.

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
    environment: list[Element] = []
    bodies: dict[str, tuple[RigidBody, BodyBelief]] = {}
    left_out = list(description.left_out)
    for link in description.links:
        if link.moves:
            left_out.append(f"{link.name}: {link.moves}")
            continue
        packed = link if link.free else _without_primitives(link, environment, left_out)
        if not packed.shapes:
            continue
        try:
            model = packed_link(description.path, packed, spheres, uniform=not link.free, repair=repair)
            fixed = not link.free
            friction, restitution = _surface(packed.shapes)
            body = RigidBody(
                link.name,
                model,
                model.mass if model.mass or fixed else None,
                fixed,
                friction=friction,
                restitution=restitution,
            )
        except UncPhysicsError as error:
            left_out.append(f"{link.name}: {error}")
            continue
        bodies[link.name] = body, _belief(link.pose, model)
    return WorldDescription(
        tuple(environment),
        tuple(body for body, _ in bodies.values()),
        {name: belief for name, (_, belief) in bodies.items()},
        tuple(left_out),
    )


def _without_primitives(link: Link, environment, left_out) -> Link:
    """Move a fixed link's primitives to the environment; return the link with only its meshes."""
    meshes = []
    for k, shape in enumerate(link.shapes):
        name = link.name if len(link.shapes) == 1 else f"{link.name}_{k}"
        if shape.kind == "mesh" and not shape.problem:
            meshes.append(shape)
            continue
        try:
            if shape.kind in PRIMITIVES and not shape.problem:
                environment.append(_element(shape, link.pose @ shape.pose, name))
                continue
            problem = shape.problem or f"a {shape.kind} is no shape that is known here"
        except UncPhysicsError as error:
            problem = str(error)
        left_out.append(f"{name}: {problem}")
    return Link(link.name, link.pose, tuple(meshes), link.inertial)


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
