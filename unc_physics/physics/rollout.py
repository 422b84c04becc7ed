"""Rollouts of a batch of states: the only loop over samples."""

import numpy as np

from .compiled import kernel
from .laws import FIRST
from .step import march, workspace
from .threads import in_threads


def fresh_memory(count, world):
    """(count, B, B + E, 2) float32: the memory of rollouts that begin."""
    bodies = len(world.bodies.moving)
    memory = np.zeros((count, bodies, bodies + (0 if world.laws is None else len(world.laws.kind)), 2), np.float32)
    memory[..., FIRST] = np.inf
    return memory


def rollout(states, memory, world, begin, steps):
    """Advance a batch of states in place.

    Every rollout is computed by itself, so the result does not depend on the number of threads
    (`numba.set_num_threads`).

    Parameters
    ----------
    states : (N, B, 13) float64, C order
        One scene state per sample.
    memory : (N, B, B + E, 2) float32, C order
        What each rollout remembers of its contacts (`fresh_memory`, `advance`); updated in place.
    world : World
    begin : int
        Number of steps before.
    steps : int
    """
    in_threads(len(states), lambda some: advance(states[some], memory[some], world, world.laws, begin, steps))


def simulate(states, world, steps):
    """Advance a batch of states (N, B, 13) in place, as rollouts that begin there."""
    rollout(states, fresh_memory(len(states), world), world, 0, steps)


@kernel
def advance(states, memory, world, laws, begin, steps):
    """Advance states (N, B, 13) in place, and what their rollouts remember of contacts along.

    ``memory`` (N, B, B + E, 2) float32 is as `laws.FIRST` and `laws.RATE` say, with pairs of bodies i < j and elements of
    the environment behind the bodies; ``begin`` counts the steps before; ``laws`` are those of the world.
    """
    for n in range(len(states)):
        march(states[n], memory[n], world, laws, begin, steps, workspace(states[n], world, laws))
