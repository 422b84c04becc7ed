"""Random everyday scenes: bodies are counted as wrong, good and flagged by what is known of them."""

from types import SimpleNamespace

import numpy as np
import pytest

from unc_physics import make_propagator, predict
from unc_physics_evaluation.answers import Answer, Moments, count, distance
from unc_physics_evaluation.everyday_scenes import KINDS, scene_at_random
from unc_physics_evaluation.experiments import scenes_at_random
from unc_physics_evaluation.experiments.scenes_at_random import misses_goal
from unc_physics_evaluation.jobs import Job, Settings


def moments(position, rotation, shift=0.0, angle=0.0):
    """Of a body with these spreads over all axes, whose mean is moved along x and turned about x."""
    mean, P = np.zeros(13), np.zeros((12, 12))
    mean[0], mean[6], mean[9] = shift, np.sin(0.5 * angle), np.cos(0.5 * angle)
    P[0, 0], P[6, 6] = position**2, rotation**2
    return Moments(mean, P)


@pytest.mark.parametrize(
    "predicted, factor, mean_error",
    [
        (moments(0.01, 0.1), 1.0, 0.0),
        (moments(0.02, 0.1), 2.0, 0.0),
        (moments(0.01, 0.04), 2.5, 0.0),
        (moments(0.01, 0.1, shift=0.004), 1.0, 0.4),
        (moments(0.01, 0.1, angle=0.06), 1.0, 0.6),
        (moments(0.015, 0.1, shift=-0.02, angle=0.01), 1.5, 2.0),
    ],
)
def test_distances_are_those_of_known_moments(predicted, factor, mean_error):
    assert distance(predicted, moments(0.01, 0.1)) == pytest.approx((factor, mean_error))


def test_what_contacts_give_way_by_is_no_spread():
    assert distance(moments(1e-7, 1e-5), moments(4e-5, 0.0)) == (1.0, 0.0)


def test_bodies_are_counted_by_their_limits():
    """Between good and wrong counts for neither; what is no number is wrong."""
    cases = {
        "good": (1.2, 0.2, False, False, False),
        "good, flagged with the truth": (1.2, 0.2, True, False, False),
        "good, falsely flagged": (1.25, 0.25, True, True, True),
        "between": (1.4, 0.3, True, True, False),
        "wrong, flagged": (1.6, 0.0, True, False, False),
        "wrong, in its interval": (1.0, 0.6, False, False, True),
        "wrong, silent": (1.0, 0.51, False, False, False),
        "no number": (np.nan, 0.0, False, False, False),
    }
    found = count(Answer(*case) for case in cases.values())
    assert found == (8, 4, 2, 3, 1)


@pytest.mark.parametrize("number", range(len(KINDS)))
def test_each_kind_can_be_simulated_and_is_the_same_each_time(number):
    (scene, belief, horizon), again = scene_at_random(number), scene_at_random(number)
    np.testing.assert_array_equal(belief.mean, again.belief.mean)
    found = predict(scene, belief, make_propagator("monte_carlo", samples=4), horizon)
    assert np.isfinite(found.belief.mean).all() and found.belief.blocks.any()


def test_a_method_that_is_the_truth_is_right_and_unflagged(monkeypatch):
    """The same rollouts as the truth's: no factor, no shift, and no flag that the truth has not."""
    job = Job("scenes_at_random", Settings().parameters(scene=0, truth=64))
    monkeypatch.setattr(
        scenes_at_random,
        "METHODS",
        {"truth": ("monte_carlo", {"samples": 64}), "MC-3": ("monte_carlo", {"samples": 3})},
    )
    monkeypatch.setattr(Job, "seed", lambda job, purpose: 5)
    rows = [row._asdict() | {"scene": 0} for row in scenes_at_random.run(job).rows]
    found = scenes_at_random.answers(rows)
    (own,) = found["truth"]
    assert own.factor == 1.0 and own.mean_error < 1e-6 and own.good and not own.falsely
    (few,) = found["MC-3"]
    assert few.flagged and few.falsely and not few.good


def test_a_goal_is_missed_where_so_many_outcomes_would_miss_it():
    """One in a hundred lies 1 m away: a spread has a relative error of sqrt(99 / n) / 2."""
    states = np.zeros((10_000, 1, 13))
    states[..., 9] = 1.0
    states[:100, 0, 0] = 1.0
    truth = SimpleNamespace(at=lambda: SimpleNamespace(rollout_states=states))
    missed = [misses_goal(truth, 0, count, make_propagator("auto")) for count in (99, 2400, 2550)]
    assert missed == [True, True, False]
