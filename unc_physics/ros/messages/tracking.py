"""Tracking: observations read by the node, tracked objects read by clients and the viewer."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import NamedTuple

import numpy as np
from geometry_msgs.msg import PoseWithCovariance

from unc_physics_msgs.msg import Action, ObjectState, TrackedObject, TrackedObjects
from unc_physics_msgs.msg import Scene as SceneMessage
from unc_physics_msgs.srv import Fork

from ...checks.errors import InvalidRequestError, NotSupportedError, UncPhysicsError
from ...checks.validation import point, quaternion
from ...prediction.prediction import Prediction
from ...prediction.regions import BoxRegion
from ...prediction.request_checks import marks_of
from ...propagators.names import REFERENCE
from ...propagators.registry import make_propagator
from ...scene.actions import PosePath
from ...scene.belief import Belief
from ...scene.body import RigidBody
from ...scene.body_belief import BodyBelief
from ...scene.origins import gaussian_at_origins
from ...scene.scene import Scene
from ...spatial.layout import ANGULAR_VELOCITY, ERROR, POSITION, QUATERNION, STATE, VELOCITY
from ...spatial.origin import at_com
from ...spatial.rotation import rotation_matrix
from ...tracking.hypotheses import UNKNOWN_SPIN, UNKNOWN_VELOCITY
from ...tracking.measurements import PoseMeasurement
from ...tracking.report import TrackStatus
from .fields import nanoseconds, packed, pose_message, seconds, stamp_of, writable, xyz, xyzw
from .physics import read_physics
from .prediction import read_answer, write_state
from .query import Query, RequestedOutputs
from .scene import CovarianceDefaults, known_covariance, read_scene

#: Standard deviation of a new object's pose, over that of its first observation, which corrects it.
_BEFORE_FIRST = 10.0
_STATUSES = {getattr(TrackedObject, f"STATUS_{status.name}"): status for status in TrackStatus}
_CODES = {status: code for code, status in _STATUSES.items()}


class ObservationRecord(NamedTuple):
    """Observations of a tracked object so far.

    Attributes
    ----------
    stamp : int
        Of the newest accepted one [ns]; 0 before the first one.
    distance : float
        Mahalanobis distance of the last one.
    rejections : int
    """

    stamp: int = 0
    distance: float = 0.0
    rejections: int = 0


@dataclass(frozen=True, eq=False)
class TrackedPrediction(Prediction):
    """Prediction from what a node's tracker knows.

    Attributes
    ----------
    stamp : float
        The tracker's time, on the clock of the observations [s]: time 0 of the prediction.
    """

    stamp: float = 0.0


@dataclass(frozen=True, eq=False)
class TrackedBody:
    """What a node's tracker knows of one object.

    Attributes
    ----------
    name : str
        Id of the object.
    model : str
    status : TrackStatus
    belief : BodyBelief
        At the time of the message, about the model's origin.
    stamp : float
        Time of the belief, on the clock of the observations [s].
    last_seen : float or None
        Time of the newest accepted observation [s].
    distance : float
        Mahalanobis distance of the last observation.
    rejections : int
        Number of rejected observations.
    """

    name: str
    model: str
    status: TrackStatus
    belief: BodyBelief
    stamp: float
    last_seen: float | None
    distance: float
    rejections: int


def read_measurement(observed: ObjectState, defaults: CovarianceDefaults) -> PoseMeasurement:
    """Return the measured pose of an observed object's model origin, in the world frame.

    Raises
    ------
    UncPhysicsError
        That names the field of the observation.
    """
    position = point(xyz(observed.pose.position), "pose.position")
    q = quaternion(xyzw(observed.pose.orientation), "pose.orientation")
    P, _ = known_covariance(
        observed.belief.pose_covariance, "pose.covariance", defaults.pose, defaults.zero_is_exact
    )
    to_body = np.eye(6)
    to_body[3:, 3:] = rotation_matrix(np.array(q)).T  # messages have rotations about fixed axes
    try:
        return PoseMeasurement([*position, *q], to_body @ P @ to_body.T, origin="model")
    except UncPhysicsError as error:
        raise error.at(f"pose.{error.field}") from None


def write_measurement(measurement: PoseMeasurement) -> PoseWithCovariance:
    """Return a measured pose of a model's origin as a message.

    Raises
    ------
    InvalidRequestError
        If it is the pose of a centre of mass.
    """
    if measurement.origin != "model":
        raise InvalidRequestError(
            "must be 'model', as messages have poses of the model's origin",
            field="measurement.origin",
            value=measurement.origin,
        )
    to_fixed = np.eye(6)
    to_fixed[3:, 3:] = rotation_matrix(writable(measurement.pose[3:]))
    return PoseWithCovariance(
        pose=pose_message(measurement.pose[:3], measurement.pose[3:]),
        covariance=(to_fixed @ measurement.covariance @ to_fixed.T).ravel(),
    )


def before_first(observed: ObjectState, defaults: CovarianceDefaults) -> ObjectState:
    """Return what is known of a new object before its first observation: nearly nothing."""
    given = observed.belief.pose_covariance
    P, _ = known_covariance(given, "pose.covariance", defaults.pose, defaults.zero_is_exact)
    state = ObjectState(id=observed.id, model=observed.model, pose=observed.pose, mass=observed.mass)
    state.belief.pose_covariance = _BEFORE_FIRST**2 * P.ravel()
    std = np.repeat([UNKNOWN_VELOCITY, UNKNOWN_SPIN], 3)
    state.belief.twist_covariance = np.diag(std**2).ravel()
    return state


def check_path(action: Action, field: str) -> None:
    """Raise an error for an action that a tracker does not take."""
    if action.type != Action.TRAJECTORY:
        raise NotSupportedError(
            "must be TRAJECTORY, as a tracker knows no attachments and wrenches",
            field=f"{field}.type",
            value=action.type,
        )
    if np.any(action.trajectory_std):
        raise NotSupportedError("must be zero in a tracker", field=f"{field}.trajectory_std")


def later_path(body: RigidBody, delay: float) -> RigidBody:
    """Return a prescribed body whose path begins later by a time [s]."""
    path = body.trajectory
    assert path is not None
    moved = PosePath(
        times=path.times + delay,
        positions=path.positions,
        orientations=path.orientations,
        linear_velocities=path.linear_velocities,
        angular_velocities=path.angular_velocities,
    )
    return replace(body, trajectory=moved)


def write_tracked(
    scene: Scene, belief: Belief, status: Callable[[str], TrackStatus], seen: dict[str, ObservationRecord]
) -> list[TrackedObject]:
    """Return the messages of a tracker's moving bodies, in the order of the scene; without their models."""
    origins = np.array([writable(body.model.origin) for body in scene.bodies])
    there = gaussian_at_origins(belief, origins)
    means, blocks, found = writable(there.mean), writable(there.blocks), []
    for row, b in enumerate(scene.moving.tolist()):
        name = scene.bodies[b].name
        message = TrackedObject(id=name, status=_CODES[status(name)])
        message.covariance = packed(write_state(message, means[b], blocks[row]))
        own = seen.get(name, ObservationRecord())
        message.last_seen = stamp_of(own.stamp)
        message.distance, message.rejections = own.distance, own.rejections
        found.append(message)
    return found


