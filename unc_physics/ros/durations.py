"""Times in messages are Durations, in the core seconds."""

from __future__ import annotations

import math

from builtin_interfaces.msg import Duration

from ..checks.errors import InvalidRequestError, UncPhysicsError

_NANOSECONDS = 1_000_000_000


def duration(seconds: float) -> Duration:
    """A time in seconds as a message, to the nanosecond."""
    whole = math.floor(seconds)
    nanoseconds = round((seconds - whole) * _NANOSECONDS)
    carried, nanoseconds = divmod(nanoseconds, _NANOSECONDS)
    return Duration(sec=whole + carried, nanosec=nanoseconds)


def seconds(message: Duration) -> float:
    """A message's time in seconds."""
    return message.sec + message.nanosec / _NANOSECONDS


def read_duration(message: Duration, field: str, error: type[UncPhysicsError] = InvalidRequestError) -> float:
    """A time of a request in seconds.

    Raises
    ------
    UncPhysicsError
        Of the given type, for a time below 0, and for a whole second or more among the nanoseconds.
    """
    if message.nanosec >= _NANOSECONDS:
        raise error(f"must be below {_NANOSECONDS}", field=f"{field}.nanosec", value=message.nanosec)
    if message.sec < 0:
        raise error("must not be negative", field=field, value=seconds(message))
    return seconds(message)
