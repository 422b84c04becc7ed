"""Times at which beliefs are wanted, as whole time steps and a shorter last one."""

from __future__ import annotations

import math
from typing import NamedTuple

#: Times that differ by no more are the same time [s]: that of messages has whole nanoseconds.
RESOLUTION = 1e-9


class Mark(NamedTuple):
    """A time at which a belief is wanted."""

    steps: int  # number of whole time steps before it
    rest: float  # length of the shorter step that follows these [s]; 0 where the time is a multiple of ``dt``
    time: float  # time from the start [s]

    @property
    def count(self) -> int:
        """Number of steps, with the shorter one."""
        return self.steps + (self.rest > 0.0)

    def fraction_of(self, dt: float) -> float:
        """Return the time in steps of ``dt`` seconds: an int for a multiple of ``dt``, else a float."""
        return self.steps + self.rest / dt if self.rest > 0.0 else self.steps


def whole(steps: int, dt: float) -> Mark:
    """Return the mark after so many whole steps."""
    return Mark(steps, 0.0, steps * dt)


def mark_at(time: float, dt: float) -> Mark:
    """Return the mark of a positive time [s]; a time within `RESOLUTION` of a multiple of ``dt`` is that."""
    nearest = max(round(time / dt), 1)
    if abs(time - nearest * dt) <= RESOLUTION:
        return whole(nearest, dt)
    steps = math.floor(time / dt)
    return Mark(steps, time - steps * dt, time)
