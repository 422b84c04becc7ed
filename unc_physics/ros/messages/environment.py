"""Elements of the environment, materials and regions."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from geometry_msgs.msg import Twist
from shape_msgs.msg import Plane as PlaneMessage
from shape_msgs.msg import SolidPrimitive

from unc_physics_msgs.msg import EnvironmentElement, Material, MaterialPair

from ...checks.errors import (
    DuplicateIdError,
    InvalidEnvironmentError,
    InvalidRequestError,
    LimitExceededError,
    NotSupportedError,
    UncPhysicsError,
    UnknownModelError,
)
from ...checks.validation import array, positive, quaternion
from ...prediction.regions import BoxRegion
from ...scene.entries import at_field
from ...scene.environment import Box, Cylinder, Element, Plane, Sphere, check_not_reserved, surface_tilt_std
from ...scene.materials import Surface, check_surface
from ...scene.pairs import PairMaterial
from ...shapes.packing_file import SpherePacking
from ...spatial.rotation import rotation_matrix
from .fields import given_shapes, optional, packed, pose_message, twist_message, xyz, xyzw

#: Fields of a Material message with a flag, and those without; a `Surface` has attributes of the same names.
_OPTIONAL_FIELDS = ("friction", "restitution", "torsional_friction", "rolling_friction")
_STD_FIELDS = ("friction_std", "restitution_std")
#: Name of the Material message's field for each attribute of a `Surface`.
MATERIAL_FIELDS = {"material": "name"} | {name: name for name in _OPTIONAL_FIELDS + _STD_FIELDS}
#: Kinds of primitives that are packed; the others are exact elements.
_PACKED_KINDS = SolidPrimitive.CONE, SolidPrimitive.PRISM
_OBSTACLE_SPHERES = 1000  # spheres of a packed element
#: Number of dimensions of each kind of primitive.
DIMENSIONS = {
    SolidPrimitive.BOX: 3,
    SolidPrimitive.SPHERE: 1,
    SolidPrimitive.CYLINDER: 2,
    SolidPrimitive.CONE: 2,
    SolidPrimitive.PRISM: 1,
}


class PackedElement(NamedTuple):
    """Element with a packed shape, which becomes a fixed body.

    Attributes
    ----------
    name : str
    field : str
        Name of the element in error messages.
    model : SpherePacking
    position, orientation : tuple
        Pose of the shape's origin: world frame [m], quaternion (x, y, z, w).
    material : tuple
        As returned by `read_material`.
    """

    name: str
    field: str
    model: SpherePacking
    position: tuple[float, ...]
    orientation: tuple[float, ...]
    material: tuple


def read_environment(
    message, shape_packer, max_elements: int | None = None, wait: bool = True
) -> tuple[tuple[Element, ...], tuple[PackedElement, ...]]:
    """Return the elements of an environment: exact ones, and those with a packed shape.

    Equal numbers give identical objects, so that caches recognize a repeated scene.

    Parameters
    ----------
    message : Environment
    shape_packer : ShapePacker
    max_elements : int, optional
    wait : bool
        Whether to wait for shapes that are being packed; otherwise they are omitted.

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
        check_not_reserved(name, f"{field}.id")
        if name in names:
            raise DuplicateIdError("is the id of two elements", field=f"{field}.id", value=name)
        names.add(name)
        shapes = given_shapes(element)
        if len(shapes) != 1:
            raise InvalidEnvironmentError("must have exactly one of plane, primitive and mesh", field=field)
        if shapes == ["mesh"] or element.primitive.type in _PACKED_KINDS:
            try:
                packed.append(_packed_element(element, name, field, shape_packer, wait))
            except UnknownModelError:  # a stream continues without it until it is packed
                continue
        else:
            elements.append(_element(element, name, field))
    return tuple(elements), tuple(packed)


def element_id(message, k: int) -> str:
    """Return the name of the k-th element."""
    return message.id or f"element_{k}"


