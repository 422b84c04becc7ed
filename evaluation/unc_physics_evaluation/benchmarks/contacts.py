"""What happens in a rollout: how many contacts, and how long flight, near misses and contact take."""

from __future__ import annotations

import time
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numba import njit

from unc_physics.physics.layout import P
from unc_physics.physics.narrow_phase import next_contacts, open_pair
from unc_physics.physics.rollout import simulate
from unc_physics.physics.workspace import workspace

PHASES = ("flight", "near miss", "contact")


@njit(cache=True, nogil=True)
def _contacts(x, world):
    """Number of contacts at the state ``x`` (B, 13), and whether any two bodies' balls overlap."""
    work = workspace(x, world)
    total, near = 0, False
    for i in range(len(x)):
        for j in range(i + 1, len(x)):
            reach = world.bodies.radius[i] + world.bodies.radius[j]
            if np.sum((x[j, P : P + 3] - x[i, P : P + 3]) ** 2) >= reach * reach:
                continue
            near = True
            t_ij, slack, top = open_pair(x, i, j, world, work)
            while top > 0:
                count, top = next_contacts(world.tree, work.R_ij, t_ij, slack, work.search, top)
                total += count
    return total, near


class Course(NamedTuple):
    """A rollout, step by step.

    Attributes
    ----------
    states : (steps + 1, B, 13) array
        The initial state and that after each step.
    contacts : (steps,) array
        Number of contacts in each step.
    phase : (steps,) array
        Index into `PHASES`.
    """

    states: np.ndarray
    contacts: np.ndarray
    phase: np.ndarray


def course(scene, state, steps):
    """Follow one rollout from ``state`` (B, 13)."""
    states = np.empty((steps + 1, *state.shape))
    states[0] = state
    contacts, phase = np.empty(steps, int), np.empty(steps, int)
    for k in range(steps):
        states[k + 1] = states[k]
        simulate(states[k + 1 : k + 2], scene.world, 1)
        # a step's contacts are those at the pose it ends with: its kick changes velocities only
        contacts[k], near = _contacts(states[k + 1], scene.world)
        phase[k] = 2 if contacts[k] else int(near)
    return Course(states, contacts, phase)


def phase_times(scene, followed, repeats):
    """Wall time of each phase of a followed rollout (3,) [s]: the least of ``repeats`` runs of
    each stretch.
    """
    borders = np.flatnonzero(np.diff(followed.phase, prepend=-1, append=-1))
    times = np.zeros(len(PHASES))
    for start, stop in pairwise(borders):
        times[followed.phase[start]] += _least_time(scene, followed.states[start], stop - start, repeats)
    return times


def _least_time(scene, state, steps, repeats):
    """Of a stretch, without what a call costs."""
    return max(np.min([_time(scene, state, steps) - _time(scene, state, 0) for _ in range(repeats)]), 0.0)


def _time(scene, state, steps):
    x = state.copy()
    start = time.perf_counter()
    simulate(x[None], scene.world, steps)
    return time.perf_counter() - start
