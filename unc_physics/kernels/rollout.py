"""Rollouts of a batch of states: the only loop over samples, and the only parallel one."""

import threading

from numba import njit, prange

from .step import advance
from .world import World

# numba's workqueue threading layer aborts the process when two threads enter it at once
_one_at_a_time = threading.Lock()


@njit(cache=True, nogil=True, parallel=True)
def _advance_all(states, bodies, tree, gravity, constants, steps):
    # parallel loops take no tuples of tuples: the world comes in parts and is put together inside
    for n in prange(len(states)):
        world = World(bodies, tree, gravity, constants[0], constants[1], constants[2], constants[3])
        advance(states[n], world, steps)


def rollout(states, world, steps):
    """Advance a batch of states in place.

    Every rollout is computed by itself, so the result does not depend on the number of threads
    (`numba.set_num_threads`).

    Parameters
    ----------
    states : (N, B, 13) float64, C order
        One scene state per sample.
    world : World
    steps : int
    """
    if len(states) == 1:
        advance(states[0], world, steps)
    else:
        with _one_at_a_time:
            _advance_all(states, world.bodies, world.tree, world.gravity, world[3:], steps)
