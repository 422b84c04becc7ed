"""Samples of an initial belief that fly until their bodies first touch something.

Until then all propagators agree: bodies fly freely, and contacts are searched for, no more.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..physics.compiled import inner, kernel
from ..physics.explicit_step import integrate
from ..physics.implicit_step import integrate as integrate_implicit
from ..physics.implicit_workspace import implicit_workspace
from ..physics.implicit_world import fresh_solver_memory
from ..physics.rollout import rollout
from ..physics.workspace import workspace
from ..physics.world import Bodies, World
from ..propagators.start import begin, draw, known
from ..scene.action_arrays import start_states
from ..scene.belief import Belief
from ..scene.scene import Scene

_CONTACTS, _CANDIDATES, _LISTED = 64, 256, 2048  # room for them at first


class FirstContacts(NamedTuple):
    """N equally probable flights.

    Attributes
    ----------
    states : (N, B, 13) array
        At the end; of a body that touched something, just after it did.
    stopped : (N, B) array
        Time at which each body first touched something [s]; infinite for one that flew to the end, or is
        fixed.
    first : (N, B, B + E) array
        Time of the first contact of bodies i < j, or of body i and element j - B [s]; infinite without one.
        A body that was stopped can still be touched: such a contact is later than its time in ``stopped``.
    """

    states: np.ndarray
    stopped: np.ndarray
    first: np.ndarray


def first_contacts(scene: Scene, initial: Belief, steps: int, samples: int, seed: int = 0) -> FirstContacts:
    """Let samples of a belief fly until they touch something, for at most ``steps`` time steps; where a robot
    acts, they go on to the end.
    """
    initial, world = known(scene, initial), scene.world
    states, history = begin(scene, initial, draw(scene, initial, samples, seed))
    first = history.first_time
    stopped = np.full(states.shape[:2], np.inf, first.dtype)
    if scene.acts:  # which first contacts do not decide
        states = start_states(scene, states, np.zeros((samples, 0)))
        rollout(states, history, world, 0, steps)
        return FirstContacts(states, stopped, first)
    if world.implicit is None:
        _fly(states, first, stopped, world, world.surroundings, steps)
    else:
        memory = fresh_solver_memory(1, states.shape[1])
        _fly_implicit(states, first, stopped, world, memory, history.solver.kept_overlap, steps)
    return FirstContacts(states, stopped, first)


@kernel
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
def _fly(states, first, stopped, world, surroundings, steps):
    """Advance the states in place; a body counts as fixed from the step on in which it touches something."""
    for n in range(len(states)):
        own = _own_world(world, surroundings, None)
        work = workspace(states[n], own)
        for step in range(steps):
            integrate(states[n], first[n], own, surroundings, None, step, 1, work)
            if _stop(first[n], own.bodies.moving, stopped[n]) == 0:
                break


@kernel
def _fly_implicit(states, first, stopped, world, memory, kept_overlap, steps):
    """As `_fly`, by implicit steps; ``memory`` is that of one rollout, which begins anew, and
    ``kept_overlap`` that of all (`SolverMemory`).
    """
    for n in range(len(states)):
        own = _own_world(world, world.surroundings, world.implicit)
        bodies = own.bodies
        memory.count[:], memory.quiet[:] = 0, 0
        room, step, left = 1, 0, bodies.moving.sum()
        while left > 0 and step < steps:
            work = implicit_workspace(
                states[n], kept_overlap[n], own, room * _CONTACTS, room * _CANDIDATES, room * _LISTED
            )
            before, done = left, 1
            while left == before and done > 0 and step < steps:
                done = integrate_implicit(
                    states[n],
                    first[n],
                    memory.contact[0],
                    memory.force[0],
                    memory.count,
                    memory.quiet[0],
                    memory.residual[0],
                    memory.key[0],
                    own,
                    None,
                    step,
                    1,
                    work,
                )
                step += done
                left = _stop(first[n], bodies.moving, stopped[n])
                for i in range(len(bodies.moving)):
                    if not bodies.moving[i]:
                        bodies.inverse_mass[i] = 0.0
                        bodies.inverse_inertia[i] = 0.0
            if done == 0:
                room *= 2


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
