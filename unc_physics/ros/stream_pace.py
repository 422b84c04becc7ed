"""Pace of a stream: how many rollouts its predictions have time for, and which inputs it skips."""

from __future__ import annotations

import itertools
import statistics
import threading
import time
from collections import deque
from dataclasses import replace
from typing import Any

from ..propagators.base import Anytime, Propagator

_INTERVALS = 5  # of the input, whose median is its period
_SHARES = 1.0, 0.75, 0.5, 0.375, 0.1875  # of a propagator's rollouts
_FEWEST = 12  # rollouts
_SHARE_OF_PERIOD = 0.5
_ROOM = 0.8  # share of the limit that more rollouts may take


class Pace:
    """Rate of an input, and the share of rollouts with which its predictions keep their time limit."""

    def __init__(self):
        self._arrivals: deque[float] = deque(maxlen=_INTERVALS + 1)
        self._level = 0

    def reset(self) -> None:
        """Forget the input's rate; the share of rollouts stays."""
        self._arrivals.clear()

    def arrived(self) -> None:
        """Record an input."""
        self._arrivals.append(time.monotonic())

    def limit(self, asked: float) -> float | None:
        """Return the longest computation time [s]; None while the rate of the input is unknown.

        Parameters
        ----------
        asked : float
            The parameter ``stream_time_budget`` [s]; 0: half the input's period.
        """
        if asked:
            return asked
        times = list(self._arrivals)
        if len(times) < 3:
            return None
        period = statistics.median(later - earlier for earlier, later in itertools.pairwise(times))
        return _SHARE_OF_PERIOD * period

    def adapted(self, propagator: Propagator, limit: float | None) -> Propagator:
        """Return the propagator with as many rollouts as its last predictions had time for."""
        fitted: Any = propagator
        if limit is None:
            return propagator
        if isinstance(propagator, Anytime):
            return replace(fitted, time=limit)
        for option in ("runs", "samples"):
            if (count := getattr(propagator, option, 0)) > _FEWEST:
                return replace(fitted, **{option: max(_FEWEST, round(_SHARES[self._level] * count))})
        return propagator

    def took(self, seconds: float, limit: float | None) -> None:
        """Adapt the share of rollouts to the time that a prediction took [s]."""
        if limit is None:
            return
        if seconds > limit:
            fitting = _SHARES[self._level] * limit / seconds
            lower = range(self._level + 1, len(_SHARES))
            self._level = next((k for k in lower if _SHARES[k] <= fitting), len(_SHARES) - 1)
        elif self._level and seconds * _SHARES[self._level - 1] / _SHARES[self._level] < _ROOM * limit:
            self._level -= 1


class LatestWorker:
    """Thread that processes the latest item; a new item replaces a waiting one.

    Parameters
    ----------
    work : callable
        Takes one item; must not raise.
    replaced : callable
        Called without arguments for each replaced item.
    """

    def __init__(self, work, replaced):
        self._work, self._replaced = work, replaced
        self._items = []
        self._changed = threading.Condition()
        self._closed = False
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def put(self, item) -> None:
        """Replace the waiting item."""
        with self._changed:
            late = bool(self._items)
            self._items = [item]
            self._changed.notify()
        if late:
            self._replaced()

    def close(self) -> None:
        """Wait until the current item is done; drop the waiting one."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        self._thread.join()

    def _run(self):
        while True:
            with self._changed:
                while not (self._items or self._closed):
                    self._changed.wait()
                if self._closed:
                    return
                item = self._items.pop()
            self._work(item)
