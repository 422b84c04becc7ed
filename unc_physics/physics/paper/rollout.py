"""Rollouts of a batch of states by explicit steps: the only loop over samples."""

import numpy as np

from ...compiler import kernel
from ...compiler.threads import in_threads
from .. import contact_history as histories
from .explicit_step import integrate
from .workspace import workspace


def rollout(states, contact_history, world, begin, steps):
    """Advance a batch of states in place.

    Rollouts are computed independently, so the result does not depend on the number of threads
    (`numba.set_num_threads`).

    Parameters
    ----------
    states : (N, B, 13) float64, C order
        One scene state per sample.
    contact_history : ContactHistory
        History of these rollouts (`contact_history.fresh`); updated in place.
    world : World
    begin : int
        Number of steps done before.
    steps : int
    """
    in_threads(
        len(states),
        lambda some: advance(states[some], histories.samples(contact_history, some), world, begin, steps),
        steps=states.shape[1] * steps,
    )


def recorded(states, contact_history, world, begin, steps):
    """Return the states and histories of rollouts after each of several numbers of steps, as a list of pairs.

    Parameters
    ----------
    states, contact_history, world, begin
        As in `rollout`; states and history are advanced in place.
    steps : (T,) int64
        Ascending, counted from the first step of the call.
    """
    records = new_records(states, contact_history, steps)

    def run(some):
        record(
            states[some], histories.samples(contact_history, some), world, begin, steps, records, some.start
        )

    in_threads(len(states), run, steps=states.shape[1] * (int(steps[-1]) + len(steps)))
    return read_records(records, contact_history, len(steps))


def new_records(states, contact_history, steps):
    """Return empty records of N rollouts: states (T N, B, 13), and first contacts (T N, B, B + E) float32.

    Rollout n after the number t of ``steps`` has row ``t N + n``.
    """
    count = len(states) * len(steps)
    given = states, contact_history.first_time
    return tuple(np.empty((count, *values.shape[1:]), values.dtype) for values in given)


def record(states, contact_history, world, begin, steps, records, place):
    """Advance a batch in the calling thread, and record it; ``place`` is the first one's in the records."""
    first = contact_history.first_time
    _record(states, first, world, world.environment, begin, steps, records, place)


def read_records(records, contact_history, stops):
    """Return the states and histories at each of a number of ``stops``, as a list of pairs."""
    return [
        (states, contact_history._replace(first_time=first))
        for states, first in zip(*(np.split(values, stops) for values in records), strict=True)
    ]


def simulate(states, world, steps):
    """Advance a batch of states (N, B, 13) in place, as new rollouts."""
    rollout(states, histories.fresh(len(states), world), world, 0, steps)


def advance(states, contact_history, world, begin, steps):
    """Advance a batch as `rollout` does, in the calling thread."""
    nothing = states[:0], contact_history.first_time[:0]
    record(states, contact_history, world, begin, np.array([steps]), nothing, 0)


@kernel
def _record(states, first_time, world, environment, begin, stops, records, place):
    """Advance states (N, B, 13) and first contacts (N, B, B + E) in place by explicit steps.

    After each of ``stops`` (T,) steps they are recorded in ``records`` (`new_records`), in which ``place`` is
    the first one's number; nowhere if these are empty.
    """
    some, first = records
    rollouts = len(some) // len(stops)
    for n in range(len(states)):
        work, done = workspace(states[n], world), 0
        for t in range(len(stops)):
            integrate(states[n], first_time[n], world, environment, None, begin + done, stops[t] - done, work)
            done = stops[t]
            if rollouts == 0:
                continue
            row = rollouts * t + place + n
            for i in range(states.shape[1]):
                for k in range(states.shape[2]):
                    some[row, i, k] = states[n, i, k]
                for k in range(first_time.shape[2]):
                    first[row, i, k] = first_time[n, i, k]