def write_element(element: Element, name: str, field: str) -> EnvironmentElement:
    """Return the message of an exact element.

    Raises
    ------
    NotSupportedError
        If messages do not support its shape.
    """
    message = EnvironmentElement(
        id=name, material=write_material(element), surface_tilt_std=element.surface_tilt_std
    )
    if isinstance(element, Plane):
        message.plane = PlaneMessage(coef=np.array([*element.normal, -element.offset]))
        message.surface_velocity = _write_surface_velocity(element, (0.0, 0.0, 0.0))
        return message
    if isinstance(element, Box):
        kind, size = SolidPrimitive.BOX, element.size
    elif isinstance(element, Sphere):
        kind, size = SolidPrimitive.SPHERE, [element.radius]
    elif isinstance(element, Cylinder):
        kind, size = SolidPrimitive.CYLINDER, [element.length, element.radius]
    else:
        raise NotSupportedError(
            f"is a {element.shape}, for which messages have no room; take a cylinder, or a fixed body with a"
            " model of that shape",
            field=field,
            value=name,
        )
    message.primitive = SolidPrimitive(type=kind, dimensions=packed(size))
    message.pose = pose_message(element.position, element.orientation)
    message.surface_velocity = _write_surface_velocity(element, element.position)
    return message


def read_material(message, field: str, error: type[UncPhysicsError] = InvalidRequestError) -> tuple:
    """Return the material of a message as pairs of a `Surface`'s keyword and its value.

    Raises
    ------
    UncPhysicsError
        Of the given type, or `NotFiniteError`.
    """
    given = {"material": message.name} if message.name else {}
    for name in _OPTIONAL_FIELDS:
        if (value := optional(message, name, field)) is not None:
            given[name] = value
    for name in _STD_FIELDS:
        if value := getattr(message, name):
            given[name] = value
    if given:
        try:
            check_surface(Surface(**given), error=error)
        except UncPhysicsError as bad:
            name = MATERIAL_FIELDS.get(bad.field or "", bad.field)
            raise type(bad)(bad.problem, field=f"{field}.{name}", value=bad.value) from None
    return tuple(given.items())


def write_material(surface: Surface) -> Material:
    """Return the message of a surface's material; absent entries take the default."""
    message = Material(name=surface.material or "", **{name: getattr(surface, name) for name in _STD_FIELDS})
    for name in _OPTIONAL_FIELDS:
        if (value := getattr(surface, name)) is not None:
            setattr(message, name, float(value))
            setattr(message, f"has_{name}", True)
    return message


def read_pairs(messages: Sequence[MaterialPair]) -> tuple[PairMaterial, ...]:
    """Return the materials of pairs, which `Scene` checks.

    Raises
    ------
    UncPhysicsError
    """
    found = []
    for k, message in enumerate(messages):
        given = dict(read_material(message.material, f"scene.pairs[{k}].material"))
        for name in ("material", *_STD_FIELDS):
            if name in given:
                raise NotSupportedError(
                    "must be unset, as the quantities of a pair are exactly known",
                    field=f"scene.pairs[{k}].material.{MATERIAL_FIELDS[name]}",
                    value=given[name],
                )
        found.append(PairMaterial((message.object_a, message.object_b), **given))
    return tuple(found)


def write_pair(name: str, other: str, quantities: Mapping[str, float]) -> MaterialPair:
    """Return the message of the quantities of a pair."""
    message = MaterialPair(object_a=name, object_b=other)
    for key, value in quantities.items():
        setattr(message.material, key, float(value))
        setattr(message.material, f"has_{key}", True)
    return message


def read_regions(messages) -> tuple[BoxRegion, ...]:
    """Return the regions of a request.

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


def read_dimensions(message, field: str) -> tuple[float, ...]:
    """Return the dimensions of a primitive [m].

    Raises
    ------
    InvalidEnvironmentError
        If the kind is unknown, or the number or sign of the dimensions is wrong.
    """
    if message.type not in DIMENSIONS:
        raise InvalidEnvironmentError("is no kind of primitive", field=f"{field}.type", value=message.type)
    shape, field = (DIMENSIONS[message.type],), f"{field}.dimensions"
    size = array(message.dimensions, shape, field, InvalidEnvironmentError).tolist()
    return tuple(positive(value, f"{field}[{k}]", InvalidEnvironmentError) for k, value in enumerate(size))


def _read_surface_velocity(twist: Twist, position, field: str) -> tuple[tuple[str, Any], ...]:
    """Return the velocity of an element's surface as pairs of an `Element`'s keyword and its value.

    The message gives it at the origin of the element's pose.
    """
    linear = array(xyz(twist.linear), (3,), f"{field}.linear", InvalidEnvironmentError)
    angular = array(xyz(twist.angular), (3,), f"{field}.angular", InvalidEnvironmentError)
    if not (linear.any() or angular.any()):
        return ()
    return (
        ("surface_velocity", tuple(linear.tolist())),
        ("surface_angular_velocity", tuple(angular.tolist())),
        ("surface_center", tuple(position)),
    )


def _write_surface_velocity(element: Element, origin) -> Twist:
    """Return the velocity of an element's surface at the origin of its pose."""
    omega = element.surface_angular_velocity
    linear = element.surface_velocity + np.cross(omega, np.asarray(origin) - element.surface_center)
    return twist_message(linear, omega)


