"""Robot actions on an object: paths, attachment and wrenches."""

from __future__ import annotations

import functools
import math
from collections.abc import Collection, Sequence
from typing import Any, NamedTuple

import numpy as np
from geometry_msgs.msg import Transform, Wrench
from trajectory_msgs.msg import MultiDOFJointTrajectory, MultiDOFJointTrajectoryPoint

from unc_physics_msgs.msg import Action

from ...checks.errors import InvalidRequestError, LimitExceededError
from ...checks.names import hint
from ...checks.validation import array, quaternion
from ...scene import actions
from ...scene.actions import MOST_POSES, PosePath
from ...scene.entries import at_field
from ...spatial.layout import ANGULAR_VELOCITY, POSITION, QUATERNION, STATE, VELOCITY
from ...spatial.origin import moved
from .fields import (
    duration,
    quaternion_message,
    read_duration,
    seconds,
    sum_of,
    twist_message,
    vector_message,
    xyz,
    xyzw,
)

#: Names of the types of actions.
_KINDS = {Action.TRAJECTORY: "trajectory", Action.ATTACHMENT: "attachment", Action.WRENCH: "wrench"}
#: Types of actions that have a field.
_OF_KINDS = {
    "trajectory": ("trajectory",),
    "trajectory_std": ("trajectory",),
    "attached_to": ("attachment",),
    "start": ("attachment", "wrench"),
    "duration": ("attachment", "wrench"),
    "release_std": ("attachment",),
    "wrench": ("wrench",),
    "body_axes": ("wrench",),
}
#: Fields of an attachment by attributes of a `RigidBody`.
_OF_ATTACHMENT = {
    "attached_to": "attached_to",
    "attached_at": "start",
    "released_at": "duration",
    "released_at_std": "release_std",
}
_UNSET = Action()


class ObjectActions(NamedTuple):
    """Actions of a request on one object.

    Attributes
    ----------
    id : str
        Id of the object.
    trajectory, attachment : tuple of (str, Action), optional
        Name of the action in error messages, and the action.
    wrenches : tuple of (str, Action)
    """

    id: str
    trajectory: tuple[str, Action] | None = None
    attachment: tuple[str, Action] | None = None
    wrenches: tuple[tuple[str, Action], ...] = ()

    def field(self, attribute: str) -> str | None:
        """Return the message's name of an attribute of a `RigidBody`; None if no action sets it."""
        if attribute in ("trajectory", "trajectory_std") and self.trajectory:
            return f"{self.trajectory[0]}.{attribute}"
        if attribute in _OF_ATTACHMENT and self.attachment:
            return f"{self.attachment[0]}.{_OF_ATTACHMENT[attribute]}"
        if attribute == "wrenches" and self.wrenches:
            return f"{self.wrenches[0][0]}.wrench"
        return None


def group_actions(
    messages: Sequence[Action], ids: Collection[str], fields: Sequence[str] | None = None
) -> dict[str, ObjectActions]:
    """Return the actions of a request by the id of their object.

    Parameters
    ----------
    messages : sequence of Action
    ids : collection of str
        Ids of the objects.
    fields : sequence of str, optional
        Name of each action in error messages; by default ``actions[0]`` and so on.

    Raises
    ------
    InvalidRequestError
        For an unknown object or type, fields of another type, or two actions of which an object can have one.
    """
    found: dict[str, ObjectActions] = {}
    fields = [f"actions[{k}]" for k in range(len(messages))] if fields is None else fields
    for message, field in zip(messages, fields, strict=True):
        if message.object not in ids:
            problem = f"is no object of the scene{hint(message.object, ids)}"
            raise InvalidRequestError(problem, field=f"{field}.object", value=message.object)
        kind = _KINDS.get(message.type)
        if kind is None:
            raise InvalidRequestError(
                "must be TRAJECTORY, ATTACHMENT or WRENCH", field=f"{field}.type", value=message.type
            )
        _check_type(message, kind, field)
        own = found.get(message.object, ObjectActions(message.object))
        if kind == "wrench":
            own = own._replace(wrenches=(*own.wrenches, (field, message)))
        elif (other := getattr(own, kind)) is not None:
            raise InvalidRequestError(
                f"is the second {kind} of '{message.object}', beside {other[0]}", field=field
            )
        else:
            own = own._replace(**{kind: (field, message)})
        found[message.object] = own
    return found


