"""Between messages and the core: the only place that knows both.

A message gives the pose of a model's own origin and rotations about the fixed axes of the frame; a `Belief`
gives the pose of the centre of mass and rotations on the body side. `physics.origin` has the algebra.
"""

from __future__ import annotations

import functools
import math
import re
from array import array as packed_array
from typing import NamedTuple

import numpy as np
import yaml
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import Point, Pose, Quaternion

from unc_physics_msgs.msg import JointCovariance, PredictedObject, PredictedState

from ..checks.errors import (
    DivergedError,
    DuplicateIdError,
    InvalidCovarianceError,
    InvalidOptionError,
    InvalidRequestError,
    LimitExceededError,
    NoObjectsError,
    NotFiniteError,
    UncPhysicsError,
)
from ..checks.validation import array, covariance, non_negative, number, quaternion
from ..physics.layout import ANGULAR_VELOCITY, ERROR, POSITION, QUATERNION, STATE, VELOCITY
from ..physics.origin import at_origin, congruent, covariance_at_com, error_map, moved
from ..physics.rotation import rotation_matrix
from ..scene.belief import Belief
from ..scene.body import RigidBody, known_mass
from ..scene.physics_keys import PHYSICS_KEYS
from ..scene.presets import with_changes
from ..scene.scene import Scene
from ..scene.scene_file import PRESET, at_field, physics_value, preset, with_chosen_stiffness
from .surroundings import read_environment

#: First entry of a covariance that is not known, as in sensor_msgs/Imu.
UNKNOWN = -1.0

_AT_REST = 0.0, 0.0, 0.0
_EXACT = 0.0, (0.0, 0.0, 0.0)  # standard deviations of mass and centre of mass
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
    """

    scene: Scene
    belief: Belief
    models: tuple[str, ...]
    zeros_replaced: bool


# --- messages to the core
# -------------------------------------------------------------------------------------------


def read_scene(
    objects,
    environment,
    library,
    physics,
    doubts=EXACT,
    max_objects=None,
    max_spheres=None,
    max_elements=None,
    fields=None,
) -> ReadScene:
    """The scene and the belief about it that messages describe.

    Parameters
    ----------
    objects : sequence of ObjectState
    environment : Environment
    library : ModelLibrary
    physics : dict
        Arguments of `Scene` besides bodies and environment; the stiffness may be `stiffness.AUTO`.
    doubts : Doubts
    max_objects, max_spheres, max_elements : int, optional
    fields : sequence of str, optional
        What errors call each object; by default ``objects[0]`` and so on.

    Raises
    ------
    UncPhysicsError
        One of its kinds, naming the field as in the message and the value.
    """
    if len(objects) == 0:
        raise NoObjectsError("must name at least one object", field="objects")
    if max_objects is not None and len(objects) > max_objects:
        raise LimitExceededError(
            f"must be at most {max_objects} objects", field="objects", value=len(objects)
        )
    elements = read_environment(environment, max_elements)
    fields = [f"objects[{k}]" for k in range(len(objects))] if fields is None else fields
    names = set()
    for message, field in zip(objects, fields, strict=True):
        if not isinstance(message.id, str) or not message.id:
            raise InvalidRequestError("must be a non-empty text", field=f"{field}.id", value=message.id)
        if message.id in names:
            raise DuplicateIdError("is the id of two objects", field=f"{field}.id", value=message.id)
        names.add(message.id)
    read = [
        _body(message, field, library, doubts, max_spheres)
        for message, field in zip(objects, fields, strict=True)
    ]
    taken = {element.name: k for k, element in enumerate(elements)}
    for name in names & taken.keys():
        raise DuplicateIdError(
            "is the id of an object, too", field=f"environment.ids[{taken[name]}]", value=name
        )
    made = zip(fields, read, strict=True)
    bodies = tuple(at_field(field, _rigid_body, *body) for field, (body, *_) in made)
    mean = np.array([state for _, state, _, _ in read])
    physics = with_chosen_stiffness(physics, bodies, mean)
    constants = tuple((key, _hashable(physics[key])) for key in sorted(physics))
    try:
        scene = _scene(bodies, elements, constants)
    except (InvalidRequestError, InvalidOptionError) as error:  # the node's own parameters go together
        field = _in_message(error.field, fields)
        raise InvalidOptionError(error.problem, field=field, value=error.value) from None
    blocks = np.array([P for body, (_, _, P, _) in zip(bodies, read, strict=True) if not body.fixed]).reshape(
        -1, ERROR, ERROR
    )
    belief = Belief.trusted(mean, blocks, scene.moving.copy())
    models = tuple(message.model for message in objects)
    return ReadScene(scene, belief, models, any(zeros for *_, zeros in read))


def _in_message(field, fields):
    """What a message calls a field of the scene made from it: one of an object's, or else an option."""
    found = re.fullmatch(r"bodies\[(\d+)\]\.(\w+)", field)
    return f"{fields[int(found[1])]}.{found[2]}" if found else f"scene_options '{field}'"


