"""The anytime answer: rollouts until it is sure enough, and how sure it is."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from plain_scenes import independent, state

from unc_physics import Plane, RigidBody, Scene, assess, load_model, make_propagator, predict
from unc_physics.propagators.auto import Auto
from unc_physics.propagators.base import Spent, rollout_count
from unc_physics.propagators.emission import Group, Moments
from unc_physics.propagators.standard_errors import _wrapping, standard_errors
from unc_physics.spatial.moments import mean_and_errors, spread_states

NONE = np.empty(0)  # no probabilities are asked for


def answered(scene, belief, horizon=1.5, **options):
    return predict(scene, belief, make_propagator("auto", **options), horizon, times=[0.5])


@pytest.mark.parametrize("scene_name", ["two_bodies", "everyday"])
def test_it_is_the_cloud_of_as_many_rollouts(loaded, scene_name):
    """Batches that are simulated one after the other are the same rollouts as all at once, at all times."""
    scene, belief, _ = loaded(scene_name)
    found = answered(scene, belief, error=0.0, runs=50, seed=3)
    cloud = predict(scene, belief, make_propagator("cloud", runs=50, seed=3), 1.5, times=[0.5])
    assert len(found.carry.contact_history.first_time) == 50
    np.testing.assert_array_equal(found.samples(), cloud.samples())
    for one, other in zip(found.beliefs, cloud.beliefs, strict=True):
        np.testing.assert_array_equal(one.joint, other.joint)


def test_standard_errors_are_about_what_other_seeds_give(loaded):
    """The mean position over twelve scramblings, against the error that each claims."""
    scene, belief, _ = loaded("two_bodies")
    found = [predict(scene, belief, make_propagator("cloud", seed=k), 1.5) for k in range(12)]
    means = np.array([f.belief.mean[:, :3] for f in found])
    scatter = np.sqrt(means.var(axis=0, ddof=1).sum(axis=1))
    claimed = np.median([f.propagator.standard_errors(f.carry, scene).position for f in found], axis=0)
    assert ((0.3 * claimed < scatter) & (scatter < 2.0 * claimed)).all()


def test_no_more_rollouts_than_the_errors_ask_for(loaded):
    """By the root of their number: as many as 40 % less error needs, with what a twentieth more adds."""
    scene, belief, _ = loaded("two_bodies")
    first = answered(scene, belief, error=1.0, spread_error=0.0)
    error = first.propagator.standard_errors(first.carry, scene).position.max()
    found = answered(scene, belief, error=0.0, spread_error=0.0, position_error=0.8 * error)
    assert rollout_count(first.carry) == 32
    assert 40 <= rollout_count(found.carry) <= 32 * (1.05 / 0.8) ** 2 + 8


def test_the_spread_is_known_to_a_tenth(loaded):
    """By default, of each body, with 32 rollouts at least; over seeds it scatters by no more than that."""
    scene, belief, _ = loaded("two_bodies")
    found = [predict(scene, belief, make_propagator("auto", seed=k), 1.5) for k in range(12)]
    for one in found:
        errors = one.propagator.standard_errors(one.carry, scene)
        assert (errors.spread <= 0.1).all() and rollout_count(one.carry) >= 32
    spreads = np.array([np.sqrt(np.einsum("mii->m", one.belief.blocks[:, :3, :3])) for one in found])
    assert (spreads.std(axis=0, ddof=1) / spreads.mean(axis=0) < 0.13).all()


def test_standard_errors_of_spreads_without_a_surface_are_those_of_samples():
    """Of normal outcomes the relative error is 1 / sqrt(2 N), of a rare outlier it is that of its chance."""
    rng, count = np.random.default_rng(3), 400
    scale = np.concatenate([np.ones(count - 4), np.full(4, 30.0)])
    for errors, expected in (
        (rng.standard_normal((count, 12)), 1.0 / np.sqrt(2.0 * 3.0 * count)),
        (scale[:, None] * np.ones((count, 12)), 0.5 * np.sqrt(1.0 / 4.0)),
    ):
        found = _of_rollouts(errors, RigidBody("box", load_model("salt_box")))
        assert found.position_spread[0] == pytest.approx(expected, rel=0.15)
        assert found.rotation_spread[0] == pytest.approx(expected, rel=0.15)


def test_turns_about_the_axis_of_a_body_of_revolution_do_not_count():
    """One in a hundred outcomes turns: the spread of a box is unsure, that of a can is not."""
    rng, count = np.random.default_rng(3), 400
    errors = 0.1 * rng.standard_normal((count, 12))
    errors[:, 8] = 30.0 * (np.arange(count) < 4)
    model = load_model("can")
    box, uneven, can = (
        _of_rollouts(errors, body)
        for body in (
            RigidBody("box", load_model("salt_box")),
            RigidBody("uneven", model, inertia=model.inertia * np.diag([1.0, 1.1, 1.0])),
            RigidBody("can", model),
        )
    )
    for found, expected in ((box, 0.25), (uneven, 0.25), (can, 0.0)):
        assert found.rotation_spread[0] == pytest.approx(expected, rel=0.1, abs=1e-3)
        assert found.relative[0] == pytest.approx(0.05, rel=0.05)  # that of the position, or of both
    assert box.rotation[0] == can.rotation[0]


def test_a_can_needs_few_rollouts_though_it_may_roll_on_its_rim():
    """As accurate an angle about its axis takes 176 rollouts and more."""
    scene = Scene.everyday([RigidBody("can", load_model("can"))], exact=True, environment=[Plane()])
    belief = independent(state((0, 0, 0.055)), position=0.004, velocity=0.05, rotation=0.02, spin=0.1)
    found = predict(scene, belief, make_propagator("auto"), 1.0)
    assert rollout_count(found.carry) < 80 and not assess(found)[0].flags


def _of_rollouts(errors, body):
    """Standard errors of outcomes (N, 12) of one body, without a surface."""
    made = Moments(
        Group(b"", np.array([0]), np.array([0]), 0, np.zeros((12, 1)), False, False),
        None,
        np.zeros((1, 13)),
        errors,
        errors,
        1.0,
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("unc_physics.propagators.standard_errors.moments", lambda runs, scene: [made])
        patch.setattr("unc_physics.propagators.standard_errors._wrapping", lambda found: np.ones(1))
        return standard_errors(SimpleNamespace(mean=np.zeros((1, 13))), Scene([body]))


def test_an_end_before_the_goal_is_flagged(loaded):
    """By the time limit, or by the most rollouts; not where the goal was met."""
    scene, belief, _ = loaded("two_bodies")
    for options in ({"time": 1e-6}, {"runs": 12}):
        short = assess(predict(scene, belief, make_propagator("auto", **options), 1.5))
        assert all("ended before its accuracy was reached" in status.message for status in short)
    assert all("missed" not in status.message for status in assess(predict(scene, belief, "auto", 1.5)))


def test_time_is_kept_count(loaded, monkeypatch):
    """By a clock that says 10 ms for each rollout and none for all else: batches fit into what is left."""
    scene, belief, _ = loaded("two_bodies")
    auto = Auto(error=0.0, time=1.0)
    carry = auto.init(scene, belief)
    carry = auto.advance(carry, scene, 150)
    monkeypatch.setattr("unc_physics.propagators.auto.clock", lambda: 0.0)
    assert auto.additional_rollouts(carry, scene, Spent(0.12, 0.12, 1, NONE)) == 12
    assert auto.additional_rollouts(carry, scene, Spent(0.995, 0.12, 1, NONE)) == 0
    assert auto.additional_rollouts(carry, scene, Spent(0.97, 0.12, 1, NONE)) == 3


def test_a_mean_of_rotations_in_all_directions_is_less_sure(loaded):
    """Of samples of Monte Carlo: what leaving out parts tells is about what other samples give."""
    scene, belief, _ = loaded("two_bodies")
    found = predict(scene, belief, make_propagator("cloud", runs=64), 1.5)
    (fitted,) = found.carry.moments.values()
    count, rng = 64, np.random.default_rng(0)
    bodies = np.arange(len(fitted.mean))

    def drawn(spread):
        errors = np.zeros((count, 24))
        errors[:, 6:9], errors[:, 18:21] = spread * rng.standard_normal((2, count, 3))
        return mean_and_errors(spread_states(fitted.mean, bodies, errors), bodies)

    for spread, least, most in ((0.2, 1.0, 1.6), (1.4, 1.3, 20.0)):
        of, means = [], []
        for _ in range(20):
            mean, errors = drawn(spread)
            of.append(_wrapping(replace(fitted, mean=mean, errors=errors)))
            means.append(2.0 * np.arccos(np.abs((mean[:, 6:10] * fitted.mean[:, 6:10]).sum(axis=1))))
        actual = np.sqrt(np.mean(np.square(means))) / (np.sqrt(3.0) * spread / np.sqrt(count))
        assert least <= np.median(of) <= most
        assert 0.4 * actual < np.median(of) < 2.5 * actual
