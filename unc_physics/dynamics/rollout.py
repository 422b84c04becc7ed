"""Rollouts of a batch of states: the only loop over samples."""

import numpy as np

from ..compiler import kernel
from ..compiler.threads import in_threads
from ..compiler.time_limit import limited
from . import contact_history as histories
from .explicit_step import integrate
from .implicit_rollout import Records, Stops, record_implicit
from .workspace import workspace

#: Body steps, over all samples, that take less time than starting another thread.
_FEW_STEPS = 400


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
    world = limited(world)
    each = max(states.shape[1] * steps, 1)
    if len(states) * each <= _FEW_STEPS:
        advance(states, contact_history, world, begin, steps)
        return
    in_threads(
        len(states),
        lambda some: advance(states[some], histories.samples(contact_history, some), world, begin, steps),
        fewest=_FEW_STEPS // each,
    )


def recorded(states, contact_history, world, begin, stops):
    """Return the states and histories of rollouts at each of several stops, as a list of pairs.

    Parameters
    ----------
    states, contact_history, world, begin
        As in `rollout`; states and history are advanced in place.
    stops : Stops
        The explicit step takes whole steps only.
    """
    world, records = limited(world), new_records(states, contact_history, stops)

    def run(some):
        record(
            states[some], histories.samples(contact_history, some), world, begin, stops, records, some.start
        )

    each = max(states.shape[1] * (int(stops.steps[-1]) + len(stops.steps)), 1)
    if len(states) * each <= _FEW_STEPS:
        run(slice(0, len(states)))
    else:
        in_threads(len(states), run, fewest=_FEW_STEPS // each)
    return read_records(records, contact_history)


def new_records(states, contact_history, stops):
    """Return empty `Records` of rollouts; their memory is None with the explicit step, which has none."""
    count = len(states) * len(stops.steps)
    first, memory = contact_history.first_time, contact_history.solver
    some = [np.empty((count, *values.shape[1:]), values.dtype) for values in (states, first, *(memory or ()))]
    return Records(some[0], some[1], None if memory is None else type(memory)(*some[2:]), len(states))


def record(states, contact_history, world, begin, stops, records, place):
    """Advance a batch in the calling thread, and record it; ``place`` is the first one's in the records."""
    if world.implicit is None:
        record_explicit(
            states,
            contact_history.first_time,
            world,
            world.environment,
            begin,
            stops.steps,
            records[:2],
            place,
        )
        return
    record_implicit(
        states, contact_history.first_time, contact_history.solver, world, begin, stops, records, place
    )


def read_records(records, contact_history):
    """Return the states and histories at each stop, as a list of pairs."""
    found = []
    for first in range(0, len(records.states), records.rollouts):
        rows = slice(first, first + records.rollouts)
        memory = records.memory
        if memory is not None:
            memory = type(memory)(*(values[rows] for values in memory))
        history = contact_history._replace(first_time=records.first_time[rows], solver=memory)
        found.append((records.states[rows], history))
    return found


def simulate(states, world, steps):
    """Advance a batch of states (N, B, 13) in place, as new rollouts."""
    rollout(states, histories.fresh(len(states), world), world, 0, steps)


def advance(states, contact_history, world, begin, steps):
    """Advance a batch as `rollout` does, in the calling thread, by the world's integrator.

    The implicit step records the end, too: a kernel that records nothing would compile the step once more.
    """
    if world.implicit is None:
        first, nothing = contact_history.first_time, (states[:0], contact_history.first_time[:0])
        record_explicit(states, first, world, world.environment, begin, np.array([steps]), nothing, 0)
    else:
        end = Stops(np.array([steps]), *np.zeros((3, 1)))
        record(states, contact_history, world, begin, end, new_records(states, contact_history, end), 0)


@kernel
def record_explicit(states, first_time, world, environment, begin, stops, records, place):
    """Advance states (N, B, 13) and first contacts (N, B, B + E) in place by explicit steps.

    After each of ``stops`` (T,) steps they are recorded in the first two arrays of `Records`, in which
    ``place`` is the first one's number; nowhere if these are empty.
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
