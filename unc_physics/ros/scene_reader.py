"""From messages to the core: a scene, and the belief about it.

A message gives the pose of a model's own origin and rotations about the fixed axes of the frame; a `Belief`
gives the pose of the centre of mass and rotations on the body side. `physics.origin` has the algebra.
"""

from __future__ import annotations

import functools
import math
import re
from typing import NamedTuple

import numpy as np

from unc_physics_msgs.msg import ObjectState

from ..checks.errors import (
    DuplicateIdError,
    InvalidCovarianceError,
    InvalidOptionError,
    InvalidRequestError,
    LimitExceededError,
    NoObjectsError,
    NotFiniteError,
    UncPhysicsError,
    UnknownModelError,
)
from ..checks.validation import FARTHEST, array, covariance, non_negative, number, point, quaternion
from ..physics.layout import ANGULAR_VELOCITY, ERROR, POSITION, QUATERNION, STATE, VELOCITY
from ..physics.origin import at_com, congruent, covariance_at_com, inverse_error_map, moved
from ..scene.belief import Belief
from ..scene.body import RigidBody, known_mass
from ..scene.entries import at_field
from ..scene.physics_keys import PHYSICS_KEYS
from ..scene.scene import Scene
from ..scene.scene_file import with_chosen_stiffness
from .action_messages import read_actions, read_path
from .arrays import block_diagonal, writable, xyz, xyzw
from .optional import optional
from .physics_message import physics_field
from .surroundings import MATERIAL_FIELDS, element_id, read_environment, read_material

#: First entry of a covariance that is not known, as in sensor_msgs/Imu.
UNKNOWN = -1.0

_AT_REST = 0.0, 0.0, 0.0
_EXACT = 0.0, (0.0, 0.0, 0.0)  # standard deviations of mass and centre of mass
_KINDS = ObjectState.DYNAMIC, ObjectState.FIXED, ObjectState.PRESCRIBED
_ROUND_OFF = 1e-6  # of a quaternion's length, from single precision at worst


class Doubts(NamedTuple):
    """How covariances that say nothing are read.

    Attributes
    ----------
    pose, twist : (6, 6) array
        Stand in for an unknown covariance; in the order and frame of the messages, at the model's origin.
    zero_is_exact : bool
        Whether zeros mean exactly known; otherwise they mean unknown.
    """

    pose: np.ndarray
    twist: np.ndarray
    zero_is_exact: bool

    @classmethod
    def from_stds(cls, position, orientation, linear_velocity, angular_velocity, zero_is_exact):
        """Unknown covariances from standard deviations [m, rad, m/s, rad/s], the same along all axes."""
        pose = np.diag(np.repeat([position, orientation], 3) ** 2)
        twist = np.diag(np.repeat([linear_velocity, angular_velocity], 3) ** 2)
        return cls(pose, twist, zero_is_exact)


EXACT = Doubts.from_stds(0.0, 0.0, 0.0, 0.0, zero_is_exact=True)


class ReadScene(NamedTuple):
    """What a message says about a scene.

    Attributes
    ----------
    scene : Scene
    belief : Belief
    models : tuple of str
        Each object's model, by the name that the message gives.
    zeros_replaced : bool
        Whether a covariance of zeros was read as unknown.
    skipped : dict of str
        Ids of the objects that were left out, and why.
    """

    scene: Scene
    belief: Belief
    models: tuple[str, ...]
    zeros_replaced: bool
    skipped: dict[str, str]


class Limits(NamedTuple):
    """Most of what a scene may hold: objects, spheres of each of them, and elements of the environment; None
    for any number.
    """

    objects: int | None = None
    spheres: int | None = None
    elements: int | None = None


NO_LIMITS = Limits()


