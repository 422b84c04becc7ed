"""Scene messages, with the belief about the scene.

Messages use the pose of a model's own origin and rotations about fixed axes of the frame. A `Belief` uses the
centre of mass and body-frame rotations; `spatial.origin` converts.
"""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from unc_physics_msgs.msg import JointCovariance, ObjectState

from ...checks.errors import (
    DuplicateIdError,
    InvalidCovarianceError,
    InvalidMassError,
    InvalidOptionError,
    InvalidRequestError,
    LimitExceededError,
    NoObjectsError,
    NotFiniteError,
    UncPhysicsError,
)
from ...checks.validation import FARTHEST, array, non_negative, number, point, quaternion
from ...scene.belief import Belief
from ...scene.body import RigidBody, known_mass, valid_mass
from ...scene.environment import check_not_reserved
from ...scene.physics_keys import PHYSICS_KEYS
from ...scene.scene import Scene
from ...scene.scene_file import with_chosen_stiffness
from ...spatial.layout import (
    ANGULAR_VELOCITY,
    ERR_ANGULAR_VELOCITY,
    ERR_POSITION,
    ERR_ROTATION,
    ERR_VELOCITY,
    ERROR,
    POSITION,
    QUATERNION,
    STATE,
    VELOCITY,
)
from ...spatial.origin import at_com, congruent, error_map, inverse_error_map, moved
from ...spatial.rotation import rotation_matrix
from .actions import ObjectActions, group_actions, read_actions, read_path
from .covariances import ANY_ANGLE_VARIANCE, EXACT, ReadCovariance, read_whole
from .environment import MATERIAL_FIELDS, element_id, read_environment, read_material, read_pairs
from .fields import given_shapes, packed, writable, xyz, xyzw

_AT_REST = 0.0, 0.0, 0.0
_EXACT = 0.0, (0.0, 0.0, 0.0)  # standard deviations of mass and centre of mass
# places of pose and twist in a covariance (12, 12)
_POSE = np.ix_(*[np.r_[ERR_POSITION, ERR_ROTATION]] * 2)
_TWIST = np.ix_(*[np.r_[ERR_VELOCITY, ERR_ANGULAR_VELOCITY]] * 2)
_KINDS = ObjectState.DYNAMIC, ObjectState.FIXED, ObjectState.PRESCRIBED
_YAW = 5  # row of a pose covariance
_ROUND_OFF = 1e-6  # tolerance of a quaternion's length, for single precision


class ReadScene(NamedTuple):
    """Scene and belief of a message, and notes about its conversion.

    Attributes
    ----------
    scene : Scene
    belief : Belief
    models : tuple of str
        Name of each object's model in the message.
    zeros_replaced : bool
        Whether a covariance of zeros was read as unknown.
    skipped : dict of str
        Reasons of omitted objects, by id.
    notes : dict of tuple of str
        What was changed in the covariances of an object, by id.
    """

    scene: Scene
    belief: Belief
    models: tuple[str, ...]
    zeros_replaced: bool
    skipped: dict[str, str]
    notes: dict[str, tuple[str, ...]]


class AllSkippedError(NoObjectsError):
    """A scene all of whose objects were omitted.

    Attributes
    ----------
    skipped : dict of str
        Reasons of the objects, by id.
    """

    def __init__(self, skipped: dict[str, str]):
        self.skipped = skipped
        problem = f"must hold at least one valid object: {next(iter(skipped.values()))}"
        super().__init__(problem, field="scene.objects")


class FieldNames(NamedTuple):
    """Names of the objects and of the actions of a request in error messages."""

    objects: list[str]
    actions: list[str]


class BodyFields(NamedTuple):
    """Names of the fields of a body in error messages.

    Attributes
    ----------
    field : str
        Name of the object or element.
    actions : ObjectActions
    """

    field: str
    actions: ObjectActions

    def of(self, attribute: str) -> str:
        """Return the message's name of an attribute of a `RigidBody`."""
        if attribute in MATERIAL_FIELDS:
            return f"{self.field}.material.{MATERIAL_FIELDS[attribute]}"
        return self.actions.field(attribute) or f"{self.field}.{attribute}"