def _packed_element(message, name, field, shape_packer, wait):
    """Return a mesh, a cone or a prism."""
    if message.surface_tilt_std:
        raise NotSupportedError(
            "is for planes, boxes, spheres and cylinders", field=f"{field}.surface_tilt_std"
        )
    v, w = message.surface_velocity.linear, message.surface_velocity.angular
    if any((*xyz(v), *xyz(w))):
        raise NotSupportedError(
            "is for planes, boxes, spheres and cylinders", field=f"{field}.surface_velocity"
        )
    if message.primitive.type in _PACKED_KINDS:
        model = shape_packer.of_primitive(message.primitive, _OBSTACLE_SPHERES, f"{field}.primitive", wait)
    else:
        model = shape_packer.of_mesh(message.mesh, _OBSTACLE_SPHERES, f"{field}.mesh", wait)
    material = read_material(message.material, f"{field}.material", InvalidEnvironmentError)
    return PackedElement(name, field, model, *_place(message.pose, f"{field}.pose"), material)


def _element(message, name, field):
    """Return an exact element."""
    position, orientation = _place(message.pose, f"{field}.pose")
    material = read_material(message.material, f"{field}.material", InvalidEnvironmentError)
    tilt = surface_tilt_std(message.surface_tilt_std, f"{field}.surface_tilt_std")
    material += (("surface_tilt_std", tilt),) if tilt else ()
    material += _read_surface_velocity(message.surface_velocity, position, f"{field}.surface_velocity")
    if given_shapes(message) == ["primitive"]:
        place = f"{field}.primitive"
        size = read_dimensions(message.primitive, place)
        return at_field(place, _solid, message.primitive.type, size, position, orientation, name, material)
    place = f"{field}.plane.coef"
    coef = tuple(array(message.plane.coef, (4,), place, InvalidEnvironmentError).tolist())
    try:
        return _plane(coef, position, orientation, name, material)
    except UncPhysicsError as error:
        raise type(error)(error.problem, field=place, value=coef) from None


def _place(pose, field):
    """Return a pose's position and quaternion as tuples."""
    position = array(xyz(pose.position), (3,), f"{field}.position", InvalidEnvironmentError)
    return tuple(position.tolist()), tuple(
        quaternion(xyzw(pose.orientation), f"{field}.orientation").tolist()
    )


@functools.lru_cache(maxsize=1024)
def _plane(coef, position, orientation, name, material):
    """Return the half-space ``a x + b y + c z + d <= 0`` in the frame of the pose."""
    largest = max(map(abs, coef[:3])) or 1.0  # the square of a large normal could overflow
    coef = tuple(entry / largest for entry in coef)
    unit = Plane(coef[:3]).normal  # raises an error for a zero normal
    normal = rotation_matrix(np.array(orientation)) @ unit
    offset = normal @ np.array(position) - coef[3] / np.linalg.norm(coef[:3])
    return Plane(normal, offset, name, **dict(material))


@functools.lru_cache(maxsize=1024)
def _solid(kind, size, position, orientation, name, material):
    """Return an element of an exact kind."""
    material = dict(material)
    if kind == SolidPrimitive.BOX:
        return Box(size, position, orientation, name, **material)
    if kind == SolidPrimitive.SPHERE:
        return Sphere(size[SolidPrimitive.SPHERE_RADIUS], position, name, **material)
    radius, height = size[SolidPrimitive.CYLINDER_RADIUS], size[SolidPrimitive.CYLINDER_HEIGHT]
    return Cylinder(radius, height, position, orientation, name, **material)