@functools.lru_cache(maxsize=1024)
def _rigid_body(*arguments):
    """The same body for the same arguments, so that a scene that comes again is known by its bodies."""
    return RigidBody(*arguments)


@functools.lru_cache(maxsize=32)
def _scene(bodies, elements, physics):
    """A scene that comes again keeps what the kernels need."""
    return Scene(bodies, environment=elements, **dict(physics))


def _hashable(value):
    return value if value is None or isinstance(value, (str, bool, int, float)) else tuple(value)


def read_options(pairs, field) -> dict[str, str]:
    """KeyValue messages as texts by key; raises `InvalidOptionError` for a key that comes twice."""
    options = {}
    for k, pair in enumerate(pairs):
        if pair.key in options:
            raise InvalidOptionError("is given twice", field=f"{field}[{k}].key", value=pair.key)
        options[pair.key] = pair.value
    return options


def read_physics(pairs, physics: dict) -> dict:
    """Arguments of `Scene`: ``physics``, changed by ``scene_options``: keys of a scene file, values in YAML.

    The key `PRESET` names a preset in place of the node's own; null takes a law away.

    Raises
    ------
    InvalidOptionError, NotFiniteError, InvalidHorizonError
    """
    given = {}
    for key, text in read_options(pairs, "scene_options").items():
        field = f"scene_options '{key}'"
        if key not in (known := (PRESET, *PHYSICS_KEYS)):
            raise InvalidOptionError(f"must be one of {', '.join(known)}", field="scene_options", value=key)
        try:
            value = _parsed(text)
        except (yaml.YAMLError, ValueError, RecursionError):
            raise InvalidOptionError("is not valid YAML", field=field, value=text) from None
        try:
            if key == PRESET:
                physics = preset(value)
            else:
                given[key] = physics_value(key, value)
        except InvalidRequestError as error:
            raise InvalidOptionError(error.problem, field=field, value=text) from None
        except UncPhysicsError as error:
            raise type(error)(error.problem, field=field, value=text) from None
    return with_changes(physics, given)


@functools.lru_cache(maxsize=64)
def _parsed(text):
    """The value that a YAML text stands for; clients send the same texts again and again."""
    return yaml.safe_load(text)