class ReadObject(NamedTuple):
    """Object or packed element of a message, as a body.

    Attributes
    ----------
    fields : BodyFields
    body : RigidBody
    model : str
        Name in the message.
    state : (13,) array
        At the centre of mass.
    covariance : (12, 12) array
    zeros_replaced : bool
        Whether a covariance of zeros was read as unknown.
    notes : tuple of str
        What was changed in its covariances.
    """

    fields: BodyFields
    body: RigidBody
    model: str
    state: np.ndarray
    covariance: np.ndarray
    zeros_replaced: bool = False
    notes: tuple[str, ...] = ()


def read_scene(
    message,
    library,
    physics,
    covariance_defaults=EXACT,
    max_objects=None,
    *,
    actions=(),
    environment=None,
    fields=None,
    skip_invalid_objects=False,
) -> ReadScene:
    """Return the scene and the belief of a message, without the shared pose error.

    Parameters
    ----------
    message : unc_physics_msgs/Scene
        In the world frame.
    library : ModelLibrary
    physics : dict
        Arguments of `Scene` besides bodies and environment; the stiffness may be `stiffness.AUTO`.
    covariance_defaults : CovarianceDefaults
    max_objects : int, optional
        Most objects, and most elements.
    actions : sequence of Action
    environment : unc_physics_msgs/Environment, optional
        By default that of the message.
    fields : FieldNames, optional
        By default ``scene.objects[0]``, ``actions[0]`` and so on.
    skip_invalid_objects : bool
        Whether objects are omitted that are invalid, or whose model is unknown or still being packed.

    Raises
    ------
    UncPhysicsError
        A subclass that names the value, and the field as in a `PredictionRequest`.
    """
    objects = message.objects
    if len(objects) == 0:
        raise NoObjectsError("must name at least one object", field="scene.objects")
    if max_objects is not None and len(objects) > max_objects:
        raise LimitExceededError(
            f"must be at most {max_objects} objects", field="scene.objects", value=len(objects)
        )
    wait = not skip_invalid_objects
    environment = message.environment if environment is None else environment
    elements, packed = read_environment(environment, library.shape_packer, max_objects, wait)
    of_objects = fields.objects if fields else [f"scene.objects[{k}]" for k in range(len(objects))]
    ids = {own.id for own in objects}
    grouped = group_actions(actions, ids, fields.actions if fields else None)
    read: list[ReadObject] = []
    skipped, taken = {}, set()
    for own, field in zip(objects, of_objects, strict=True):
        place = BodyFields(field, grouped.get(own.id, ObjectActions(own.id)))
        try:
            _check_id(own, field, taken)
            read.append(_body(own, place, library, covariance_defaults, wait))
        except UncPhysicsError as error:
            if not skip_invalid_objects:
                raise
            skipped[own.id] = str(error)
    if not read:
        raise AllSkippedError(skipped)
    _check_element_ids(environment.elements, taken)
    read += map(_fixed, packed)
    bodies = tuple(own.body for own in read)
    mean = np.array([own.state for own in read])
    physics = with_chosen_stiffness(physics, bodies, mean)
    if len(message.pairs):
        physics = physics | {"pairs": read_pairs(message.pairs)}
    scene = _scene_of([own.fields for own in read], bodies, elements, physics)
    moving = scene.moving.copy()
    if len(message.joint_covariance.object_ids) or len(message.joint_covariance.data):
        P = _joint_covariance(message.joint_covariance, scene, mean, ids)
    else:
        P = np.array([read[b].covariance for b in moving]).reshape(-1, ERROR, ERROR)
    belief = Belief.trusted(mean, P, moving)
    models = tuple(own.model for own in read)
    notes = {own.body.name: own.notes for own in read if own.notes}
    return ReadScene(scene, belief, models, any(own.zeros_replaced for own in read), skipped, notes)


