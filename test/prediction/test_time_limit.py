"""A time limit holds within a step, and before the first one."""

import numpy as np
import pytest
from plain_scenes import independent, state

from unc_physics import Plane, RigidBody, Scene, load_model, make_propagator, predict
from unc_physics.checks.errors import PredictionTimeoutError
from unc_physics.compiler.time_limit import time_limit
from unc_physics.prediction import compute_budget
from unc_physics.propagators import rollouts

ALLOWED = 0.3  # s


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
    with pytest.raises(PredictionTimeoutError, match="before the first step") as caught:
        predict(scene, belief, "sigma_points", 0.5, max_computation_time=ALLOWED)
    assert caught.value.prediction is None


def certain_bricks():
    return *bricks(2, 60, 0.15), make_propagator("monte_carlo", samples=10)


def uncertain_bricks():
    return *bricks(2, 60, 0.15, friction_std=0.1), make_propagator("monte_carlo", samples=40)


@pytest.mark.parametrize("case", [certain_bricks, uncertain_bricks])
def test_what_was_done_until_then_is_kept_and_as_without_a_limit(case):
    scene, belief, propagator = case()

    def give_up(done, _):
        if done > 0:
            raise PredictionTimeoutError("ran out", field="max_computation_time")

    with pytest.raises(PredictionTimeoutError) as caught:
        predict(scene, belief, propagator, 1.0, progress=give_up)
    found = caught.value.prediction
    assert found is not None and 0.0 < found.time < 1.0
    again = predict(scene, belief, propagator, found.time)
    np.testing.assert_array_equal(found.belief.mean, again.belief.mean)
    np.testing.assert_array_equal(found.belief.covariance, again.belief.covariance)


@pytest.mark.parametrize(
    ("allowed", "spent", "ends_early", "std", "took", "expected"),
    [
        (None, 0.01, False, 0.0, 0.1, 50),  # a quarter of a second
        (2.0, 9.0, True, 0.0, 0.1, 50),
        (2.0, 0.3, True, 0.0, 0.1, 30),  # half of what was spent
        (None, 9.0, False, 0.0, 1e-3, 80),  # four times as many
        (None, 9.0, False, 0.0, 9.0, 1),
        (2.0, 0.01, True, 0.0, 0.1, 20),  # a twentieth of what is allowed
        (2.0, 1.0, False, 0.0, 0.1, 4),  # if kernels do not end early
        (None, 0.01, False, 0.1, 0.1, 16),  # eight times what was spent, of separate calls
        (None, 1e-3, False, 0.1, 0.1, 4),
        (2.0, 1.9, False, 0.1, 0.1, 16),  # four fifths of what is left
        (None, 9.0, False, 0.1, 1e-3, 640),
    ],
)
def test_pieces_take_a_share_of_the_time(monkeypatch, allowed, spent, ends_early, std, took, expected):
    """As many steps as take so long, where 20 steps took a given time."""
    monkeypatch.setattr(compute_budget, "clock", lambda: 100.0)
    scene, _ = bricks(1, 10, 0.0, friction_std=std)
    with time_limit() as limit:
        budget = compute_budget.ComputeBudget(allowed, 100.0 - spent, limit if ends_early else None)
        assert budget.next_piece(20, took, scene) == expected
    assert budget.over is (allowed is not None and spent > allowed)


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
