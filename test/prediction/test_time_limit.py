"""A time limit holds within a step, and before the first one."""

import time

import numpy as np
import pytest
from plain_scenes import independent, state

from unc_physics import Plane, RigidBody, Scene, load_model, make_propagator, predict
from unc_physics.checks.errors import PredictionTimeoutError
from unc_physics.propagators import rollouts

ALLOWED = 0.3  # s
FAR = 1000.0  # s, a horizon that no machine reaches in that time


def bricks(count, spheres, apart, **physics):
    """Bricks one in another, whose steps take as long as their spheres are many."""
    brick = load_model("brick").prefix(spheres)
    bodies = [RigidBody(f"brick{k}", brick, 0.5) for k in range(count)]
    states = [state((apart * k, 0, 0.2)) for k in range(count)]
    scene = Scene.everyday(bodies, exact=True, environment=[Plane()], **physics)
    return scene, independent(*states, position=0.01, velocity=0.01, rotation=0.01, spin=0.01)


@pytest.mark.parametrize("overlap", ["project", "keep"])
def test_a_prediction_is_given_up_in_time_whatever_a_step_takes(overlap):
    scene, belief = bricks(6, 3000, 0.001, overlap=overlap)
    predict(*bricks(1, 10, 0.0, overlap=overlap), "sigma_points", 0.01)  # compiles
    started = time.perf_counter()
    with pytest.raises(PredictionTimeoutError, match="before the first step") as caught:
        predict(scene, belief, "sigma_points", 0.5, max_computation_time=ALLOWED)
    assert time.perf_counter() - started < 30.0  # minutes without a limit
    assert caught.value.prediction is None


def certain_bricks():
    return *bricks(2, 60, 0.15), make_propagator("monte_carlo", samples=10)


def uncertain_bricks():
    return *bricks(2, 60, 0.15, friction_std=0.1), make_propagator("monte_carlo", samples=40)


@pytest.mark.parametrize("case", [certain_bricks, uncertain_bricks])
def test_what_was_done_until_then_is_kept_and_as_without_a_limit(case):
    scene, belief, propagator = case()
    for allowed in (
        ALLOWED,
        10.0 * ALLOWED,
        100.0 * ALLOWED,
    ):  # on a busy machine the first step takes a while
        with pytest.raises(PredictionTimeoutError) as caught:
            predict(scene, belief, propagator, FAR, max_computation_time=allowed)
        if (found := caught.value.prediction) is not None:
            break
    assert found is not None and 0.0 < found.time < FAR
    again = predict(scene, belief, propagator, found.time)
    np.testing.assert_array_equal(found.belief.mean, again.belief.mean)
    np.testing.assert_array_equal(found.belief.covariance, again.belief.covariance)


def test_a_limit_that_is_not_reached_changes_nothing():
    scene, belief = bricks(2, 100, 0.12)
    free = predict(scene, belief, "sigma_points", 0.3)
    within = predict(scene, belief, "sigma_points", 0.3, max_computation_time=1e3)
    np.testing.assert_array_equal(free.belief.mean, within.belief.mean)
    np.testing.assert_array_equal(free.belief.covariance, within.belief.covariance)


def test_uncertain_parameters_are_predicted_in_few_pieces_that_are_looked_after(monkeypatch):
    """Each rollout of a piece is a call of its own, which takes as long as dozens of steps."""
    pieces, looks, whole = [], [], rollouts.recorded_varied

    def counted(states, history, scene, z, begin, stops):
        pieces.append(stops.steps[-1])
        return whole(states, history, scene, z, begin, stops)

    scene, belief, propagator = uncertain_bricks()
    free = predict(scene, belief, propagator, 1.0)
    monkeypatch.setattr(rollouts, "recorded_varied", counted)
    monkeypatch.setattr("unc_physics.prediction.driver.LOOK_UP_AFTER", 0.0)
    within = predict(
        scene,
        belief,
        propagator,
        1.0,
        max_computation_time=1e3,
        progress=lambda done, steps: looks.append(done),
    )
    assert sum(pieces) == 240 and len(pieces) <= 3
    assert all(looks.count(done) >= 3 for done in np.cumsum([0, *pieces[:-1]]))
    np.testing.assert_array_equal(free.belief.mean, within.belief.mean)
    np.testing.assert_array_equal(free.belief.covariance, within.belief.covariance)
