"""History of a tracker: states and measurements within a window, so that late ones count in their order."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass

from ..checks.errors import InvalidRequestError
from .correction import Start, correct_state
from .measurements import Measurement
from .members import advanced, with_physics_in_charge
from .state import State, TrackedScene

_SAME_TIME = 1e-9  # s


@dataclass(eq=False)
class Entry:
    """Measurements of one time, the state after them, and the bodies whose measurements had no effect."""

    time: float
    measurements: Mapping[str, Measurement]
    state: State
    rejected: tuple[str, ...] = ()


class History:
    """Measurements since a state, in the order of their times.

    Parameters
    ----------
    time : float
        [s]
    state : State
        At that time.
    """

    def __init__(self, time: float, state: State):
        self._entries = [Entry(time, {}, state)]
        self._present: State | None = state  # after the last entry, advanced as far as was asked for

    @property
    def begin(self) -> float:
        """Time of the first state [s]."""
        return self._entries[0].time

    @property
    def last(self) -> Entry:
        """The newest measurements."""
        return self._entries[-1]

    def copy(self) -> History:
        """Return an independent history with the same entries."""
        other = copy.copy(self)
        other._entries = [copy.copy(entry) for entry in self._entries]
        return other

    def is_before(self, time: float) -> bool:
        """Return whether a time [s] is before the first state."""
        return time < self.begin - _SAME_TIME

    def state_at(self, tracked: TrackedScene, time: float) -> State:
        """Return the state at a time [s], from the measurements until then.

        Raises
        ------
        InvalidRequestError
            If the time is before the first state.
        """
        place = self._place(time)
        if place < 0:
            raise InvalidRequestError(
                f"must not be before the tracker's window, which begins at {self.begin:.6g} s",
                field="time",
                value=time,
            )
        state, present = self._entries[place].state, self._present
        if present is not None and place == len(self._entries) - 1:
            if state.carry.step <= present.carry.step <= tracked.step(time):
                state = present
        return advanced(tracked, state, tracked.step(time))

    def advance(self, tracked: TrackedScene, time: float) -> None:
        """Advance the state after the last measurements to a time [s]."""
        self._present = self.state_at(tracked, time)

    def add(
        self, tracked: TrackedScene, time: float, measurements: Mapping[str, Measurement]
    ) -> tuple[Entry, int]:
        """Add measurements of a time [s] that is not before the first state.

        If this fails, the history stays as it was.

        Returns
        -------
        entry : Entry
        replayed : int
            Number of later entries, whose measurements were applied again.
        """
        place = self._place(time)
        entry = Entry(time, measurements, self._entries[place].state)
        entries = [copy.copy(one) for one in self._entries]
        entries.insert(place + 1, entry)
        _replay(tracked, entries, place + 1)
        self._entries, self._present = entries, None
        return entry, len(entries) - place - 2

    def forget(self, time: float) -> None:
        """Remove the entries that no time from the given one on [s] needs."""
        old = [k for k, entry in enumerate(self._entries) if entry.time < time]
        if old:
            del self._entries[: old[-1]]

    def _place(self, time):
        """Return the index of the last entry that is not after a time; -1 if there is none."""
        return max(
            (k for k, entry in enumerate(self._entries) if entry.time <= time + _SAME_TIME), default=-1
        )


def _replay(tracked, entries, place):
    """Apply the measurements of entries from an index on again, in place."""
    k = place
    while k < len(entries):
        entry = entries[k]
        state = advanced(tracked, entries[k - 1].state, tracked.step(entry.time))
        times = [one.time for one in entries[1:k]]
        found = correct_state(tracked, state, entry.time, entry.measurements, times)
        if isinstance(found, Start):  # of members at an earlier measurement, which continue from there
            k = max(j for j in range(1, k) if entries[j].time == found.free.time)
            entries[k].state = with_physics_in_charge(tracked, entries[k].state, found.place, found.free)
        else:
            entry.state, entry.rejected = found
        k += 1
