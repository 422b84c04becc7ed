"""Clients of goals: the process that sent a goal, and whether it still runs.

The middleware notices only after the lease of the client's participant that a process was killed, with Fast
DDS after 20 s. Fast DDS writes the process's number into the ids of its endpoints. So a process on the same
machine is watched itself.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import select
import sys

from rclpy.utilities import get_rmw_implementation_identifier

_GUID, _GUID_PREFIX = 16, 12  # bytes of the id of an endpoint, and of its participant
_MACHINE, _PROCESS = slice(0, 4), slice(4, 6)  # of a participant's id of Fast DDS
_MIDDLEWARE = "rmw_fastrtps"
_PIDS = 1 << 16  # numbers of processes that an id distinguishes


def participant_of(header) -> bytes:
    """Return the beginning of the ids of a client's endpoints, from its request's header; empty if unknown.

    rclpy does not show the writer's id of the header. It is read from the C structure behind the object, a
    pointer after the object's head; the sequence number after the id tells whether this holds.
    """
    try:
        place = ctypes.c_void_p.from_address(id(header) + object.__basicsize__).value
        raw = ctypes.string_at(place, _GUID + 8) if place else b""
    except (TypeError, ValueError):
        return b""
    if int.from_bytes(raw[_GUID:], sys.byteorder) != header.sequence_number:
        return b""
    return raw[:_GUID_PREFIX]


class ClientProcess:
    """Process of a participant, where it runs on this machine and uses Fast DDS.

    Parameters
    ----------
    participant : bytes
        As from `participant_of`.
    own : bytes
        Id of an endpoint of this process; empty if it is unknown.
    """

    def __init__(self, participant: bytes, own: bytes):
        self._descriptor = None
        if participant and participant[_MACHINE] == own[_MACHINE]:
            with contextlib.suppress(AttributeError, OSError):  # not on Linux, or the process has just ended
                self._descriptor = _opened(int.from_bytes(participant[_PROCESS], "little"))

    @property
    def has_ended(self) -> bool:
        """Whether the process has ended; False if it is unknown."""
        if self._descriptor is None:
            return False
        poll = select.poll()
        poll.register(self._descriptor, select.POLLIN)
        return bool(poll.poll(0))

    def close(self) -> None:
        """Stop watching the process."""
        if self._descriptor is not None:
            os.close(self._descriptor)
            self._descriptor = None


def _opened(number):
    """Return a descriptor of the only process of this middleware with a number's lowest bits, or None."""
    if not get_rmw_implementation_identifier().startswith(_MIDDLEWARE):
        return None
    pids = [int(name) for name in os.listdir("/proc") if name.isdigit()]
    found = [pid for pid in pids if pid % _PIDS == number and _uses_middleware(pid)]
    return os.pidfd_open(found[0]) if len(found) == 1 else None


def _uses_middleware(pid):
    """Return whether a process has loaded Fast DDS; False for processes of other users."""
    try:
        with open(f"/proc/{pid}/maps", encoding="utf-8", errors="replace") as maps:
            return any(_MIDDLEWARE in line for line in maps)
    except OSError:
        return False