def _check_type(message, kind, field):
    """Raise an error if fields are set that belong to an action of another type."""
    for name, kinds in _OF_KINDS.items():
        if kind in kinds:
            continue
        value = getattr(message, name)
        if np.any(value) if name == "trajectory_std" else value != getattr(_UNSET, name):
            raise InvalidRequestError(
                f"must not be set in an action of type {kind.upper()}", field=f"{field}.{name}"
            )


def read_path(actions: ObjectActions, origin) -> PosePath | None:
    """Return the path of a prescribed object's centre of mass; None for other objects.

    Equal numbers give an identical object, so that caches recognize a repeated scene.

    Parameters
    ----------
    actions : ObjectActions
    origin : (3,) array
        Origin of the model, in its body frame [m].

    Raises
    ------
    UncPhysicsError
    """
    if actions.trajectory is None:
        return None
    field, action = actions.trajectory
    path, place = action.trajectory, f"{field}.trajectory"
    if len(path.points) > MOST_POSES:
        raise LimitExceededError(
            f"must be at most {MOST_POSES}", field=f"{place}.points", value=len(path.points)
        )
    times, states = [], []
    for k, point in enumerate(path.points):
        entry = f"{place}.points[{k}]"
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
    return at_field(place, _path, tuple(times), np.array(states).tobytes())


@functools.lru_cache(maxsize=256)
def _path(times, states):
    return PosePath.of_states(np.array(times), np.frombuffer(states).reshape(len(times), STATE))


def read_actions(actions: ObjectActions) -> tuple[tuple[str, Any], ...]:
    """Return actions on an object, but for its path, as pairs of a `RigidBody`'s keyword and its value.

    Raises
    ------
    UncPhysicsError
    """
    given: dict[str, Any] = {}
    if actions.trajectory is not None:
        field, action = actions.trajectory
        if np.any(action.trajectory_std):
            std = array(action.trajectory_std, (6,), f"{field}.trajectory_std")
            given["trajectory_std"] = tuple(std.tolist())
    if actions.attachment is not None:
        field, action = actions.attachment
        if not action.attached_to:
            raise InvalidRequestError("must be the id of an object", field=f"{field}.attached_to", value="")
        given["attached_to"] = action.attached_to
        given["attached_at"], held = _time_of(action, field)
        if held:
            given["released_at"] = seconds(sum_of(action.start, action.duration))
        if std := read_duration(action.release_std, f"{field}.release_std"):
            if not held:
                raise InvalidRequestError(
                    "needs a duration beside it", field=f"{field}.release_std", value=std
                )
            given["released_at_std"] = std
    if actions.wrenches:
        given["wrenches"] = tuple(
            _wrench(
                *_numbers(action.wrench, f"{field}.wrench"), bool(action.body_axes), *_time_of(action, field)
            )
            for field, action in actions.wrenches
        )
    return tuple(given.items())


def _time_of(action, field):
    """Return start and duration of an action [s]."""
    return tuple(read_duration(getattr(action, name), f"{field}.{name}") for name in ("start", "duration"))


def _numbers(wrench: Wrench, field):
    force = array(xyz(wrench.force), (3,), f"{field}.force")
    torque = array(xyz(wrench.torque), (3,), f"{field}.torque")
    return tuple(force.tolist()), tuple(torque.tolist())


@functools.lru_cache(maxsize=256)
def _wrench(force, torque, body_axes, start, length):
    return actions.Wrench(
        force=force, torque=torque, body_axes=body_axes, start=start, duration=length or None
    )


def write_path(name: str, path: PosePath, origin: np.ndarray) -> Action:
    """Return the message of an object's path.

    Parameters
    ----------
    name : str
        Id of the object.
    path : PosePath
        Path of its centre of mass.
    origin : (3,) array
        Origin of its model, in the body frame [m].
    """
    points = []
    for time, state in zip(path.times.tolist(), path.states, strict=True):
        x = moved(state, origin, 1.0)
        transform = Transform(
            translation=vector_message(x[POSITION]), rotation=quaternion_message(x[QUATERNION])
        )
        points.append(
            MultiDOFJointTrajectoryPoint(
                transforms=[transform],
                velocities=[twist_message(x[VELOCITY], x[ANGULAR_VELOCITY])],
                time_from_start=duration(time),
            )
        )
    trajectory = MultiDOFJointTrajectory(joint_names=[name], points=points)
    return Action(type=Action.TRAJECTORY, object=name, trajectory=trajectory)
