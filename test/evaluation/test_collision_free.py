"""The paper's collision-free validation (its Table 2), by order and by size against the sampling floor."""

import numpy as np
import pytest

from unc_physics import PROPAGATORS, make_propagator, predict
from unc_physics.spatial.layout import POSITION, QUATERNION
from unc_physics_evaluation.scenarios import collision_free
from unc_physics_evaluation.wasserstein import euclidean, geodesic, wasserstein

TRUTH = 500
SEEDS = range(4)
METHODS = [name for name in PROPAGATORS if name != "monte_carlo"]
STATISTICS = 1.25  # a mean of four floors against another: they scatter by some 5 % each


@pytest.fixture(scope="module", params=["linear_velocity", "angular_velocity"])
def table(request):
    """(uncertain, W1 of every method and of the floor): position [m] or rotation [degrees], averaged over
    seeds.
    """
    scene, belief, horizon = collision_free(request.param)
    part, measure = (POSITION, euclidean) if request.param == "linear_velocity" else (QUATERNION, geodesic)

    def samples(count, seed):
        return predict(scene, belief, make_propagator("monte_carlo", samples=count, seed=seed), horizon)

    def distance(prediction, truth, seed):
        states = prediction.at().samples
        if states is None:
            states = prediction.belief.sample(TRUTH, np.random.default_rng(10_000 + seed))
        return wasserstein(states[:, 0, part], truth[:, 0, part], measure)

    truths = [samples(TRUTH, seed).carry.states for seed in SEEDS]
    rows = {"floor": [distance(samples(TRUTH, 100 + s), truths[s], s) for s in SEEDS]}
    for count in (10, 50, 100):
        rows[f"MC-{count}"] = [distance(samples(count, 200 + s), truths[s], s) for s in SEEDS]
    for name in METHODS:
        prediction = predict(scene, belief, name, horizon)
        rows[name] = [distance(prediction, truths[s], s) for s in SEEDS]
    return request.param, {name: float(np.mean(values)) for name, values in rows.items()}


@pytest.mark.parametrize("method", METHODS)
def test_methods_reach_the_floor(table, method):
    """No Gaussian method does worse than a second truth; 0.1 rad/s leaves rotations Gaussian within the
    floor.
    """
    _, w1 = table
    assert w1[method] <= STATISTICS * w1["floor"]
    assert w1[method] >= w1["floor"] / STATISTICS


def test_more_samples_are_better(table):
    _, w1 = table
    assert w1["MC-10"] > w1["MC-50"] > w1["MC-100"] > w1["floor"]


@pytest.mark.parametrize("method", METHODS)
def test_methods_beat_a_hundred_samples(table, method):
    """The order of the paper's first column."""
    _, w1 = table
    assert w1[method] < w1["MC-100"]
