"""The process that sent a request, and whether it still runs.

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
_SEQUENCE = 8  # bytes of the number that follows the id in ``rmw_request_id_t``
_MACHINE, _PROCESS = slice(0, 4), slice(4, 6)  # of a participant's id of Fast DDS
_MIDDLEWARE = "rmw_fastrtps"
_PIDS = 1 << 16  # numbers of processes that an id distinguishes


def participant_of(header) -> bytes:
    """Return the beginning of the ids of a client's endpoints, from its request's header; empty if unknown.

    rclpy of ROS 2 Jazzy has no other access to it: its ``rmw_request_id_t`` shows the sequence number but not
    the writer's id, ``Node.get_subscriptions_info_by_topic`` lists the endpoints of all clients, and actions
    have no introspection, whose events contain the client's id.

    The C structure begins with the id, and the sequence number follows. Its address is the first word after
    the head of the Python object. The structure is read as a file, so that a wrong address is an error and
    not a fault. Its number must be that of the header. Otherwise, as after a change of rclpy or on another
    system than Linux, the participant is unknown. A goal then ends only when all clients of its beginning
    are gone.
    """
    number = getattr(header, "sequence_number", None)
    if not isinstance(number, int):
        return b""
    word = ctypes.sizeof(ctypes.c_void_p)
    address = int.from_bytes(_memory(id(header) + object.__basicsize__, word), sys.byteorder)
    raw = _memory(address, _GUID + _SEQUENCE)
    if len(raw) < _GUID + _SEQUENCE or int.from_bytes(raw[_GUID:], sys.byteorder) != number:
        return b""
    return raw[:_GUID_PREFIX]


def _memory(address, size):
    """Return bytes of this process's memory; none where it has no readable memory."""
    try:
        with open("/proc/self/mem", "rb", buffering=0) as memory:
            return os.pread(memory.fileno(), size, address)
    except (OSError, OverflowError):  # not on Linux, or nothing is there
        return b""


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