def write_joint_covariance(scene: Scene, belief: Belief, origins: np.ndarray) -> JointCovariance:
    """Return the covariance of all M moving bodies, (12 M, 12 M), mapped linearly to points of the bodies.

    Parameters
    ----------
    scene : Scene
    belief : Belief
    origins : (B, 3) array
        The points from those that the belief is about, body frames [m].
    """
    bodies = [(b, scene.bodies[b]) for b in scene.moving.tolist()]
    maps = [error_map(writable(belief.mean[b]), writable(origins[b])) for b, _ in bodies]
    C = congruent(_block_diagonal(maps), writable(belief.joint))
    return JointCovariance(object_ids=[body.name for _, body in bodies], data=packed(C))


def _block_diagonal(blocks: Sequence[np.ndarray]) -> np.ndarray:
    """Return a matrix (12 M, 12 M) of M blocks (12, 12)."""
    count = len(blocks)
    whole = np.zeros((count, ERROR, count, ERROR))
    for k, block in enumerate(blocks):
        whole[k, :, k, :] = block
    return whole.reshape(count * ERROR, count * ERROR)


def _check_id(message, field, taken):
    """Raise an error for an invalid id or one that is taken; add it to those taken."""
    if not isinstance(message.id, str) or not message.id:
        raise InvalidRequestError("must be a non-empty text", field=f"{field}.id", value=message.id)
    check_not_reserved(message.id, f"{field}.id")
    if message.id in taken:
        raise DuplicateIdError("is the id of two objects", field=f"{field}.id", value=message.id)
    taken.add(message.id)


def _check_element_ids(elements, taken):
    """Raise an error if an element has the id of an object."""
    for k, element in enumerate(elements):
        name = element_id(element, k)
        if name in taken:
            raise DuplicateIdError(
                "is the id of an object, too", field=f"scene.environment.elements[{k}].id", value=name
            )


def _read_object(place, arguments, *others):
    """Return an object with a body of these arguments; errors name fields of the message."""
    try:
        return ReadObject(place, _rigid_body(*arguments), *others)
    except UncPhysicsError as error:
        name = (error.field or "").partition(" of body ")[0]
        raise error.at(place.of(name)) from error


def _in_message(field, places):
    """Return the message's name of a field of a body, an element or the physics."""
    if found := re.fullmatch(r"bodies\[(\d+)\]\.(\w+)", field):
        return places[int(found[1])].of(found[2])
    elif found := re.fullmatch(r"environment\[(\d+)\]\.(\w+)", field):
        place, name = f"scene.environment.elements[{found[1]}]", found[2]
    elif field.startswith("pairs"):
        return f"scene.{field.removesuffix('.between')}"
    else:
        return f"physics.{field}" if field in PHYSICS_KEYS else field
    return f"{place}.material.{MATERIAL_FIELDS[name]}" if name in MATERIAL_FIELDS else f"{place}.{name}"


@functools.lru_cache(maxsize=1024)
def _rigid_body(*arguments):
    """Return a cached body for equal arguments, so that `_scene` recognizes a repeated scene."""
    *others, named = arguments
    return RigidBody(*others, **dict(named))


def _scene_of(places, bodies, elements, physics):
    """Return a scene; errors name fields of the message."""
    try:
        return _scene(bodies, elements, tuple((key, _hashable(physics[key])) for key in sorted(physics)))
    except UncPhysicsError as error:  # the node's own parameters are consistent
        field = _in_message(error.field or "scene", places)
        problem = error.problem
        if field.startswith("physics."):  # a missing value is the node's parameter
            problem = problem.removesuffix(" or absent")
        of_pair = field.startswith("scene.pairs")
        kind = type(error) if of_pair or not isinstance(error, InvalidRequestError) else InvalidOptionError
        raise kind(problem, field=field, value=error.value) from None


@functools.lru_cache(maxsize=32)
def _scene(bodies, elements, physics):
    """Return a cached scene for equal arguments; it holds the kernels' arrays."""
    return Scene(bodies, environment=elements, **dict(physics))