def _body(message, field, library, doubts, max_spheres):
    """What makes a body, its state (13,), its covariance (12, 12), and whether zeros were read as unknown."""
    try:
        model = library.shape(message.model, message.spheres, number(message.scale, "scale"), max_spheres)
    except UncPhysicsError as error:
        place = (
            f"{field}.{error.field}"
            if error.field in ("model", "spheres", "scale")
            else f"{field}.model: {error.field}"
        )
        raise type(error)(error.problem, field=place, value=error.value) from error
    mass = None if message.fixed or message.use_model_mass else message.mass
    mass = known_mass(mass, model, message.fixed, f"{field}.mass")
    body = message.id, model, mass, bool(message.fixed), *_stds(message, field, mass), bool(message.at_rest)
    at_origin, origin = _state(message, field), _writable(model.origin)
    if message.fixed:
        return body, moved(at_origin, origin, -1.0), np.zeros((ERROR, ERROR)), False
    P_pose, zero_pose = _known_covariance(
        message.pose.covariance, f"{field}.pose.covariance", doubts.pose, doubts.zero_is_exact
    )
    P_twist, zero_twist = _known_covariance(
        message.twist.covariance, f"{field}.twist.covariance", doubts.twist, doubts.zero_is_exact
    )
    state = moved(at_origin, origin, -1.0)
    P = covariance_at_com(P_pose, P_twist, state, origin)
    if not math.isfinite(state.sum() + P.sum()):
        raise NotFiniteError("is too large to be moved to the centre of mass", field=field)
    return body, state, P, zero_pose or zero_twist


def _state(message, field):
    """State (13,) at the model's origin; a fixed object is at rest."""
    pose, twist = message.pose.pose, message.twist.twist
    position, q = _xyz(pose.position), _xyzw(pose.orientation)
    v, w = (_AT_REST, _AT_REST) if message.fixed else (_xyz(twist.linear), _xyz(twist.angular))
    try:
        length, fine = math.hypot(*q), math.isfinite(sum((*position, *v, *w)))
    except TypeError:
        length, fine = 0.0, False
    if fine and abs(length - 1.0) < _ROUND_OFF:
        q = [component / length for component in q]
    else:  # one by one, to say what is wrong
        q = quaternion(q, f"{field}.pose.pose.orientation")
        position = array(position, (3,), f"{field}.pose.pose.position")
        v, w = array(v, (3,), f"{field}.twist.twist.linear"), array(w, (3,), f"{field}.twist.twist.angular")
    state = np.empty(STATE)
    state[POSITION], state[VELOCITY], state[QUATERNION], state[ANGULAR_VELOCITY] = position, v, q, w
    return state


def _writable(a):
    """A copy: read-only arrays would compile every kernel once more."""
    return np.array(a)


def _stds(message, field, mass):
    """Standard deviations of the mass and of the centre of mass; a fixed object's are ignored."""
    if message.fixed:
        return _EXACT
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
    """The covariance (6, 6) of 36 numbers, None if it is unknown; clients send the same ones
    again and again.
    """
    P = array(np.frombuffer(entries).reshape(6, 6), (6, 6), field, InvalidCovarianceError)
    return None if P[0, 0] == UNKNOWN else _writable(covariance(P, 6, field))


def _xyz(v):
    return v.x, v.y, v.z


def _xyzw(q):
    return q.x, q.y, q.z, q.w


# --- the core to messages
# -------------------------------------------------------------------------------------------


class Wanted(NamedTuple):
    """What an answer holds besides means and marginal covariances.

    Attributes
    ----------
    covariance, joint_covariance : bool
        Each object's whole covariance; that of all moving objects together.
    probabilities : bool
        Those of contacts and of rest.
    """

    covariance: bool = False
    joint_covariance: bool = False
    probabilities: bool = False


MARGINALS_ONLY = Wanted()


