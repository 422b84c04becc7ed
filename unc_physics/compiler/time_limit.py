"""Early end of kernels: at a time limit, or when nobody needs their result any more.

A step with thousands of contacts may take minutes, and a thread in a kernel cannot be interrupted. So each
computation has a flag that its kernels check regularly, and one thread sets it when time is up.
"""

from __future__ import annotations

import contextlib
import math
import threading
import time

import numpy as np


class TimeLimit:
    """Stop flag of one computation.

    Attributes
    ----------
    flag : (1,) int64 array
        Nonzero when kernels must end.
    """

    def __init__(self):
        self.flag = np.zeros(1, np.int64)

    def within(self, seconds: float) -> None:
        """Stop kernels after an amount of wall time from now [s]."""
        _watch(self, time.monotonic() + seconds)

    @property
    def passed(self) -> bool:
        """Whether kernels may have ended early, so that their results are invalid."""
        return bool(self.flag[0])

    def resume(self) -> None:
        """Let kernels run again after the end of the time."""
        self.flag[0] = 0

    def stop(self) -> None:
        """Stop kernels permanently."""
        with _changed:
            _ends.pop(self, None)
        self.flag[0] = 1


_here = threading.local()
_ends, _changed = {}, threading.Condition()  # end times of active limits
_watcher, _wakes = None, math.inf  # the watching thread, and its next wake-up


@contextlib.contextmanager
def time_limit():
    """Provide a `TimeLimit` for this thread's kernels in the ``with`` block; its end stops them."""
    before, _here.limit = limit_here(), TimeLimit()
    try:
        yield _here.limit
    finally:
        _here.limit.stop()
        _here.limit = before


def limit_here():
    """Return the `TimeLimit` of this thread, or None."""
    return getattr(_here, "limit", None)


def _watch(limit, when):
    """Make the watching thread, started on the first call, stop a limit's kernels at a time."""
    global _watcher
    with _changed:
        limit.flag[0], _ends[limit] = 0, when
        if _watcher is None or not _watcher.is_alive():  # a forked process does not inherit the thread
            _watcher = threading.Thread(target=_end_all, name="time limits", daemon=True)
            _watcher.start()
        elif when < _wakes:
            _changed.notify()


def _end_all():
    global _wakes
    with _changed:
        while True:
            now = time.monotonic()
            for limit in [limit for limit, when in _ends.items() if when <= now]:
                del _ends[limit]
                limit.flag[0] = 1
            _wakes = min(_ends.values(), default=math.inf)
            _changed.wait(None if _wakes == math.inf else min(_wakes - now, threading.TIMEOUT_MAX))
