"""Lets kernels end early: at a time limit, or when nobody waits for them any more.

A step of thousands of contacts may take minutes, and a thread in a kernel cannot be interrupted. So each
computation has a flag, which its kernels look at now and then, and which one thread raises when time is up.
"""

from __future__ import annotations

import contextlib
import math
import threading
import time

import numpy as np


class TimeLimit:
    """The flag of one computation.

    Attributes
    ----------
    flag : (1,) int64 array
        Not 0 when kernels are to end.
    """

    def __init__(self):
        self.flag = np.zeros(1, np.int64)

    def within(self, seconds: float) -> None:
        """Stop kernels when so much wall time has passed from now on [s]; until then they run."""
        _watch(self, time.monotonic() + seconds)

    @property
    def passed(self) -> bool:
        """Whether kernels may have ended early, so that what they left means nothing."""
        return bool(self.flag[0])

    def stop(self) -> None:
        """Stop kernels for good."""
        with _changed:
            _ends.pop(self, None)
        self.flag[0] = 1


_here = threading.local()
_ends, _changed = {}, threading.Condition()  # of the limits that are set: when they end
_watcher, _wakes = None, math.inf  # the watching thread, and when it looks next


@contextlib.contextmanager
def time_limit():
    """The `TimeLimit` of all kernels that this thread calls inside; whatever ends it stops them."""
    before, _here.limit = limit_here(), TimeLimit()
    try:
        yield _here.limit
    finally:
        _here.limit.stop()
        _here.limit = before


@contextlib.contextmanager
def under_limit(limit):
    """Let the kernels that this thread calls inside keep to another thread's `TimeLimit`, or to none."""
    before, _here.limit = limit_here(), limit
    try:
        yield
    finally:
        _here.limit = before


def limit_here():
    """The `TimeLimit` of this thread, if it has one."""
    return getattr(_here, "limit", None)


def limited(world, limit=None):
    """A world whose kernels keep to a time limit: by default that of this thread, if it has one."""
    limit = limit_here() if limit is None else limit
    if limit is None or world.implicit is None:
        return world
    return world._replace(implicit=world.implicit._replace(stop=limit.flag))


def _watch(limit, when):
    """Let the watching thread, which the first call starts, stop a limit's kernels at a time."""
    global _watcher
    with _changed:
        limit.flag[0], _ends[limit] = 0, when
        if _watcher is None or not _watcher.is_alive():  # it does not live on in a process that was forked
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
