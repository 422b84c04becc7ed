"""The time of compilation is no prediction's time."""

import time

import numba
import numpy as np
import pytest

from unc_physics import Belief, RigidBody, Scene, load_model, predict
from unc_physics.compiler.compile_time import clock
from unc_physics.compiler.threads import in_threads
from unc_physics.propagators.monte_carlo import MonteCarlo


def fresh():
    """Compile something."""
    return numba.njit(lambda x: np.sort(x).sum())(np.arange(3.0))


@pytest.mark.parametrize("count", [1, 8])
def test_the_clock_stands_still(count):
    """Also while this thread waits for others that compile."""
    began, started = time.perf_counter(), clock()
    in_threads(count, lambda some: fresh())
    took, passed = clock() - started, time.perf_counter() - began
    assert 0.0 <= took < 0.3 * passed


def test_compiling_is_no_predictions_time(monkeypatch):
    """By the processor's time, which other processes do not add to."""
    monkeypatch.setattr(time, "perf_counter", time.process_time)

    class Compiling(MonteCarlo):
        def advance(self, carry, scene, steps):
            fresh()
            return super().advance(carry, scene, steps)

    mean = np.zeros((1, 13))
    mean[:, 9] = 1.0
    scene = Scene([RigidBody("pin", load_model("pin").prefix(10), 1.0)], dt=0.01, stiffness=1e4)
    belief = Belief.exact(mean)
    predict(scene, belief, MonteCarlo(samples=2), 0.5)
    began = time.perf_counter()
    prediction = predict(scene, belief, Compiling(samples=2), 0.5, max_computation_time=0.5)
    passed = time.perf_counter() - began
    assert prediction.wall_time < 0.5 * passed
