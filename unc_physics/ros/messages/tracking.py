"""Tracking: observations, and tracked objects."""

from __future__ import annotations

import copy
from typing import NamedTuple

import numpy as np
from geometry_msgs.msg import PoseWithCovariance, TwistWithCovariance

from unc_physics_msgs.msg import Action, ObjectState, TrackedObject

from ...checks.errors import NotSupportedError, UncPhysicsError
from ...checks.validation import point, quaternion
from ...scene.actions import PosePath
from ...scene.belief import Belief
from ...scene.body import RigidBody
from ...scene.origins import gaussian_at_origins
from ...scene.scene import Scene
from ...tracking.hypotheses import UNKNOWN_SPIN, UNKNOWN_VELOCITY
from ...tracking.measurements import PoseMeasurement
from ...tracking.report import TrackStatus
from .actions import write_path
from .covariances import MOST_ANGLE_VARIANCE, MOST_POSITION_VARIANCE, CovarianceDefaults
from .fields import packed, stamp_of, writable, xyz, xyzw
from .prediction import write_state

#: Standard deviation of a new object's pose, over that of its first observation, which corrects it.
_BEFORE_FIRST = 10.0
_CODES = {status: getattr(TrackedObject, f"STATUS_{status.name}") for status in TrackStatus}


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


def read_measurement(observed: ObjectState, defaults: CovarianceDefaults) -> PoseMeasurement:
    """Return the measured pose of an observed object's model origin, in the world frame.

    Raises
    ------
    UncPhysicsError
        That names the field of the observation.
    """
    position = point(xyz(observed.pose.pose.position), "pose.position")
    q = quaternion(xyzw(observed.pose.pose.orientation), "pose.orientation")
    P = defaults.known_pose(observed.pose.covariance, "pose.covariance").with_unmeasured()
    try:
        return PoseMeasurement([*position, *q], P, origin="model", axes="fixed")
    except UncPhysicsError as error:
        raise error.at(f"pose.{error.field}") from None


def before_first(observed: ObjectState, defaults: CovarianceDefaults) -> ObjectState:
    """Return what is known of a new object before its first observation: nearly nothing."""
    read = defaults.known_pose(observed.pose.covariance, "pose.covariance")
    # what is measured stays below the variances that mean that it is not
    most = np.repeat([MOST_POSITION_VARIANCE, MOST_ANGLE_VARIANCE], 3)
    least = np.maximum(read.P.diagonal(), np.finfo(float).tiny)
    factor = np.minimum(_BEFORE_FIRST, np.sqrt(most / least))
    P = read.P * np.outer(factor, factor)
    P[read.unmeasured, read.unmeasured] = 2.0 * most[list(read.unmeasured)]
    state = ObjectState(id=observed.id, model=observed.model, mass=observed.mass)
    state.pose = PoseWithCovariance(pose=observed.pose.pose, covariance=P.ravel())
    std = np.repeat([UNKNOWN_VELOCITY, UNKNOWN_SPIN], 3)
    state.twist.covariance = np.diag(std**2).ravel()
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


def write_tracked(
    scene: Scene,
    belief: Belief,
    statuses: dict[str, TrackStatus],
    models: dict[str, str],
    seen: dict[str, ObservationRecord],
) -> list[TrackedObject]:
    """Return the messages of a tracker's moving bodies, in the order of the scene."""
    origins = np.array([writable(body.model.origin) for body in scene.bodies])
    there = gaussian_at_origins(belief, origins)
    means, blocks, found = writable(there.mean), writable(there.blocks), []
    for row, b in enumerate(scene.moving.tolist()):
        name = scene.bodies[b].name
        message = TrackedObject(id=name, model=models[name], status=_CODES[statuses[name]])
        message.covariance = packed(write_state(message, means[b], blocks[row]))
        own = seen.get(name, ObservationRecord())
        message.last_seen = stamp_of(own.stamp)
        message.distance, message.rejections = own.distance, own.rejections
        found.append(message)
    return found


def write_present(
    given: ObjectState, body: RigidBody, mean: np.ndarray, P: np.ndarray, time: float
) -> tuple[ObjectState, list[Action]]:
    """Return an object of a tracker in its present state, and the rest of its path if it is prescribed.

    Parameters
    ----------
    given : ObjectState
        The object as it was given.
    body : RigidBody
    mean : (13,) array
    P : (12, 12) array
    time : float
        The tracker's time [s].
    """
    message, origin = copy.copy(given), writable(body.model.origin)
    message.pose, message.twist = PoseWithCovariance(), TwistWithCovariance()
    message.covariance = packed(write_state(message, mean, P, origin))
    if body.trajectory is None:
        return message, []
    path = _rest_of_path(body.trajectory, mean, time)
    message.kind = ObjectState.FIXED if path is None else ObjectState.PRESCRIBED
    return message, [] if path is None else [write_path(body.name, path, origin)]


def _rest_of_path(path, state, time):
    """Return a path from a time on, with times from then; None if it has ended.

    ``state`` (13,) is the state on the path at that time.
    """
    if (later := path.times > time).all():
        return PosePath.of_states(path.times - time, path.states)
    if not later.any():
        return None
    return PosePath.of_states(
        np.array([0.0, *(path.times[later] - time)]), np.array([state, *path.states[later]])
    )