def _hashable(value):
    return value if value is None or isinstance(value, (str, bool, int, float)) else tuple(value)


def _fixed(element):
    """Return a packed element as a fixed object."""
    state, model = np.zeros(STATE), element.model
    state[POSITION], state[QUATERNION] = element.position, element.orientation
    state = moved(state, writable(model.origin), -1.0)
    body = element.name, model, 1.0, True, *_EXACT, False, None, None, element.material
    place = BodyFields(element.field, ObjectActions(element.name))
    return _read_object(place, body, model.name, state, np.zeros((ERROR, ERROR)))


def _check_shape(message, kinematic, field):
    """Raise an error unless an object has one shape, and a mass if that has none of its own.

    The mass of a primitive or mesh is checked here, because its packing takes seconds.
    """
    given = given_shapes(message)
    if len(given) != 1:
        raise InvalidRequestError("must have exactly one of model, primitive and mesh", field=field)
    if given == ["model"]:
        return
    if message.mass:
        valid_mass(message.mass, f"{field}.mass")
    elif not kinematic:
        raise InvalidMassError(
            f"must be given, since the {given[0]} of object '{message.id}' has none", field=f"{field}.mass"
        )


def _shape(message, library, wait):
    """Return the packing of an object's named model, primitive or mesh."""
    (name,) = given_shapes(message)
    if name == "model":
        scale = number(message.scale, "scale")
        return library.shape(message.model, message.spheres, scale)
    packer = library.shape_packer
    pack = packer.of_mesh if name == "mesh" else packer.of_primitive
    packing = pack(getattr(message, name), message.spheres, name, wait)
    return packing.scaled(number(message.scale, "scale") or 1.0)


def _body(message, place, library, covariance_defaults, wait):
    """Return an object; ``wait`` is as in `read_environment`."""
    field, actions = place
    fixed = _is_fixed(message, place)
    _check_shape(message, fixed or actions.trajectory is not None, field)
    try:
        model = _shape(message, library, wait)
    except UncPhysicsError as error:
        where = (
            f"{field}.{error.field}"
            if re.split(r"[.[]", error.field or "")[0] in ("model", "spheres", "scale", "primitive", "mesh")
            else f"{field}.model: {error.field}"
        )
        raise error.at(where) from error
    origin = writable(model.origin)
    path = read_path(actions, origin)
    kinematic = fixed or path is not None
    mass = known_mass(message.mass or None, model, kinematic, f"{field}.mass")
    stds = _EXACT if kinematic else _stds(message, field, mass)
    material = read_material(message.material, f"{field}.material")
    inertia = _inertia(message, f"{field}.inertia")
    drag = (("drag", message.drag),) if message.drag else ()
    named = material + drag + read_actions(actions)
    body, name = (message.id, model, mass, fixed, *stds), message.model or model.name
    if kinematic:
        at_start = moved(_state(message, field, fixed), origin, -1.0) if path is None else path.states[0]
        body = *body, bool(message.at_rest), inertia, path, named
        return _read_object(place, body, name, at_start, np.zeros((ERROR, ERROR)))
    pose, C, changes = _covariance(message, field, covariance_defaults)
    at_rest = bool(message.at_rest) or pose.is_supported
    state = moved(_state(message, field, fixed, at_rest), origin, -1.0)
    P = at_com(C, state, origin)
    if _YAW in pose.unmeasured:  # about the centre of mass: no lever makes a spread of positions of it
        vertical = rotation_matrix(state[QUATERNION])[2]
        P[ERR_ROTATION, ERR_ROTATION] += ANY_ANGLE_VARIANCE * np.outer(vertical, vertical)
    if not math.isfinite(state.sum() + P.sum()):
        raise NotFiniteError("is too large to be moved to the centre of mass", field=field)
    body = *body, at_rest, inertia, path, named
    return _read_object(place, body, name, state, P, pose.zeros_replaced, changes)


