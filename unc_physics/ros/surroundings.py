"""The environment, materials and regions of a request, from their messages."""

from __future__ import annotations

import functools

import numpy as np
from shape_msgs.msg import SolidPrimitive

from ..checks.errors import (
    DuplicateIdError,
    InvalidEnvironmentError,
    InvalidRequestError,
    LimitExceededError,
    UncPhysicsError,
)
from ..checks.validation import array, positive, quaternion
from ..physics.rotation import rotation_matrix
from ..prediction.probabilities import ENVIRONMENT, BoxRegion
from ..scene.environment import Box, Cylinder, Element, Plane, Sphere, surface_tilt_std
from ..scene.materials import Surface, check_surface
from ..scene.scene_file import at_field
from .action_messages import read_surface_velocity
from .not_served import refuse_not_served
from .optional import optional

#: Fields of a material that are served; they are those of a `Surface`.
MATERIAL_FIELDS = ("friction", "friction_std", "restitution", "restitution_std", "torsional_friction")
#: Number of dimensions of each kind of primitive that is served.
_DIMENSIONS = {SolidPrimitive.BOX: 3, SolidPrimitive.SPHERE: 1, SolidPrimitive.CYLINDER: 2}


def read_environment(message, max_elements: int | None = None) -> tuple[Element, ...]:
    """The elements of an environment.

    The same numbers give the same objects, so that a scene that comes again is known by them.

    Parameters
    ----------
    message : Environment
    max_elements : int, optional

    Raises
    ------
    InvalidEnvironmentError, InvalidOrientationError, NotFiniteError, DuplicateIdError, LimitExceededError,
    NotSupportedError
    """
    place, count = "scene.environment.elements", len(message.elements)
    if max_elements is not None and count > max_elements:
        raise LimitExceededError(f"must be at most {max_elements} elements", field=place, value=count)
    elements, names = [], set()
    for k, element in enumerate(message.elements):
        field, name = f"{place}[{k}]", element.id or f"element_{k}"
        if name == ENVIRONMENT:
            raise InvalidEnvironmentError(
                "is what all elements together are called", field=f"{field}.id", value=name
            )
        if name in names:
            raise DuplicateIdError("is the id of two elements", field=f"{field}.id", value=name)
        names.add(name)
        elements.append(_element(element, name, field))
    return tuple(elements)


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
    refuse_not_served("EnvironmentElement", message, f"{field}.")
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
        size = _dimensions(primitive, place)
        return at_field(place, _solid, primitive.type, size, position, orientation, name, material)
    if plane is None or primitive is not None:
        raise InvalidEnvironmentError("must have exactly one of plane, primitive and mesh", field=field)
    place = f"{field}.plane[0].coef"
    coef = tuple(array(plane.coef, (4,), place, InvalidEnvironmentError).tolist())
    try:
        return _plane(coef, position, orientation, name, material)
    except UncPhysicsError as error:
        raise type(error)(error.problem, field=place, value=coef) from None


def _dimensions(primitive, field):
    refuse_not_served("SolidPrimitive", primitive, f"{field}.")
    if primitive.type not in _DIMENSIONS:
        raise InvalidEnvironmentError("is no kind of primitive", field=f"{field}.type", value=primitive.type)
    shape, field = (_DIMENSIONS[primitive.type],), f"{field}.dimensions"
    size = array(primitive.dimensions, shape, field, InvalidEnvironmentError).tolist()
    return tuple(positive(value, f"{field}[{k}]", InvalidEnvironmentError) for k, value in enumerate(size))


def _place(pose, field):
    """Position and quaternion as tuples."""
    p, q = pose.position, pose.orientation
    position = array((p.x, p.y, p.z), (3,), f"{field}.position", InvalidEnvironmentError)
    return tuple(position.tolist()), tuple(quaternion((q.x, q.y, q.z, q.w), f"{field}.orientation").tolist())


@functools.lru_cache(maxsize=1024)
def _plane(coef, position, orientation, name, material):
    """The solid is where ``a x + b y + c z + d <= 0`` in the frame of the pose."""
    unit = Plane(coef[:3]).normal  # which refuses one without direction
    normal = rotation_matrix(np.array(orientation)) @ unit
    offset = normal @ np.array(position) - coef[3] / np.linalg.norm(coef[:3])
    return Plane(normal, offset, name, **dict(material))


@functools.lru_cache(maxsize=1024)
def _solid(kind, size, position, orientation, name, material):
    """An element of a kind that `_dimensions` lets pass."""
    material = dict(material)
    if kind == SolidPrimitive.BOX:
        return Box(size, position, orientation, name, **material)
    if kind == SolidPrimitive.SPHERE:
        return Sphere(size[SolidPrimitive.SPHERE_RADIUS], position, name, **material)
    radius, height = size[SolidPrimitive.CYLINDER_RADIUS], size[SolidPrimitive.CYLINDER_HEIGHT]
    return Cylinder(radius, height, position, orientation, name, **material)
