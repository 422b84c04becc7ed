"""The time of compilation is no prediction's time."""

import time

import numpy as np
import pytest
from numba.core import event

from unc_physics import Belief, RigidBody, Scene, load_model, predict
from unc_physics.compiler.compile_time import clock
from unc_physics.compiler.threads import in_threads, watched
from unc_physics.propagators.monte_carlo import MonteCarlo

WORK, COMPILATION = 0.125, 8.0  # s


@pytest.fixture
def work(monkeypatch):
    """Function that lets time pass, also while something is compiled; the time stands still otherwise."""
    now = [100.0]
    monkeypatch.setattr(time, "perf_counter", lambda: now[0])

    def passes():
        now[0] += WORK
        with event.trigger_event("numba:compiler_lock"), event.trigger_event("numba:compiler_lock"):
            now[0] += COMPILATION

    return passes


@pytest.mark.parametrize("count", [1, 8, 200])
def test_the_clock_stands_still(count, work):
    """Also while this thread waits for others that compile, watched or not."""
    started = clock()
    in_threads(count, lambda some: None if some.start else work())
    assert clock() - started == WORK
    with watched(lambda: None):
        in_threads(count, lambda some: None if some.start else work())
    assert clock() - started == 2.0 * WORK


def test_compiling_is_no_predictions_time(work):
    calls = []

    class Compiling(MonteCarlo):
        def advance(self, carry, scene, steps):
            calls.append(steps)
            work()
            return super().advance(carry, scene, steps)

    mean = np.zeros((1, 13))
    mean[:, 9] = 1.0
    scene = Scene([RigidBody("pin", load_model("pin").prefix(10), 1.0)], dt=0.01, stiffness=1e4)
    prediction = predict(scene, Belief.exact(mean), Compiling(samples=2), 0.5, max_computation_time=7.0)
    assert sum(calls) == 50 and prediction.wall_time == WORK * len(calls)