def read_scene(
    message, library, physics, doubts=EXACT, limits=NO_LIMITS, *, fields=None, skip_unknown_models=False
) -> ReadScene:
    """The scene and the belief about it that a message describes, but for the error that all objects share.

    Parameters
    ----------
    message : unc_physics_msgs/Scene
        In the world frame.
    library : ModelLibrary
    physics : dict
        Arguments of `Scene` besides bodies and environment; the stiffness may be `stiffness.AUTO`.
    doubts : Doubts
    limits : Limits
    fields : sequence of str, optional
        What errors call each object; by default ``scene.objects[0]`` and so on.
    skip_unknown_models : bool
        Whether objects whose model is unknown are left out.

    Raises
    ------
    UncPhysicsError
        One of its kinds, naming the field as in a `PredictionRequest` and the value.
    """
    objects = message.objects
    if len(objects) == 0:
        raise NoObjectsError("must name at least one object", field="scene.objects")
    if limits.objects is not None and len(objects) > limits.objects:
        raise LimitExceededError(
            f"must be at most {limits.objects} objects", field="scene.objects", value=len(objects)
        )
    wait = not skip_unknown_models
    elements, packed = read_environment(message.environment, library.arriving, limits.elements, wait)
    fields = [f"scene.objects[{k}]" for k in range(len(objects))] if fields is None else fields
    names = _ids(objects, fields, message.environment.elements)
    read, skipped = [], {}
    for own, field in zip(objects, fields, strict=True):
        try:
            body, state, P, zeros = _body(own, field, library, doubts, limits.spheres, wait)
            read.append((field, own.model or body[1].name, body, state, P, zeros))
        except UnknownModelError as error:
            if not skip_unknown_models:
                raise
            skipped[own.id] = str(error)
    if not read:
        raise NoObjectsError(
            f"must name at least one object whose model is known: {next(iter(skipped.values()))}",
            field="scene.objects",
        )
    read += [(element.field, element.model.name, *_fixed(element)) for element in packed]
    fields = [field for field, *_ in read]
    bodies = tuple(at_field(field, _rigid_body, *body) for field, _, body, *_ in read)
    mean = np.array([state for *_, state, _, _ in read])
    physics = with_chosen_stiffness(physics, bodies, mean)
    constants = tuple((key, _hashable(physics[key])) for key in sorted(physics))
    try:
        scene = _scene(bodies, elements, constants)
    except UncPhysicsError as error:  # the node's own parameters go together
        field = _in_message(error.field or "scene", fields)
        problem = error.problem
        if field.startswith("physics."):  # which is the node's parameter where it is absent
            problem = problem.removesuffix(" or absent")
        kind = InvalidOptionError if isinstance(error, InvalidRequestError) else type(error)
        raise kind(problem, field=field, value=error.value) from None
    moving = scene.moving.copy()
    if (joint := optional(message.joint_covariance, "scene.joint_covariance")) is not None:
        P = _joint_covariance(joint, scene, mean, names)
    else:
        P = np.array([read[b][-2] for b in moving]).reshape(-1, ERROR, ERROR)
    belief = Belief.trusted(mean, P, moving)
    models = tuple(model for _, model, *_ in read)
    return ReadScene(scene, belief, models, any(zeros for *_, zeros in read), skipped)


def _ids(objects, fields, elements):
    """The objects' ids, which must differ from each other and from the elements'."""
    names = set()
    for message, field in zip(objects, fields, strict=True):
        if not isinstance(message.id, str) or not message.id:
            raise InvalidRequestError("must be a non-empty text", field=f"{field}.id", value=message.id)
        if message.id in names:
            raise DuplicateIdError("is the id of two objects", field=f"{field}.id", value=message.id)
        names.add(message.id)
    for k, element in enumerate(elements):
        name = element_id(element, k)
        if name in names:
            raise DuplicateIdError(
                "is the id of an object, too", field=f"scene.environment.elements[{k}].id", value=name
            )
    return names


def _in_message(field, fields):
    """What a message calls a field of the scene made from it: an object's, an element's, or the physics'."""
    if found := re.fullmatch(r"bodies\[(\d+)\]\.(\w+)", field):
        place, name = fields[int(found[1])], found[2]
    elif found := re.fullmatch(r"environment\[(\d+)\]\.(\w+)", field):
        place, name = f"scene.environment.elements[{found[1]}]", found[2]
    else:
        return f"physics.{physics_field(field)}" if field in PHYSICS_KEYS else field
    return f"{place}.material.{name}[0]" if name in MATERIAL_FIELDS else f"{place}.{name}"


@functools.lru_cache(maxsize=1024)
def _rigid_body(*arguments):
    """The same body for the same arguments, so that a scene that comes again is known by its bodies."""
    *others, named = arguments
    return RigidBody(*others, **dict(named))


@functools.lru_cache(maxsize=32)
def _scene(bodies, elements, physics):
    """A scene that comes again keeps what the kernels need."""
    return Scene(bodies, environment=elements, **dict(physics))


def _hashable(value):
    return value if value is None or isinstance(value, (str, bool, int, float)) else tuple(value)


