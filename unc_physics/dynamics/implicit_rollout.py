"""Rollouts of the implicit step, with workspaces that grow after an overflow."""

from typing import NamedTuple

import numpy as np

from ..collision.implicit_workspace import CLEARANCE, NO_OVERFLOW, OVERFLOW, implicit_workspace, more_room
from ..compiler import inner, kernel
from ..compiler.arrays import integers
from ..spatial.layout import Q
from ..spatial.rotation import write_matrix
from .implicit_step import integrate, rollout_of
from .implicit_world import SolverMemory
from .world import World

#: Initial room of a workspace: contacts, candidates and pairs in lists.
FIRST_ROOM = (64, 256, 2048)


def with_growing_room(attempt):
    """Return a kernel that calls ``attempt`` until all steps are done, with more room after each overflow.

    Parameters
    ----------
    attempt : kernel
        Takes the number of steps done, the total, the ``arguments``, the world, a new workspace, and its room
        for contacts. Returns the number of steps done; it may stop early.

    Returns
    -------
    kernel
        Takes a state (B, 13), its kept overlap (`SolverMemory`), the world, the ``arguments`` (a tuple), the
        total, and the initial room. Returns the final room.
    """

    @kernel
    def complete(x, kept_overlap, world, arguments, total, room):
        done = 0
        while done < total:
            work = implicit_workspace(x, kept_overlap, world, room)
            done = attempt(done, total, arguments, world, work, room[0])
            if work.counts[OVERFLOW] != NO_OVERFLOW:
                room = more_room(work.counts, room)
        return room

    return complete


def rollout_kernel(prepare):
    """Return a kernel that advances one rollout by implicit steps, with a method in their stages.

    Parameters
    ----------
    prepare : kernel
        Creates the method (`implicit_stages`) from its source, the world, a new workspace and its room for
        contacts.

    Returns
    -------
    kernel
        Takes the state (B, 13), the first contacts (B, B + E), a `SolverMemory`, and the rollout's row in it.
        Then the world, the method's source, the number of steps before, the steps to do, and the initial
        room. It works in place, and returns the final room.
    """

    @kernel
    def attempt(done, steps, arguments, world, work, contacts):
        x, first_time, memory, n, source, begin = arguments
        method = prepare(source, world, work, contacts)
        rollout = rollout_of(first_time, memory, n, world)
        return done + integrate(x, rollout, world, method, begin + done, steps - done, work)

    complete = with_growing_room(attempt)

    @kernel
    def advance(x, first_time, memory, n, world, source, begin, steps, room):
        return complete(
            x, memory.kept_overlap[n], world, (x, first_time, memory, n, source, begin), steps, room
        )

    return advance


class Stops(NamedTuple):
    """Times at which rollouts are recorded, ascending.

    Attributes
    ----------
    steps : (T,) int64
        Whole time steps before each, counted from the first step of the call.
    rest : (T,) float64
        Length of the shorter step that follows these [s]; 0 for none. It changes only what is recorded.
    start, decay : (T,) float64
        `World.start` and `World.decay` of the shorter step.
    """

    steps: np.ndarray
    rest: np.ndarray
    start: np.ndarray
    decay: np.ndarray


class Records(NamedTuple):
    """States and histories of N rollouts at T stops; rollout n at stop t has row ``t N + n``.

    Attributes
    ----------
    states : (T N, B, 13) float64
    first_time : (T N, B, B + E) float32
    memory : SolverMemory or None
        None with the explicit step.
    rollouts : int
        N.
    """

    states: np.ndarray
    first_time: np.ndarray
    memory: SolverMemory | None
    rollouts: int


@kernel
def _attempt_stops(done, total, arguments, world, work, contacts):
    """Advance a rollout and record it at its stops, from the stop ``done`` on; return the stops done."""
    x, first_time, memory, n, begin, stops, records, place, counted = arguments
    for t in range(done, total):
        row = t * records.rollouts + place
        for part in range(2):  # whole steps, and the shorter one from a copy, by one call of `integrate`
            if part == 0:
                y, first, kept, k = x, first_time, memory, n
                steps, dt, start, decay = stops.steps[t] - counted[0], world.dt, world.start, world.decay
            else:
                _record(x, first_time, memory, n, row, records)
                if stops.rest[t] == 0.0:
                    continue
                y, first, kept, k = records.states[row], records.first_time[row], records.memory, row
                steps, dt, start, decay = 1, stops.rest[t], stops.start[t], stops.decay[t]
            if steps > 0:
                own = _with_step(world, dt, start, decay)
                rollout = rollout_of(first, kept, k, own)
                finished = integrate(y, rollout, own, None, begin + counted[0], steps, work)
                if part == 0:
                    counted[0] += finished
                if finished < steps:
                    return t
            if part == 1:
                _go_back(x, work)
    return total


@inner(noinline=True)
def _record(x, first_time, memory, n, row, records):
    """Write a rollout into its row."""
    out, first, recorded = records.memory, records.first_time[row], records.states[row]
    for i in range(len(x)):
        for k in range(x.shape[1]):
            recorded[i, k] = x[i, k]
        for k in range(first.shape[1]):
            first[i, k] = first_time[i, k]
        if out.kept_overlap.shape[1] > 0:
            for k in range(first.shape[1]):
                out.kept_overlap[row, i, k] = memory.kept_overlap[n, i, k]
        out.rest_steps[row, i], out.residual[row, i] = memory.rest_steps[n, i], memory.residual[n, i]
    out.count[row], out.key[row] = memory.count[n], memory.key[n]
    for m in range(out.contact.shape[1]):
        for k in range(4):
            out.contact[row, m, k], out.force[row, m, k] = memory.contact[n, m, k], memory.force[n, m, k]


@kernel(noinline=True)
def _with_step(world, dt, start, decay):
    """Return a world with another time step."""
    return World(
        world.bodies,
        world.tree,
        world.gravity,
        dt,
        start,
        decay,
        world.stiffness,
        world.stack_size,
        world.environment,
        world.implicit,
    )


@inner(noinline=True)
def _go_back(x, work):
    """Make a workspace fit for a state from before the last step; lists of spheres depend on poses only."""
    for i in range(len(x)):
        write_matrix((x[i, Q], x[i, Q + 1], x[i, Q + 2], x[i, Q + 3]), work.R, i)
        work.numbers[i, CLEARANCE] = -np.inf


_complete_stops = with_growing_room(_attempt_stops)


@kernel
def record_implicit(states, first_time, memory, world, begin, stops, records, place):
    """Advance states (N, B, 13) and their `SolverMemory` in place, and record them at all stops.

    ``place`` is the number of the first among the rollouts of the records.
    """
    room = FIRST_ROOM
    for n in range(len(states)):
        arguments = states[n], first_time[n], memory, n, begin, stops, records, place + n, integers(1)
        room = _complete_stops(states[n], memory.kept_overlap[n], world, arguments, len(stops.steps), room)
