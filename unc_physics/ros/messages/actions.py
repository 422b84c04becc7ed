"""Robot actions on an object: paths, attachment and wrenches."""

from __future__ import annotations

import functools
import math
from typing import Any

import numpy as np
from geometry_msgs.msg import Transform, Twist, Wrench
from trajectory_msgs.msg import MultiDOFJointTrajectory, MultiDOFJointTrajectoryPoint

from unc_physics_msgs.msg import AppliedWrench, ObjectState

from ...checks.errors import InvalidRequestError, LimitExceededError
from ...checks.validation import array, quaternion
from ...scene import actions
from ...scene.actions import MOST_POSES, PosePath
from ...scene.body import RigidBody
from ...scene.entries import at_field
from ...spatial.layout import ANGULAR_VELOCITY, POSITION, QUATERNION, STATE, VELOCITY
from ...spatial.origin import moved
from .fields import duration, optional, quaternion_message, read_duration, vector_message, writable, xyz, xyzw


def read_path(message: ObjectState, field: str, origin) -> PosePath | None:
    """Return the path of a prescribed object's centre of mass; None for other objects.

    Equal numbers give an identical object, so that caches recognize a repeated scene.

    Parameters
    ----------
    message : ObjectState
    field : str
        Name of the object in error messages.
    origin : (3,) array
        Origin of the model, in its body frame [m].

    Raises
    ------
    UncPhysicsError
    """
    place = f"{field}.trajectory"
    path = optional(message.trajectory, place)
    if message.kind != ObjectState.PRESCRIBED:
        if path is not None:
            raise InvalidRequestError("must be empty for an object that is not PRESCRIBED", field=place)
        return None
    if path is None:
        raise InvalidRequestError("must hold an entry, as the object is PRESCRIBED", field=place)
    if len(path.points) > MOST_POSES:
        raise LimitExceededError(
            f"must be at most {MOST_POSES}", field=f"{place}[0].points", value=len(path.points)
        )
    times, states = [], []
    for k, point in enumerate(path.points):
        entry = f"{place}[0].points[{k}]"
        if len(point.transforms) != 1 or len(point.velocities) > 1:
            raise InvalidRequestError("must have one transform, and at most one velocity", field=entry)
        (transform,) = point.transforms
        times.append(read_duration(point.time_from_start, f"{entry}.time_from_start"))
        position = array(xyz(transform.translation), (3,), f"{entry}.transforms[0].translation")
        q = quaternion(xyzw(transform.rotation), f"{entry}.transforms[0].rotation")
        v, w = (math.nan,) * 3, (math.nan,) * 3
        if point.velocities:
            twist, name = point.velocities[0], f"{entry}.velocities[0]"
            v = array(xyz(twist.linear), (3,), f"{name}.linear")
            w = array(xyz(twist.angular), (3,), f"{name}.angular")
        state = np.empty(STATE)
        state[POSITION], state[VELOCITY], state[QUATERNION], state[ANGULAR_VELOCITY] = position, v, q, w
        states.append(moved(state, origin, -1.0))
    return at_field(f"{place}[0]", _path, tuple(times), np.array(states).tobytes())


@functools.lru_cache(maxsize=256)
def _path(times, states):
    states = np.frombuffer(states).reshape(len(times), STATE)
    return PosePath(
        times=times,
        positions=states[:, POSITION],
        orientations=states[:, QUATERNION],
        linear_velocities=states[:, VELOCITY],
        angular_velocities=states[:, ANGULAR_VELOCITY],
    )


def read_actions(message: ObjectState, field: str) -> tuple[tuple[str, Any], ...]:
    """Return a robot's other actions on an object as pairs of a `RigidBody`'s keyword and its value.

    Raises
    ------
    UncPhysicsError
    """
    given: dict[str, Any] = {}
    if np.any(message.trajectory_std):
        std = array(message.trajectory_std, (6,), f"{field}.trajectory_std")
        given["trajectory_std"] = tuple(std.tolist())
    if message.attached_to:
        given["attached_to"] = message.attached_to
    for name in ("attached_at", "released_at"):
        if (value := optional(getattr(message, name), f"{field}.{name}")) is not None:
            given[name] = read_duration(value, f"{field}.{name}")
    if std := read_duration(message.released_at_std, f"{field}.released_at_std"):
        given["released_at_std"] = std
    if message.wrenches:
        given["wrenches"] = tuple(
            _wrench(
                *_numbers(wrench, f"{field}.wrenches[{k}]"),
                bool(wrench.body_axes),
                read_duration(wrench.start, f"{field}.wrenches[{k}].start"),
                read_duration(wrench.duration, f"{field}.wrenches[{k}].duration"),
            )
            for k, wrench in enumerate(message.wrenches)
        )
    return tuple(given.items())


def _numbers(message, field):
    force = array(xyz(message.wrench.force), (3,), f"{field}.wrench.force")
    torque = array(xyz(message.wrench.torque), (3,), f"{field}.wrench.torque")
    return tuple(force.tolist()), tuple(torque.tolist())


@functools.lru_cache(maxsize=256)
def _wrench(force, torque, body_axes, start, length):
    return actions.Wrench(
        force=force, torque=torque, body_axes=body_axes, start=start, duration=length or None
    )


def write_actions(body: RigidBody, message: ObjectState) -> None:
    """Write a robot's actions on a body into its message."""
    if body.trajectory is not None:
        message.kind = ObjectState.PRESCRIBED
        message.trajectory = [_trajectory(body)]
        message.trajectory_std = np.array(body.trajectory_std)
    if body.attached_to is not None:
        message.attached_to = body.attached_to
        message.attached_at = [duration(body.attached_at)]
        if body.released_at is not None:
            message.released_at = [duration(body.released_at)]
        message.released_at_std = duration(body.released_at_std)
    message.wrenches = [
        AppliedWrench(
            wrench=Wrench(force=vector_message(wrench.force), torque=vector_message(wrench.torque)),
            body_axes=wrench.body_axes,
            start=duration(wrench.start),
            duration=duration(wrench.duration or 0.0),
        )
        for wrench in body.wrenches
    ]


def _trajectory(body):
    """Return the path of the model's origin."""
    path, origin = body.trajectory, writable(body.model.origin)
    points = []
    for time, state in zip(path.times.tolist(), path.states, strict=True):
        x = moved(state, origin, 1.0)
        transform = Transform(
            translation=vector_message(x[POSITION]), rotation=quaternion_message(x[QUATERNION])
        )
        twist = Twist(linear=vector_message(x[VELOCITY]), angular=vector_message(x[ANGULAR_VELOCITY]))
        points.append(
            MultiDOFJointTrajectoryPoint(
                transforms=[transform], velocities=[twist], time_from_start=duration(time)
            )
        )
    return MultiDOFJointTrajectory(joint_names=[body.name], points=points)