def _fixed(element):
    """As `_body`, of an element whose shape is packed."""
    at_origin = np.zeros(STATE)
    at_origin[POSITION], at_origin[QUATERNION] = element.position, element.orientation
    body = element.name, element.model, 1.0, True, *_EXACT, False, None, None, element.material
    return body, moved(at_origin, writable(element.model.origin), -1.0), np.zeros((ERROR, ERROR)), False


def _shape(message, library, max_spheres, wait):
    """The packing of an object: of a named model, of a primitive, or of a mesh."""
    given = [name for name in ("model", "primitive", "mesh") if len(getattr(message, name))]
    if given not in (["primitive"], ["mesh"]):
        if len(given) > 1:
            raise InvalidRequestError("must not be given beside a model", field=given[-1])
        return library.shape(message.model, message.spheres, number(message.scale, "scale"), max_spheres)
    (name,) = given
    shape = optional(getattr(message, name), name)
    if max_spheres is not None and message.spheres > max_spheres:
        raise LimitExceededError(f"must be at most {max_spheres}", field="spheres", value=message.spheres)
    pack = library.arriving.of_mesh if name == "mesh" else library.arriving.of_primitive
    packing = pack(shape, message.spheres, f"{name}[0]", wait)
    return packing.scaled(number(message.scale, "scale") or 1.0)


def _body(message, field, library, doubts, max_spheres, wait=True):
    """What makes a body, its state (13,), its covariance (12, 12), and whether zeros were read as unknown."""
    fixed = _is_fixed(message, field)
    try:
        model = _shape(message, library, max_spheres, wait)
    except UncPhysicsError as error:
        place = (
            f"{field}.{error.field}"
            if (error.field or "").partition("[")[0] in ("model", "spheres", "scale", "primitive", "mesh")
            else f"{field}.model: {error.field}"
        )
        raise type(error)(error.problem, field=place, value=error.value) from error
    origin = writable(model.origin)
    path = read_path(message, field, origin)
    driven = fixed or path is not None
    mass = known_mass(message.mass or None, model, driven, f"{field}.mass")
    stds = _EXACT if driven else _stds(message, field, mass)
    material = read_material(message.material, f"{field}.material")
    inertia = _inertia(message, f"{field}.inertia")
    surface = material + read_actions(message, field)
    body = message.id, model, mass, fixed, *stds, bool(message.at_rest), inertia, path, surface
    if path is not None:
        return body, path.states[0], np.zeros((ERROR, ERROR)), False
    state = moved(_state(message, field, fixed), origin, -1.0)
    if fixed:
        return body, state, np.zeros((ERROR, ERROR)), False
    P, zeros = _covariance(message, field, doubts, state, origin)
    if not math.isfinite(state.sum() + P.sum()):
        raise NotFiniteError("is too large to be moved to the centre of mass", field=field)
    return body, state, P, zeros


def _inertia(message, field):
    """Inertia per unit mass, as rows of tuples; None for the model's, where it is empty or zeros."""
    if not any(message.inertia):
        return None
    rows = array(message.inertia, (9,), field).reshape(3, 3).tolist()
    return tuple(map(tuple, rows))


def _is_fixed(message, field):
    """Whether an object is fixed."""
    if message.kind not in _KINDS:
        raise InvalidRequestError(
            "must be DYNAMIC, FIXED or PRESCRIBED", field=f"{field}.kind", value=message.kind
        )
    return message.kind == ObjectState.FIXED


def _covariance(message, field, doubts, state, origin):
    """Covariance (12, 12) at the centre of mass, and whether zeros were read as unknown."""
    if len(message.covariance):
        place = f"{field}.covariance"
        C = _checked(array(message.covariance, (ERROR**2,), place, InvalidCovarianceError).tobytes(), place)
        return at_com(C, state, origin), False
    P_pose, zero_pose = _known_covariance(
        message.pose.covariance, f"{field}.pose.covariance", doubts.pose, doubts.zero_is_exact
    )
    P_twist, zero_twist = _known_covariance(
        message.twist.covariance, f"{field}.twist.covariance", doubts.twist, doubts.zero_is_exact
    )
    return covariance_at_com(P_pose, P_twist, state, origin), zero_pose or zero_twist


