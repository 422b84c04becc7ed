"""A time limit holds within a step, and before the first one."""

from dataclasses import replace

import numpy as np
import pytest
from plain_scenes import BALL, independent, state

from unc_physics import Plane, RigidBody, Scene, load_model, make_propagator, predict
from unc_physics.checks.errors import PredictionTimeoutError
from unc_physics.compiler.time_limit import time_limit
from unc_physics.prediction import compute_budget, driver
from unc_physics.propagators import rollouts
from unc_physics.propagators.start import constrain_belief, draw, resolve_initial_overlap

BELIEF = {"position": 0.01, "velocity": 0.01, "rotation": 0.01, "spin": 0.01}


def bricks(count, **physics):
    """Bricks that overlap on a floor."""
    bodies = [RigidBody(f"brick{k}", load_model("brick").prefix(20), 0.5) for k in range(count)]
    scene = Scene.everyday(bodies, exact=True, environment=[Plane()], **physics)
    return scene, independent(*(state((0.15 * k, 0, 0.2)) for k in range(count)), **BELIEF)


def uncertain_balls():
    """Balls that meet by explicit steps, whose rollouts are separate calls."""
    scene = Scene([RigidBody(name, BALL, 1.0, mass_std=0.1) for name in "ab"])
    return scene, independent(state(), state((0.2, 0, 0), (-0.2, 0, 0)), **BELIEF)


@pytest.mark.parametrize("overlap", ["project", "keep"])
def test_a_prediction_is_given_up_whatever_a_piece_takes(monkeypatch, overlap):
    """One piece of 24 million steps ends within its kernels."""
    monkeypatch.setattr(driver, "first_piece", lambda scene: 10**9)
    scene, belief = bricks(2, overlap=overlap)
    with pytest.raises(PredictionTimeoutError, match="before the first step") as caught:
        predict(scene, belief, "sigma_points", 1e5, max_computation_time=0.3)
    assert caught.value.prediction is None


@pytest.mark.parametrize("case", [lambda: bricks(2), uncertain_balls], ids=["implicit", "separate calls"])
def test_what_was_done_until_then_is_kept_and_as_without_a_limit(case):
    (scene, belief), propagator = case(), make_propagator("monte_carlo", samples=10)

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
    ("allowed", "spent", "ends_early", "separate", "took", "expected"),
    [
        (None, 0.01, False, False, 0.1, 50),  # a quarter of a second
        (2.0, 9.0, True, False, 0.1, 50),
        (2.0, 0.3, True, False, 0.1, 30),  # half of what was spent
        (None, 9.0, False, False, 1e-3, 80),  # four times as many
        (None, 9.0, False, False, 9.0, 1),
        (2.0, 0.01, True, False, 0.1, 20),  # a twentieth of what is allowed
        (2.0, 1.0, False, False, 0.1, 4),  # if kernels do not end early
        (None, 0.01, False, True, 0.1, 16),  # eight times what was spent, of separate calls
        (None, 1e-3, False, True, 0.1, 4),
        (2.0, 1.9, False, True, 0.1, 16),  # four fifths of what is left
        (None, 9.0, False, True, 1e-3, 640),
    ],
)
def test_pieces_take_a_share_of_the_time(monkeypatch, allowed, spent, ends_early, separate, took, expected):
    """As many steps as take so long, where 20 steps took a given time."""
    monkeypatch.setattr(compute_budget, "clock", lambda: 100.0)
    scene, _ = uncertain_balls() if separate else bricks(2, friction_std=0.1)
    with time_limit() as limit:
        budget = compute_budget.ComputeBudget(allowed, 100.0 - spent, limit if ends_early else None)
        assert budget.next_piece(20, took, scene) == expected
    assert budget.over is (allowed is not None and spent > allowed)


def test_a_limit_that_is_not_reached_changes_nothing():
    scene, belief = bricks(2)
    free = predict(scene, belief, "sigma_points", 0.3)
    within = predict(scene, belief, "sigma_points", 0.3, max_computation_time=1e3)
    np.testing.assert_array_equal(free.belief.mean, within.belief.mean)
    np.testing.assert_array_equal(free.belief.covariance, within.belief.covariance)


def test_separate_calls_are_few_pieces_that_are_looked_after(monkeypatch):
    """Each rollout of a piece is a call of its own, which takes as long as dozens of steps."""
    pieces, looks, whole = [], [], rollouts.recorded_varied

    def counted(states, history, scene, z, begin, steps):
        pieces.append(steps[-1])
        return whole(states, history, scene, z, begin, steps)

    (scene, belief), propagator = uncertain_balls(), make_propagator("monte_carlo", samples=40)
    free = predict(scene, belief, propagator, 1.0)
    monkeypatch.setattr(rollouts, "recorded_varied", counted)
    monkeypatch.setattr("unc_physics.prediction.driver.LOOK_UP_AFTER", 0.0)
    limits = {"max_computation_time": 1e3, "progress": lambda done, steps: looks.append(done)}
    within = predict(scene, belief, propagator, 1.0, **limits)
    assert sum(pieces) == 100 and len(pieces) <= 3
    assert all(looks.count(done) >= 3 for done in np.cumsum([0, *pieces[:-1]]))
    np.testing.assert_array_equal(free.belief.mean, within.belief.mean)
    np.testing.assert_array_equal(free.belief.covariance, within.belief.covariance)


def of_beginnings():
    """Bricks above each other in the floor, and bricks that are at rest above it."""
    scene, belief = bricks(3)
    inside = independent(*(state((0.02 * k, 0, 0.01)) for k in range(3)), **BELIEF)
    bodies = [replace(body, at_rest=True) for body in scene.bodies]
    resting = Scene.everyday(bodies, exact=True, environment=[Plane()])
    return {"overlap": (scene, inside), "rest": (resting, constrain_belief(resting, belief))}


@pytest.mark.parametrize("name", ["overlap", "rest"])
def test_removal_of_overlap_and_settling_end_within_their_time(name):
    """Of a thousand samples none is moved after the time, and all are within it."""
    scene, belief = of_beginnings()[name]
    drawn = belief.sample(1000, np.random.default_rng(0))
    with time_limit() as limit:
        limit.flag[0] = 1
        none = resolve_initial_overlap(scene, belief, drawn)[0]
    every = resolve_initial_overlap(scene, belief, drawn)[0]
    assert (none != drawn).any(axis=(1, 2)).sum() == 0
    assert (every != drawn).any(axis=(1, 2)).sum() == 1000


def test_the_rejection_of_overlap_ends_within_its_time(monkeypatch):
    """Bricks of which few draws are free are not drawn again after the time."""
    scene, belief = bricks(2, overlap="reject")
    draws, sample = [], type(belief).sample

    def counted(self, count, rng):
        draws.append(count)
        return sample(self, count, rng)

    monkeypatch.setattr(type(belief), "sample", counted)
    with time_limit() as limit:
        limit.flag[0] = 1
        draw(scene, belief, 1000, 0)
    assert draws == [1000]