def _inertia(message, field):
    """Return the inertia per unit mass as nested tuples; None, for the model's, if empty or zero."""
    if not any(message.inertia):
        return None
    rows = array(message.inertia, (9,), field).reshape(3, 3).tolist()
    return tuple(map(tuple, rows))


def _is_fixed(message, place):
    """Return whether an object is fixed; raise an error for an unknown kind or a missing trajectory."""
    field, actions = place
    if message.kind not in _KINDS:
        raise InvalidRequestError(
            "must be DYNAMIC, FIXED or PRESCRIBED", field=f"{field}.kind", value=message.kind
        )
    if message.kind == ObjectState.PRESCRIBED and actions.trajectory is None:
        raise InvalidRequestError(
            "needs a TRAJECTORY of the object among the actions", field=f"{field}.kind", value="PRESCRIBED"
        )
    return message.kind == ObjectState.FIXED


def _covariance(message, field, covariance_defaults):
    """Return the pose's covariance, that of the state (12, 12) at the model's origin, and changes."""
    if len(message.covariance):
        whole = read_whole(message.covariance, ERROR, f"{field}.covariance")
        return ReadCovariance(whole.P), writable(whole.P), whole.changes
    pose = covariance_defaults.known_pose(message.pose.covariance, f"{field}.pose.covariance")
    twist = covariance_defaults.known_twist(message.twist.covariance, f"{field}.twist.covariance")
    C = np.zeros((ERROR, ERROR))
    C[_POSE], C[_TWIST] = pose.P, twist.P
    zeros = pose.zeros_replaced or twist.zeros_replaced
    return pose._replace(zeros_replaced=zeros), C, pose.changes + twist.changes


def _joint_covariance(message, scene, mean, known):
    """Return the covariance (12 M, 12 M) of all M moving bodies at their centres of mass.

    Parameters
    ----------
    message : JointCovariance
    scene : Scene
    mean : (B, 13) array
    known : set of str
        Ids of all objects of the request, including omitted ones.
    """
    place = "scene.joint_covariance"
    ids = list(message.object_ids)
    for k, name in enumerate(ids):
        if name not in known:
            raise InvalidCovarianceError(
                "is no object of the scene", field=f"{place}.object_ids[{k}]", value=name
            )
        if name in ids[:k]:
            raise DuplicateIdError("comes twice", field=f"{place}.object_ids[{k}]", value=name)
    size = ERROR * len(ids)
    C = read_whole(message.data, size, f"{place}.data").P if size else np.zeros((0, 0))
    moving = scene.moving.tolist()
    rows = []
    for b in moving:
        name = scene.bodies[b].name
        if name not in ids:
            raise InvalidCovarianceError(f"must name '{name}', which moves", field=f"{place}.object_ids")
        rows.append(ERROR * ids.index(name) + np.arange(ERROR))
    kinematic = {body.name for body in scene.bodies if not body.free}
    for k, name in enumerate(ids):
        if name in kinematic:
            raise InvalidCovarianceError(
                "is fixed or prescribed", field=f"{place}.object_ids[{k}]", value=name
            )
    rows = np.concatenate(rows) if rows else np.zeros(0, int)
    maps = [inverse_error_map(mean[b], writable(scene.bodies[b].model.origin)) for b in moving]
    P = congruent(_block_diagonal(maps), np.ascontiguousarray(C[np.ix_(rows, rows)]))
    if not np.isfinite(P).all():
        raise NotFiniteError("is too large to be moved to the centres of mass", field=f"{place}.data")
    return P


def _state(message, field, fixed, at_rest=False):
    """Return the state (13,) at the model's origin; a fixed object is at rest."""
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
    else:  # checked separately, to name the invalid field
        q = quaternion(q, f"{field}.pose.pose.orientation")
        position = point(position, f"{field}.pose.pose.position")
        v, w = array(v, (3,), f"{field}.twist.twist.linear"), array(w, (3,), f"{field}.twist.twist.angular")
    if at_rest or message.at_rest:
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
    """Return the standard deviations of the mass and of the centre of mass."""
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