def write_prediction(scene, models, times, beliefs, samples=None, wanted=MARGINALS_ONLY):
    """A prediction as messages.

    Parameters
    ----------
    scene : Scene
    models : sequence of str
        Names of the bodies' models.
    times : sequence of float
        Times of the beliefs from the start [s].
    beliefs : sequence of Belief
    samples : sequence of (N, B, 13) arrays, optional
        States drawn from each belief.
    wanted : Wanted

    Returns
    -------
    objects : list of PredictedObject
        In the scene's order.
    joint_covariances : list of JointCovariance
        One for each time, if wanted.

    Raises
    ------
    DivergedError
        If a number is not finite.
    """
    objects = [
        PredictedObject(
            id=body.name,
            model=model,
            fixed=body.fixed,
            status=PredictedObject.STATUS_NOT_ASSESSED,
            status_msg="no check was made",
        )
        for body, model in zip(scene.bodies, models, strict=True)
    ]
    joints, states = [], [[] for _ in objects]
    origins = [_writable(body.model.origin) for body in scene.bodies]
    known = {b: row for row, b in enumerate(scene.moving.tolist())}
    certain = np.zeros((ERROR, ERROR))
    for k, (time, belief) in enumerate(zip(times, beliefs, strict=True)):
        means, blocks, since = _writable(belief.mean), _writable(belief.blocks), duration(time)
        for b in range(len(objects)):
            state = PredictedState(time_from_start=since, status=PredictedObject.STATUS_NOT_ASSESSED)
            P = _write_state(state, means[b], blocks[known[b]] if b in known else certain, origins[b])
            if wanted.covariance:
                state.covariance = packed_array("d", P.tobytes())
            if samples is not None:
                state.pose_samples = origin_poses(samples[k][:, b], origins[b])
            states[b].append(state)
        if wanted.joint_covariance:
            joints.append(
                _joint_covariance(
                    scene, time, belief, [error_map(*pair) for pair in zip(means, origins, strict=True)]
                )
            )
    for answer, own in zip(objects, states, strict=True):
        answer.states = own
    return objects, joints


def write_start(objects, scene, belief) -> None:
    """Write into each PredictedObject where the prediction really began: ``belief`` is that at time 0."""
    for k, (message, body) in enumerate(zip(objects, scene.bodies, strict=True)):
        state, P = PredictedState(), _writable(belief.marginal(k))
        _write_state(state, _writable(belief.mean[k]), P, _writable(body.model.origin))
        message.start = state.pose


def _joint_covariance(scene, time, belief, maps):
    A = np.zeros((len(scene.moving), ERROR, len(scene.moving), ERROR))
    for k, b in enumerate(scene.moving):
        A[k, :, k, :] = maps[b]
    A = A.reshape(belief.joint.shape)
    data = packed_array("d", congruent(A, _writable(belief.joint)).tobytes())
    ids = [scene.bodies[b].name for b in scene.moving]
    return JointCovariance(time_from_start=duration(time), object_ids=ids, data=data)


def _write_state(message, mean, P, origin):
    """Write a body's mean (13,) and covariance (12, 12); the covariance (12, 12) at the model's origin."""
    state, P, message.pose.covariance, message.twist.covariance, finite = at_origin(mean, P, origin)
    if not finite:
        raise DivergedError("left the range of numbers", field="prediction")
    numbers, pose, twist = state.tolist(), message.pose.pose, message.twist.twist
    for part, place in (
        (pose.position, POSITION),
        (twist.linear, VELOCITY),
        (twist.angular, ANGULAR_VELOCITY),
    ):
        part.x, part.y, part.z = numbers[place]
    q = pose.orientation
    q.x, q.y, q.z, q.w = numbers[QUATERNION]
    return P


def origin_poses(states, origin) -> list[Pose]:
    """Poses of a model's origin for the states (N, 13) of its body."""
    if not np.isfinite(states).all():
        raise DivergedError("left the range of numbers", field="pose_samples")
    poses = []
    for state in states:
        x, y, z = (state[POSITION] + rotation_matrix(state[QUATERNION]) @ origin).tolist()
        qx, qy, qz, qw = state[QUATERNION].tolist()
        poses.append(Pose(position=Point(x=x, y=y, z=z), orientation=Quaternion(x=qx, y=qy, z=qz, w=qw)))
    return poses


def duration(seconds: float) -> Duration:
    """A time from the start, to the nanosecond."""
    whole = math.floor(seconds)
    nanoseconds = round((seconds - whole) * 1e9)
    carried, nanoseconds = divmod(nanoseconds, 1_000_000_000)
    return Duration(sec=whole + carried, nanosec=nanoseconds)


def seconds(time: Duration) -> float:
    """A duration in seconds."""
    return time.sec + 1e-9 * time.nanosec
