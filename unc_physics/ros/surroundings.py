"""The environment, materials and regions of a request, from their messages."""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np
from shape_msgs.msg import SolidPrimitive

from ..checks.errors import (
    DuplicateIdError,
    InvalidEnvironmentError,
    InvalidRequestError,
    LimitExceededError,
    NotSupportedError,
    UncPhysicsError,
    UnknownModelError,
)
from ..checks.validation import array, positive, quaternion
from ..geometry.packing_file import SpherePacking
from ..physics.rotation import rotation_matrix
from ..prediction.events import ENVIRONMENT
from ..prediction.regions import BoxRegion
from ..scene.entries import at_field
from ..scene.environment import Box, Cylinder, Element, Plane, Sphere, surface_tilt_std
from ..scene.materials import Surface, check_surface
from .action_messages import read_surface_velocity
from .arrays import xyz
from .arriving_shapes import ArrivingShapes, read_dimensions
from .optional import optional

#: Fields of a material that are served; they are those of a `Surface`.
MATERIAL_FIELDS = ("friction", "friction_std", "restitution", "restitution_std", "torsional_friction")
#: Kinds of primitives that are elements as they are; the others are packed. Unknown ones are refused as such.
_EXACT = set(range(256)) - {SolidPrimitive.CONE, SolidPrimitive.PRISM}
_OBSTACLE_SPHERES = 1000  # of a packed element


class PackedElement(NamedTuple):
    """An element of a shape that has to be packed, which is a fixed body.

    Attributes
    ----------
    name : str
    field : str
        What errors call it.
    model : SpherePacking
    position, orientation : tuple
        Of the shape's own origin: world frame [m], quaternion (x, y, z, w).
    material : tuple
        As `read_material` gives it.
    """

    name: str
    field: str
    model: SpherePacking
    position: tuple[float, ...]
    orientation: tuple[float, ...]
    material: tuple


def read_environment(
    message, shapes: ArrivingShapes, max_elements: int | None = None, wait: bool = True
) -> tuple[tuple[Element, ...], tuple[PackedElement, ...]]:
    """The elements of an environment: exact ones, and those whose shape is packed.

    The same numbers give the same objects, so that a scene that comes again is known by them.

    Parameters
    ----------
    message : Environment
    shapes : ArrivingShapes
    max_elements : int, optional
    wait : bool
        Whether to wait for what is being packed; otherwise it is left out.

    Raises
    ------
    InvalidEnvironmentError, InvalidOrientationError, NotFiniteError, DuplicateIdError, LimitExceededError,
    NotSupportedError
    """
    place, count = "scene.environment.elements", len(message.elements)
    if max_elements is not None and count > max_elements:
        raise LimitExceededError(f"must be at most {max_elements} elements", field=place, value=count)
    elements, packed, names = [], [], set()
    for k, element in enumerate(message.elements):
        field, name = f"{place}[{k}]", element_id(element, k)
        if name == ENVIRONMENT:
            raise InvalidEnvironmentError(
                "is what all elements together are called", field=f"{field}.id", value=name
            )
        if name in names:
            raise DuplicateIdError("is the id of two elements", field=f"{field}.id", value=name)
        names.add(name)
        if _is_packed(element):
            try:
                packed.append(_packed_element(element, name, field, shapes, wait))
            except UnknownModelError:  # of a stream, which goes on without it until it is there
                continue
        else:
            elements.append(_element(element, name, field))
    return tuple(elements), tuple(packed)


def element_id(message, k: int) -> str:
    """What the k-th element is called."""
    return message.id or f"element_{k}"


def _is_packed(message):
    """Whether a message holds a shape that is not among the exact ones."""
    return bool(message.mesh) or any(primitive.type not in _EXACT for primitive in message.primitive)


def _packed_element(message, name, field, shapes, wait):
    """A mesh, a cone or a prism."""
    if len(message.mesh) + len(message.primitive) + len(message.plane) != 1:
        raise InvalidEnvironmentError("must have exactly one of plane, primitive and mesh", field=field)
    if message.surface_tilt_std:
        raise NotSupportedError(
            "is for planes, boxes, spheres and cylinders", field=f"{field}.surface_tilt_std"
        )
    v, w = message.surface_velocity.linear, message.surface_velocity.angular
    if any((*xyz(v), *xyz(w))):
        raise NotSupportedError(
            "is for planes, boxes, spheres and cylinders", field=f"{field}.surface_velocity"
        )
    if message.mesh:
        model = shapes.of_mesh(message.mesh[0], _OBSTACLE_SPHERES, f"{field}.mesh[0]", wait)
    else:
        model = shapes.of_primitive(message.primitive[0], _OBSTACLE_SPHERES, f"{field}.primitive[0]", wait)
    material = read_material(message.material, f"{field}.material", InvalidEnvironmentError)
    return PackedElement(name, field, model, *_place(message.pose, f"{field}.pose"), material)


