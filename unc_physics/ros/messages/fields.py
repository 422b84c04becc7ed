"""Fields common to many messages: vectors, poses, arrays, durations, optional entries and results."""

from __future__ import annotations

import math
from array import array as packed_array

import numpy as np
from builtin_interfaces.msg import Duration, Time
from geometry_msgs.msg import Point, Pose, Quaternion, Twist, Vector3

from unc_physics_msgs.msg import Result

from ...checks.errors import ErrorCode, InvalidRequestError, UncPhysicsError
from ...checks.shown import printable

_NANOSECONDS = 1_000_000_000


def xyz(v) -> tuple[float, float, float]:
    """Return the components of a Point or a Vector3."""
    return v.x, v.y, v.z


def xyzw(q) -> tuple[float, float, float, float]:
    """Return the components of a Quaternion."""
    return q.x, q.y, q.z, q.w


def vector_message(v) -> Vector3:
    """Return three numbers as a Vector3."""
    x, y, z = map(float, v)
    return Vector3(x=x, y=y, z=z)


def point_message(v) -> Point:
    """Return three numbers as a Point."""
    x, y, z = map(float, v)
    return Point(x=x, y=y, z=z)


def quaternion_message(q) -> Quaternion:
    """Return four numbers (x, y, z, w) as a Quaternion."""
    x, y, z, w = map(float, q)
    return Quaternion(x=x, y=y, z=z, w=w)


def pose_message(position, q) -> Pose:
    """Return a position and a quaternion (x, y, z, w) as a Pose."""
    return Pose(position=point_message(position), orientation=quaternion_message(q))


def twist_message(linear, angular) -> Twist:
    """Return a linear and an angular velocity as a Twist."""
    return Twist(linear=vector_message(linear), angular=vector_message(angular))


def packed(numbers) -> packed_array:
    """Return numbers for a field of variable length, which does not accept NumPy arrays."""
    return packed_array("d", np.ascontiguousarray(numbers, float).tobytes())


def writable(a) -> np.ndarray:
    """Return a writable copy; numba would compile each kernel again for read-only arrays."""
    return np.array(a)


def duration(seconds: float) -> Duration:
    """Return a time in seconds as a Duration, to the nanosecond."""
    whole = math.floor(seconds)
    carried, nanosec = divmod(round((seconds - whole) * _NANOSECONDS), _NANOSECONDS)
    return Duration(sec=whole + carried, nanosec=nanosec)


def nanoseconds(stamp: Time) -> int:
    """Return a stamp in nanoseconds."""
    return stamp.sec * _NANOSECONDS + stamp.nanosec


def stamp_of(time: int) -> Time:
    """Return a time in nanoseconds as a stamp."""
    sec, nanosec = divmod(time, _NANOSECONDS)
    return Time(sec=sec, nanosec=nanosec)


def later(stamp: Time, after: Duration) -> Time:
    """Return the time a Duration, not negative, after another time."""
    return stamp_of(nanoseconds(stamp) + after.sec * _NANOSECONDS + after.nanosec)


def sum_of(one: Duration, other: Duration) -> Duration:
    """Return the sum of two Durations, to the nanosecond."""
    carried, nanosec = divmod(one.nanosec + other.nanosec, _NANOSECONDS)
    return Duration(sec=one.sec + other.sec + carried, nanosec=nanosec)


def seconds(message: Duration) -> float:
    """Return a Duration in seconds."""
    return message.sec + message.nanosec / _NANOSECONDS


def read_duration(message: Duration, field: str, error: type[UncPhysicsError] = InvalidRequestError) -> float:
    """Return a time of a request in seconds.

    Raises
    ------
    UncPhysicsError
        Of the given type, for a negative time, or for nanoseconds of a second or more.
    """
    if message.nanosec >= _NANOSECONDS:
        raise error(f"must be below {_NANOSECONDS}", field=f"{field}.nanosec", value=message.nanosec)
    if message.sec < 0:
        raise error("must not be negative", field=field, value=seconds(message))
    return seconds(message)


def optional(message, name: str, field: str):
    """Return the value of an optional field of a message; None unless its flag ``has_<name>`` is set.

    Parameters
    ----------
    message : message
        With both fields.
    name : str
    field : str
        Name of the message in error messages.

    Raises
    ------
    InvalidRequestError
        If a value other than zero is given without its flag.
    """
    value = getattr(message, name)
    if getattr(message, f"has_{name}"):
        return value
    if isinstance(value, Vector3):
        given = any(xyz(value))
    else:
        given = value.sec or value.nanosec if isinstance(value, Duration) else value
    if given:
        raise InvalidRequestError(f"needs has_{name} beside it", field=f"{field}.{name}")
    return None


def given_shapes(message) -> list[str]:
    """Return the names of the shapes that an object or an element of the environment has."""
    found = []
    if getattr(message, "model", ""):
        found.append("model")
    if hasattr(message, "plane") and np.any(message.plane.coef):
        found.append("plane")
    if message.primitive.type or len(message.primitive.dimensions):
        found.append("primitive")
    if len(message.mesh.triangles) or len(message.mesh.vertices):
        found.append("mesh")
    return found


def write_error(result: Result, error: Exception) -> None:
    """Write an error as a request's result; classes other than `UncPhysicsError` are faults of the node."""
    if isinstance(error, UncPhysicsError):
        result.error_code, result.error_msg = int(error.code), str(error)
    else:
        result.error_code = int(ErrorCode.INTERNAL)
        result.error_msg = printable(f"a fault of the node: {type(error).__name__}: {error}")
