"""The environment and the regions of a request, from their messages."""

from __future__ import annotations

import functools
import math

from shape_msgs.msg import SolidPrimitive

from ..checks.errors import (
    DuplicateIdError,
    InvalidEnvironmentError,
    LimitExceededError,
    NotSupportedError,
    UncPhysicsError,
)
from ..checks.validation import array, positive, quaternion
from ..prediction.probabilities import ENVIRONMENT, BoxRegion
from ..scene.environment import Box, Cylinder, Element, Plane, Sphere

#: Number of dimensions of each kind of primitive that is served, and the names of the others.
_DIMENSIONS = {SolidPrimitive.BOX: 3, SolidPrimitive.SPHERE: 1, SolidPrimitive.CYLINDER: 2}
_NOT_SERVED = {SolidPrimitive.CONE: "CONE", SolidPrimitive.PRISM: "PRISM"}


def read_environment(message, max_elements: int | None = None) -> tuple[Element, ...]:
    """Planes and primitives, in this order.

    The same numbers give the same objects, so that a scene that comes again is known by them.

    Parameters
    ----------
    message : Environment
    max_elements : int, optional

    Raises
    ------
    InvalidEnvironmentError, InvalidOrientationError, NotFiniteError, DuplicateIdError, LimitExceededError,
    NotSupportedError
        The last for a cone or a prism.
    """
    planes, primitives, poses = message.planes, message.primitives, message.primitive_poses
    count = len(planes) + len(primitives)
    if max_elements is not None and count > max_elements:
        raise LimitExceededError(
            f"must be at most {max_elements} planes and primitives", field="environment", value=count
        )
    if len(poses) != len(primitives):
        raise InvalidEnvironmentError(
            f"must have a pose for each of the {len(primitives)} primitives",
            field="environment.primitive_poses",
            value=len(poses),
        )
    names = _names(message.ids, len(planes), len(primitives))
    elements: list[Element] = [
        _plane(
            tuple(array(plane.coef, (4,), f"environment.planes[{k}].coef", InvalidEnvironmentError).tolist()),
            names[k],
            k,
        )
        for k, plane in enumerate(planes)
    ]
    for k, (primitive, pose) in enumerate(zip(primitives, poses, strict=True)):
        size = _dimensions(primitive, f"environment.primitives[{k}]")
        place = _place(pose, f"environment.primitive_poses[{k}]")
        elements.append(_solid(primitive.type, size, *place, names[len(planes) + k]))
    return tuple(elements)


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


def _names(ids, planes, primitives):
    """A name for each element."""
    names = [f"plane_{k}" for k in range(planes)] + [f"primitive_{k}" for k in range(primitives)]
    if ids and len(ids) != len(names):
        raise InvalidEnvironmentError(
            f"must be empty, or a name for each of the {len(names)} elements",
            field="environment.ids",
            value=len(ids),
        )
    for k, name in enumerate(ids):
        if name == ENVIRONMENT:
            raise InvalidEnvironmentError(
                "is what all elements together are called", field=f"environment.ids[{k}]", value=name
            )
        names[k] = name or names[k]
    for k, name in enumerate(names):
        if name in names[:k]:
            raise DuplicateIdError("is the id of two elements", field=f"environment.ids[{k}]", value=name)
    return names


def _dimensions(primitive, field):
    if primitive.type in _NOT_SERVED:
        raise NotSupportedError(
            "must be BOX, SPHERE or CYLINDER; a fixed object with a model may have any shape",
            field=f"{field}.type",
            value=_NOT_SERVED[primitive.type],
        )
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
def _plane(coef, name, k):
    """The solid is where ``a x + b y + c z + d <= 0``."""
    length = math.hypot(*coef[:3])
    try:
        return Plane(coef[:3], -coef[3] / length if length else 0.0, name)
    except UncPhysicsError as error:
        raise type(error)(error.problem, field=f"environment.planes[{k}].coef", value=coef) from None


@functools.lru_cache(maxsize=1024)
def _solid(kind, size, position, orientation, name):
    """An element of a kind that `_dimensions` lets pass."""
    if kind == SolidPrimitive.BOX:
        return Box(size, position, orientation, name)
    if kind == SolidPrimitive.SPHERE:
        return Sphere(size[SolidPrimitive.SPHERE_RADIUS], position, name)
    radius, height = size[SolidPrimitive.CYLINDER_RADIUS], size[SolidPrimitive.CYLINDER_HEIGHT]
    return Cylinder(radius, height, position, orientation, name)