def _joint_covariance(message, scene, mean, known):
    """The covariance (12 M, 12 M) of all moving bodies, from that of a message.

    Parameters
    ----------
    message : JointCovariance
    scene : Scene
    mean : (B, 13) array
    known : set of str
        Ids of all of the request's objects; what is not in the scene was left out.
    """
    place = "scene.joint_covariance[0]"
    ids = list(message.object_ids)
    for k, name in enumerate(ids):
        if name not in known:
            raise InvalidCovarianceError(
                "is no object of the scene", field=f"{place}.object_ids[{k}]", value=name
            )
        if name in ids[:k]:
            raise DuplicateIdError("comes twice", field=f"{place}.object_ids[{k}]", value=name)
    size = ERROR * len(ids)
    C = array(message.data, (size**2,), f"{place}.data", InvalidCovarianceError).reshape(size, size)
    C = covariance(C, size, f"{place}.data") if size else C
    moving = scene.moving.tolist()
    rows = []
    for b in moving:
        name = scene.bodies[b].name
        if name not in ids:
            raise InvalidCovarianceError(f"must name '{name}', which moves", field=f"{place}.object_ids")
        rows.append(ERROR * ids.index(name) + np.arange(ERROR))
    driven = {body.name for body in scene.bodies if not body.free}
    for k, name in enumerate(ids):
        if name in driven:
            raise InvalidCovarianceError(
                "is fixed or prescribed", field=f"{place}.object_ids[{k}]", value=name
            )
    rows = np.concatenate(rows) if rows else np.zeros(0, int)
    maps = [inverse_error_map(mean[b], writable(scene.bodies[b].model.origin)) for b in moving]
    P = congruent(block_diagonal(maps), np.ascontiguousarray(C[np.ix_(rows, rows)]))
    if not np.isfinite(P).all():
        raise NotFiniteError("is too large to be moved to the centres of mass", field=f"{place}.data")
    return P


def _state(message, field, fixed):
    """State (13,) at the model's origin; a fixed object is at rest."""
    pose, twist = message.pose.pose, message.twist.twist
    position, q = xyz(pose.position), xyzw(pose.orientation)
    v, w = (_AT_REST, _AT_REST) if fixed else (xyz(twist.linear), xyz(twist.angular))
    try:
        length, fine = math.hypot(*q), math.isfinite(sum((*position, *v, *w)))
        fine = fine and max(map(abs, position)) <= FARTHEST
    except TypeError:
        length, fine = 0.0, False
    if fine and abs(length - 1.0) < _ROUND_OFF:
        q = [component / length for component in q]
    else:  # one by one, to say what is wrong
        q = quaternion(q, f"{field}.pose.pose.orientation")
        position = point(position, f"{field}.pose.pose.position")
        v, w = array(v, (3,), f"{field}.twist.twist.linear"), array(w, (3,), f"{field}.twist.twist.angular")
    if message.at_rest:
        for velocity, name in ((v, "linear"), (w, "angular")):
            if any(velocity):
                raise InvalidRequestError(
                    "must be zero, as the object is at_rest",
                    field=f"{field}.twist.twist.{name}",
                    value=tuple(velocity),
                )
    state = np.empty(STATE)
    state[POSITION], state[VELOCITY], state[QUATERNION], state[ANGULAR_VELOCITY] = position, v, q, w
    return state


def _stds(message, field, mass):
    """Standard deviations of the mass and of the centre of mass."""
    of_center = message.center_of_mass_std
    if message.mass_std == of_center.x == of_center.y == of_center.z == 0.0:
        return _EXACT
    mass_std = non_negative(message.mass_std, f"{field}.mass_std", InvalidCovarianceError)
    if mass_std > mass:
        raise InvalidCovarianceError(
            f"must not exceed the mass of {mass:.6g} kg", field=f"{field}.mass_std", value=mass_std
        )
    return mass_std, tuple(
        non_negative(getattr(of_center, axis), f"{field}.center_of_mass_std.{axis}", InvalidCovarianceError)
        for axis in "xyz"
    )


def _known_covariance(values, field, unknown, zero_is_exact):
    """The covariance (6, 6) to calculate with, and whether zeros were read as unknown."""
    plain = isinstance(values, np.ndarray) and values.dtype == np.float64 and values.shape == (36,)
    P = _checked((values if plain else array(values, (36,), field, InvalidCovarianceError)).tobytes(), field)
    if P is None:
        return unknown, False
    if zero_is_exact or P.any():
        return P, False
    return unknown, True


@functools.lru_cache(maxsize=256)
def _checked(entries, field):
    """The covariance of 6 or 12 errors from the bytes of its entries, None if it is unknown; clients send the
    same ones again and again.
    """
    flat = np.frombuffer(entries)
    size = math.isqrt(len(flat))
    P = flat.reshape(size, size)
    if size < ERROR and flat[0] == UNKNOWN:
        array(P, (size, size), field, InvalidCovarianceError)
        return None
    return writable(covariance(P, size, field))
