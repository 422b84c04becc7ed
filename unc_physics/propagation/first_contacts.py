"""Samples of an initial belief, each body of which runs until it first touches something.

What happens before that is the same for every propagator: free flight, in closed form but for the search for contacts.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..belief import Belief
from ..physics.compiled import inner, kernel
from ..physics.laws import FIRST
from ..physics.rollout import fresh_memory
from ..physics.step import march, workspace
from ..physics.world import Bodies, World
from ..scene import Scene


class FirstContacts(NamedTuple):
    """N equally probable flights.

    Attributes
    ----------
    states : (N, B, 13) array
        At the end; of a body that touched something, just after it did.
    stopped : (N, B) array
        Time at which each body first touched something [s]; infinite for one that flew to the end, or is fixed.
    first : (N, B, B + E) array
        Time of the first contact of bodies i < j, or of body i and element j - B [s]; infinite without one. Later than
        either body's time in ``stopped``, it is with one that stands where it touched something before.
    """

    states: np.ndarray
    stopped: np.ndarray
    first: np.ndarray


def first_contacts(scene: Scene, initial: Belief, steps: int, samples: int, seed: int = 0) -> FirstContacts:
    """Let samples of a belief fly until they touch something, for at most ``steps`` time steps."""
    states = initial.sample(samples, np.random.default_rng(seed))
    memory = fresh_memory(samples, scene.world)
    stopped = np.full(states.shape[:2], np.inf, memory.dtype)
    _fly(states, memory, stopped, scene.world, scene.world.laws, steps)
    return FirstContacts(states, stopped, memory[..., FIRST])


@kernel
def _fly(states, memory, stopped, world, laws, steps):
    """Advance the states in place; a body counts as fixed from the step on in which it touches something."""
    for n in range(len(states)):
        b = world.bodies
        moving = b.moving.copy()
        bodies = Bodies(moving, b.inverse_mass, b.inverse_inertia, b.radius, b.root, b.mass, b.inertia)
        own = World(bodies, world.tree, world.gravity, world.dt, world.decay, world.stiffness, world.stack_size, laws)
        work = workspace(states[n], own, laws)
        for step in range(steps):
            march(states[n], memory[n], own, laws, step, 1, work)
            if _stop(memory[n], moving, stopped[n]) == 0:
                break


@inner
def _stop(memory, moving, stopped):
    """Stop the bodies that touched something; returns how many still move."""
    left = 0
    for i in range(len(moving)):
        if not moving[i]:
            continue
        time = np.float32(np.inf)
        for j in range(memory.shape[1]):
            time = min(time, memory[i, j, FIRST])
        for j in range(i):
            time = min(time, memory[j, i, FIRST])
        if time < np.inf:
            stopped[i] = time
    for i in range(len(moving)):
        moving[i] = moving[i] and stopped[i] == np.inf
        left += moving[i]
    return left
