"""Samples of an initial belief that fly until their bodies first touch something.

Until then all propagators agree: bodies fly freely, and contacts are searched for, no more.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..compiler import inner, kernel
from ..compiler.arrays import integers
from ..dynamics.explicit_step import integrate
from ..dynamics.implicit_rollout import FIRST_ROOM, with_growing_room
from ..dynamics.implicit_step import integrate as integrate_implicit
from ..dynamics.implicit_world import fresh_solver_memory
from ..dynamics.rollout import rollout
from ..dynamics.workspace import workspace
from ..dynamics.world import Bodies, World
from ..propagators.start import constrain_belief, draw, resolve_initial_overlap
from ..scene.action_arrays import start_states
from ..scene.belief import Belief
from ..scene.scene import Scene


class Flights(NamedTuple):
    """N equally probable flights up to one time.

    Attributes
    ----------
    states : (N, B, 13) array
        At that time; of a body that touched something, just after it did.
    first_contacts : (N, B, B + E) array
        Time of the first contact of bodies i < j, or of body i and element j - B [s]; infinite without one.
        A body that was stopped can still be touched: such a contact is later than its time in
        ``known_until``.
    known_until : (N, B) array
        Time at which each body first touched something [s]; infinite for one that flew until then, or is
        fixed.
    """

    states: np.ndarray
    first_contacts: np.ndarray
    known_until: np.ndarray


def first_contacts(
    scene: Scene, initial: Belief, marks: Sequence[int], samples: int, seed: int = 0
) -> list[Flights]:
    """Let samples of a belief fly until they touch something; where a robot acts, they go on to the end.

    Parameters
    ----------
    scene : Scene
    initial : Belief
        At time 0.
    marks : sequence of int
        Numbers of time steps, ascending.
    samples, seed : int
        How many, and the seed of the draws.

    Returns
    -------
    list of Flights
        One for each mark.
    """
    initial, world = constrain_belief(scene, initial), scene.world
    states, history = resolve_initial_overlap(scene, initial, draw(scene, initial, samples, seed))
    first = history.first_time
    stopped = np.full(states.shape[:2], np.inf, first.dtype)
    reached = np.empty((len(marks), *states.shape))
    ends = np.array(marks, np.int64)
    if scene.acts:  # which first contacts do not decide
        states = start_states(scene, states, np.zeros((samples, 0)))
        done = 0
        for k, mark in enumerate(marks):
            rollout(states, history, world, done, mark - done)
            reached[k], done = states, mark
    elif world.implicit is None:
        _fly(states, first, stopped, world, world.surroundings, ends, reached)
    else:
        memory = fresh_solver_memory(1, states.shape[1])
        _fly_implicit(states, first, stopped, world, memory, history.solver.kept_overlap, ends, reached)
    found: list[Flights] = []
    for k, mark in enumerate(marks):
        latest = (mark + 0.5) * scene.dt
        touched = np.where(first < latest, first, np.inf)
        found.append(Flights(reached[k], touched, np.where(stopped < latest, stopped, np.inf)))
    return found


@kernel(noinline=True)
def _own_world(world, surroundings, implicit):
    """A world in which bodies can be stopped without stopping them in the one given.

    ``surroundings`` and ``implicit`` are the world's, or None to compile without them.
    """
    b = world.bodies
    return World(
        Bodies(
            b.moving.copy(),
            b.mass,
            b.inertia,
            b.inverse_mass.copy(),
            b.inverse_inertia.copy(),
            b.radius,
            b.root,
        ),
        world.tree,
        world.gravity,
        world.dt,
        world.decay,
        world.stiffness,
        world.stack_size,
        surroundings,
        implicit,
    )


@kernel
def _fly(states, first, stopped, world, surroundings, marks, reached):
    """Advance the states in place; a body counts as fixed from the step on in which it touches something.

    ``reached`` (T, N, B, 13) are the states after the ``marks``.
    """
    for n in range(len(states)):
        own = _own_world(world, surroundings, None)
        work = workspace(states[n], own)
        left, step = own.bodies.moving.sum(), 0
        for k in range(len(marks)):
            while left > 0 and step < marks[k]:
                integrate(states[n], first[n], own, surroundings, None, step, 1, work)
                step += 1
                left = _stop(first[n], own.bodies.moving, stopped[n])
            reached[k, n] = states[n]


@kernel
def _fly_until_one_stops(done, total, arguments, world, work, contacts):
    """Advance a flight by implicit steps until a body stops, room overflows, or all have stopped.

    Returns the number of steps done, and ``total`` where all have stopped.
    """
    x, first, stopped, memory, marks, shown, reached = arguments
    bodies = world.bodies
    before = left = bodies.moving.sum()
    some = 1
    while left == before and some > 0 and done < total:
        some = integrate_implicit(
            x,
            first,
            memory.contact[0],
            memory.force[0],
            memory.count,
            memory.quiet[0],
            memory.residual[0],
            memory.key[0],
            world,
            None,
            done,
            1,
            work,
        )
        done += some
        if some > 0 and done == marks[shown[0]]:
            reached[shown[0]] = x
            shown[0] += 1
        left = _stop(first, bodies.moving, stopped)
        for i in range(len(bodies.moving)):
            if not bodies.moving[i]:
                bodies.inverse_mass[i] = 0.0
                bodies.inverse_inertia[i] = 0.0
    return total if left == 0 else done


_complete_flight = with_growing_room(_fly_until_one_stops)


@kernel
def _fly_implicit(states, first, stopped, world, memory, kept_overlap, marks, reached):
    """As `_fly`, by implicit steps; ``memory`` is that of one rollout, which begins anew, and
    ``kept_overlap`` that of all (`SolverMemory`).
    """
    shown = integers(1)
    for n in range(len(states)):
        own = _own_world(world, world.surroundings, world.implicit)
        memory.count[:], memory.quiet[:] = 0, 0
        shown[0] = 0
        arguments = states[n], first[n], stopped[n], memory, marks, shown, reached[:, n]
        if own.bodies.moving.any():
            _complete_flight(states[n], kept_overlap[n], own, arguments, marks[-1], FIRST_ROOM)
        for k in range(shown[0], len(marks)):
            reached[k, n] = states[n]


@inner
def _stop(first, moving, stopped):
    """Stop the bodies that touched something; returns how many still move."""
    left = 0
    for i in range(len(moving)):
        if not moving[i]:
            continue
        time = np.float32(np.inf)
        for j in range(first.shape[1]):
            time = min(time, first[i, j])
        for j in range(i):
            time = min(time, first[j, i])
        if time < np.inf:
            stopped[i] = time
    for i in range(len(moving)):
        moving[i] = moving[i] and stopped[i] == np.inf
        left += moving[i]
    return left
