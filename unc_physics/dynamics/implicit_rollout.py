"""Rollouts of the implicit step, whose workspace grows until nothing overflows."""

from ..collision.implicit_workspace import NO_OVERFLOW, OVERFLOW, implicit_workspace, more_room
from ..compiler import inner, kernel
from .implicit_step import integrate

#: Contacts, candidates and pairs in lists that a workspace first has room for.
FIRST_ROOM = (64, 256, 2048)


def with_growing_room(attempt):
    """Return a kernel that calls ``attempt`` until all is done, with more room after each overflow.

    Parameters
    ----------
    attempt : kernel
        Takes how much is done, how much there is to do, the ``arguments``, the world, a new workspace and the
        number of contacts that it has room for. Returns how much is done; it may stop early.

    Returns
    -------
    kernel
        Takes a state (B, 13) and its kept overlap (`SolverMemory`), for which workspaces are made, the world,
        the ``arguments`` (a tuple), how much there is to do, and the first room. Returns the last room.
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
        Makes the method (`implicit_stages`) of its source, the world, a new workspace and the number of
        contacts that it has room for.

    Returns
    -------
    kernel
        Takes the state (B, 13), the first contacts (B, B + E), a `SolverMemory` and the rollout's row in it,
        the world, the method's source, and the numbers of steps before and to do; and the first room. It
        works in place, and returns the last room.
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
            memory.quiet[n],
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
    """The plain step."""
    return


_advance_plain = rollout_kernel(_no_method)


@kernel
def advance_implicit(states, first_time, memory, world, begin, steps):
    """Advance states (N, B, 13) in place, and what their rollouts remember (`SolverMemory`) along."""
    room = FIRST_ROOM
    for n in range(len(states)):
        room = _advance_plain(states[n], first_time[n], memory, n, world, None, begin, steps, room)
