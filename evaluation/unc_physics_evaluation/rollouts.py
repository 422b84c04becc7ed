"""Rollouts in every engine, including unc_physics, and the CPU time of their steps."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec

import numpy as np

from unc_physics.propagators.registry import make_propagator
from unc_physics.scene.belief import Belief
from unc_physics.scene.scene import Scene

from .engines import PEERS
from .methods import MONTE_CARLO, OURS, label

#: Names of the engines, and how they are written.
ENGINES = {name: label(name) for name in (OURS, *PEERS)}


def available() -> list[str]:
    """Return the installed engines."""
    return [name for name in ENGINES if name == OURS or find_spec(name) is not None]


def missing_engines(experiment: str) -> list[str]:
    """Return the missing engines, and how to install them."""
    absent = [name for name in ENGINES if name not in available()]
    return [f"{experiment} in {ENGINES[name]}: not installed; pip install {name}" for name in absent]


@contextmanager
def rollouts(engine: str, scene: Scene) -> Iterator[Callable[[np.ndarray, int], tuple[np.ndarray, float]]]:
    """Yield a function from states (N, B, 13) and a number of steps to final states and CPU time [s].

    Parameters
    ----------
    engine : str
        One of `ENGINES`.
    scene : Scene

    Notes
    -----
    The first call of unc_physics compiles or loads kernels. The time excludes setting and reading states,
    which other engines do body by body from Python.
    """

    if engine == OURS:
        yield _ours(scene)
        return
    peer = PEERS[engine](scene, "primitive")

    def theirs(states, steps):
        ends, spent = np.empty_like(states), 0.0
        for n, state in enumerate(states):
            peer.begin(state)
            started = time.process_time()
            peer.advance(steps)
            spent += time.process_time() - started
            ends[n] = peer.state()
        return ends, spent

    try:
        yield theirs
    finally:
        peer.close()


def _ours(scene):
    """Return the function of `rollouts` for unc_physics."""

    def run(states, steps):
        simulator = make_propagator(MONTE_CARLO, samples=len(states))
        belief = Belief.exact(states[0], scene.moving)
        carry = simulator.start_rollouts(scene, belief, states.copy())
        started = time.process_time()
        ends = simulator.advance(carry, scene, steps).states
        return ends, time.process_time() - started

    return run
