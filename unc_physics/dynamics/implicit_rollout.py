"""Rollouts of the implicit step, with workspaces that grow after an overflow."""

from ..collision.implicit_workspace import NO_OVERFLOW, OVERFLOW, implicit_workspace, more_room
from ..compiler import inner, kernel
from .implicit_step import integrate

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
        return done + integrate(
            x,
            first_time,
            memory.contact[n],
            memory.force[n],
            memory.count[n : n + 1],
            memory.rest_steps[n],
            memory.residual[n],
            memory.key[n],
            world,
            method,
            begin + done,
            steps - done,
            work,
        )

    complete = with_growing_room(attempt)

    @kernel
    def advance(x, first_time, memory, n, world, source, begin, steps, room):
        return complete(
            x, memory.kept_overlap[n], world, (x, first_time, memory, n, source, begin), steps, room
        )

    return advance


@inner
def _no_method(source, world, work, contacts):
    """Return None as the method of a plain step."""
    return


_advance_plain = rollout_kernel(_no_method)


@kernel
def advance_implicit(states, first_time, memory, world, begin, steps):
    """Advance states (N, B, 13) and their `SolverMemory` in place."""
    room = FIRST_ROOM
    for n in range(len(states)):
        room = _advance_plain(states[n], first_time[n], memory, n, world, None, begin, steps, room)
