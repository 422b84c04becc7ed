"""Samples of an initial belief, each body of which runs until it first touches something.

What happens before that is the same for every propagator: free flight, in closed form but for the search for
contacts.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..belief import Belief
from ..physics import contact_history as histories
from ..physics.compiled import inner, kernel
from ..physics.explicit_step import integrate
from ..physics.workspace import workspace
from ..physics.world import Bodies, World
from ..scene import Scene


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
        Later than either body's time in ``stopped``, it is with one that stands where it touched something
        before.
    """

    states: np.ndarray
    stopped: np.ndarray
    first: np.ndarray


def first_contacts(scene: Scene, initial: Belief, steps: int, samples: int, seed: int = 0) -> FirstContacts:
    """Let samples of a belief fly until they touch something, for at most ``steps`` time steps."""
    states = initial.sample(samples, np.random.default_rng(seed))
    first = histories.fresh(samples, scene.world).first_time
    stopped = np.full(states.shape[:2], np.inf, first.dtype)
    _fly(states, first, stopped, scene.world, scene.world.surroundings, steps)
    return FirstContacts(states, stopped, first)


@kernel
def _fly(states, first, stopped, world, surroundings, steps):
    """Advance the states in place; a body counts as fixed from the step on in which it touches something."""
    for n in range(len(states)):
        b = world.bodies
        moving = b.moving.copy()
        bodies = Bodies(moving, b.mass, b.inertia, b.inverse_mass, b.inverse_inertia, b.radius, b.root)
        own = World(
            bodies,
            world.tree,
            world.gravity,
            world.dt,
            world.decay,
            world.stiffness,
            world.stack_size,
            surroundings,
            None,
        )
        work = workspace(states[n], own)
        for step in range(steps):
            integrate(states[n], first[n], own, surroundings, None, step, 1, work)
            if _stop(first[n], moving, stopped[n]) == 0:
                break


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
