"""Rollouts of a batch of states: the only loop over samples, and the only parallel one."""

import threading

import numpy as np
from numba import njit, prange

from .laws import FIRST
from .step import advance
from .world import World

# numba's workqueue threading layer aborts the process when two threads enter it at once
_one_at_a_time = threading.Lock()


@njit(cache=True, nogil=True, parallel=True)
def _advance_all(states, memory, bodies, tree, gravity, constants, laws, begin, steps):
    # parallel loops take no tuples of tuples: the world comes in parts and is put together inside
    for n in prange(len(states)):
        world = World(bodies, tree, gravity, constants[0], constants[1], constants[2], constants[3], laws)
        advance(states[n], memory[n], world, laws, begin, steps)


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
        What each rollout remembers of its contacts (`fresh_memory`, `step.advance`); updated in place.
    world : World
    begin : int
        Number of steps before.
    steps : int
    """
    if len(states) == 1:
        advance(states[0], memory[0], world, world.laws, begin, steps)
    else:
        with _one_at_a_time:
            _advance_all(states, memory, world.bodies, world.tree, world.gravity, world[3:7], world.laws, begin, steps)


def simulate(states, world, steps):
    """Advance a batch of states (N, B, 13) in place, as rollouts that begin there."""
    rollout(states, fresh_memory(len(states), world), world, 0, steps)