def read_tracked(message: TrackedObjects) -> dict[str, TrackedBody]:
    """Return the tracked objects of a message by their ids."""
    stamp = 1e-9 * nanoseconds(message.header.stamp)
    return {own.id: _tracked_body(own, stamp) for own in message.objects}


def read_fork(
    answer: Fork.Response,
    request: Fork.Request,
    times: Sequence[float],
    regions: tuple[BoxRegion, ...],
    shapes,
) -> TrackedPrediction:
    """Return the prediction of a node's answer.

    Parameters
    ----------
    answer : Fork.Response
        Without an error.
    request : Fork.Request
    times : sequence of float
        Requested times and horizon [s]; if empty, the time that the answer reached.
    regions : tuple of BoxRegion
    shapes
        Models, as a `ModelLibrary` has them.
    """
    message = answer.prediction
    physics = read_physics(message.physics, {})
    read = read_scene(answer.scene, shapes, physics, actions=answer.actions)
    by_id = {own.id: own for own in message.objects}
    message.objects = [by_id[body.name] for body in read.scene.bodies]
    query = Query(
        scene=read.scene,
        belief=read.belief,
        propagator=make_propagator(REFERENCE, samples=message.rollouts, seed=message.seed),
        marks=marks_of(read.scene, None, times or [seconds(message.time_reached)]),
        seed=message.seed,
        keep_samples=request.return_samples,
        regions=regions,
        outputs=RequestedOutputs.read(request),
    )
    prediction = read_answer(answer.result, message, query)
    known = {one.name: getattr(prediction, one.name) for one in fields(prediction)}
    return TrackedPrediction(**known, stamp=1e-9 * nanoseconds(message.header.stamp))


def _tracked_body(message, stamp):
    state = np.empty(STATE)
    state[POSITION] = xyz(message.pose.pose.position)
    state[QUATERNION] = xyzw(message.pose.pose.orientation)
    state[VELOCITY] = xyz(message.twist.twist.linear)
    state[ANGULAR_VELOCITY] = xyz(message.twist.twist.angular)
    C = np.array(message.covariance).reshape(ERROR, ERROR)
    belief = BodyBelief(
        origin="model",
        position=state[POSITION],
        orientation=state[QUATERNION],
        linear_velocity=state[VELOCITY],
        angular_velocity=state[ANGULAR_VELOCITY],
        covariance=at_com(C, state, np.zeros(3)),
    )
    seen = 1e-9 * nanoseconds(message.last_seen)
    return TrackedBody(
        message.id,
        message.model,
        _STATUSES[message.status],
        belief,
        stamp,
        seen or None,
        message.distance,
        message.rejections,
    )


def scene_of_tracked(message: TrackedObjects, mass_of: Callable[[str], float]) -> SceneMessage:
    """Return the scene of tracked objects with their beliefs, in the frame of the message.

    Parameters
    ----------
    message : TrackedObjects
    mass_of : callable
        Returns the mass of the objects of a model [kg]; 0 takes the model's own.
    """
    objects = []
    for own in message.objects:
        state = ObjectState(
            id=own.id, model=own.model, mass=mass_of(own.model), pose=own.pose.pose, twist=own.twist.twist
        )
        state.belief.covariance = own.covariance
        objects.append(state)
    return SceneMessage(header=message.header, objects=objects)