def read_material(message, field: str, error: type[UncPhysicsError] = InvalidRequestError) -> tuple:
    """The friction and restitution that a message gives, as pairs of a `Surface`'s keyword and its value.

    Raises
    ------
    UncPhysicsError
        Of the given type, or `NotFiniteError`.
    """
    given = {}
    for name in MATERIAL_FIELDS:
        if (value := optional(getattr(message, name), f"{field}.{name}")) is not None:
            given[name] = value
    if given:
        try:
            check_surface(Surface(**given), error=error)
        except UncPhysicsError as bad:
            raise type(bad)(bad.problem, field=f"{field}.{bad.field}[0]", value=bad.value) from None
    return tuple(given.items())


def read_regions(messages) -> tuple[BoxRegion, ...]:
    """Regions to ask about.

    Parameters
    ----------
    messages : sequence of unc_physics_msgs/BoxRegion

    Raises
    ------
    InvalidEnvironmentError, InvalidOrientationError, NotFiniteError, DuplicateIdError
    """
    regions, ids = [], set()
    for k, message in enumerate(messages):
        field = f"regions[{k}]"
        if not isinstance(message.id, str) or not message.id:
            raise InvalidEnvironmentError("must be a non-empty text", field=f"{field}.id", value=message.id)
        if message.id in ids:
            raise DuplicateIdError("is the id of two regions", field=f"{field}.id", value=message.id)
        ids.add(message.id)
        size = [
            positive(getattr(message.size, axis), f"{field}.size.{axis}", InvalidEnvironmentError)
            for axis in "xyz"
        ]
        regions.append(BoxRegion(message.id, size, *_place(message.pose, f"{field}.pose")))
    return tuple(regions)


def _element(message, name, field):
    """One element, from its message."""
    plane = optional(message.plane, f"{field}.plane")
    primitive = optional(message.primitive, f"{field}.primitive")
    position, orientation = _place(message.pose, f"{field}.pose")
    material = read_material(message.material, f"{field}.material", InvalidEnvironmentError)
    tilt = surface_tilt_std(message.surface_tilt_std, f"{field}.surface_tilt_std")
    material += (("surface_tilt_std", tilt),) if tilt else ()
    material += read_surface_velocity(
        message.surface_velocity, position, f"{field}.surface_velocity", InvalidEnvironmentError
    )
    if primitive is not None and plane is None:
        place = f"{field}.primitive[0]"
        size = read_dimensions(primitive, place)
        return at_field(place, _solid, primitive.type, size, position, orientation, name, material)
    if plane is None or primitive is not None:
        raise InvalidEnvironmentError("must have exactly one of plane, primitive and mesh", field=field)
    place = f"{field}.plane[0].coef"
    coef = tuple(array(plane.coef, (4,), place, InvalidEnvironmentError).tolist())
    try:
        return _plane(coef, position, orientation, name, material)
    except UncPhysicsError as error:
        raise type(error)(error.problem, field=place, value=coef) from None


def _place(pose, field):
    """Position and quaternion as tuples."""
    p, q = pose.position, pose.orientation
    position = array((p.x, p.y, p.z), (3,), f"{field}.position", InvalidEnvironmentError)
    return tuple(position.tolist()), tuple(quaternion((q.x, q.y, q.z, q.w), f"{field}.orientation").tolist())


@functools.lru_cache(maxsize=1024)
def _plane(coef, position, orientation, name, material):
    """The solid is where ``a x + b y + c z + d <= 0`` in the frame of the pose."""
    largest = max(map(abs, coef[:3])) or 1.0  # whose square may be no number
    coef = tuple(entry / largest for entry in coef)
    unit = Plane(coef[:3]).normal  # which refuses one without direction
    normal = rotation_matrix(np.array(orientation)) @ unit
    offset = normal @ np.array(position) - coef[3] / np.linalg.norm(coef[:3])
    return Plane(normal, offset, name, **dict(material))


@functools.lru_cache(maxsize=1024)
def _solid(kind, size, position, orientation, name, material):
    """An element of one of the exact kinds."""
    material = dict(material)
    if kind == SolidPrimitive.BOX:
        return Box(size, position, orientation, name, **material)
    if kind == SolidPrimitive.SPHERE:
        return Sphere(size[SolidPrimitive.SPHERE_RADIUS], position, name, **material)
    radius, height = size[SolidPrimitive.CYLINDER_RADIUS], size[SolidPrimitive.CYLINDER_HEIGHT]
    return Cylinder(radius, height, position, orientation, name, **material)
