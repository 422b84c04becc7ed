"""Islands: bodies that cannot touch are predicted by themselves, with the joint prediction's result."""

from dataclasses import replace

import numpy as np
import pytest
from example_scenes import two_bodies
from plain_scenes import independent, state

from unc_physics import PROPAGATORS, Belief, Plane, RigidBody, Scene, load_model, make_propagator, predict
from unc_physics.prediction.islands import IslandRunner
from unc_physics.scene.marks import whole
from unc_physics.scene.scene_file import scene_from_dict

ROUND_OFF = 1e-12
SURROUNDINGS = {"environment": [{"plane": {"normal": [0, 0, 1], "offset": -2.0}}], "gyroscopic": True}
HORIZON = 2.0  # s
# left and right, then both and the bunny that comes later, and what is by itself
ENDS = [[0, 1, 6], [2], [3], [4, 5]]


def crowd(spread=1.0, **physics):
    """Two bodies that collide, a third that meets them later, one that meets a fixed one, one alone, one
    certain.
    """
    content = two_bodies() | {"gravity": [0.0, 0.0, -1.0]} | physics
    std = {
        "position_std": 0.02 * spread,
        "linear_velocity_std": 0.01 * spread,
        "orientation_std": 0.02 * spread,
    }
    for body in content["bodies"]:
        body |= std
    content["bodies"] += [
        shape("alone", "pin", [0, 8, 0], linear_velocity=[0.3, 0, 0], angular_velocity=[1, 2, 3], **std),
        shape("certain", "pin", [0, -12, 0], linear_velocity=[0.3, 0, 0], angular_velocity=[1, 2, 3]),
        shape("post", "pin", [8, 0, 0], scale=12.0, fixed=True),
        shape("visitor", "bunny", [10.5, 0.2, 0], linear_velocity=[-2.5, 0, 0], **std),
        shape("late", "bunny", [0, -3.2, -0.5], linear_velocity=[0, 2.5, 0], **std),
    ]
    scene, belief, _ = scene_from_dict(content)
    return scene, belief


def shape(name, model, position, scale=8.0, **entries):
    return {
        "name": name,
        "model": model,
        "spheres": 10,
        "scale": scale,
        "mass": 1.0,
        "position": position,
    } | entries


def both(scene, belief, propagator, horizon=HORIZON, **options):
    """The joint prediction, and that by islands."""
    return tuple(
        predict(replace(scene, islands=on), belief, propagator, horizon, **options) for on in (False, True)
    )


def by_islands(scene, belief, propagator, horizon=HORIZON):
    """The carry of islands at the end."""
    steps = round(horizon / scene.dt)
    islands = IslandRunner(propagator, scene, [whole(steps, scene.dt)])
    return islands.advance(islands.init(belief), steps)


def test_islands_are_off_unless_asked_for():
    assert not Scene([RigidBody("pin", load_model("pin").prefix(10), 1.0)]).islands
    assert not scene_from_dict(two_bodies()).scene.islands
    assert scene_from_dict(two_bodies() | {"islands": True}).scene.islands


@pytest.mark.parametrize("physics", [{}, SURROUNDINGS], ids=["paper", "surroundings"])
def test_monte_carlo_is_the_joint_run_bit_for_bit(physics):
    scene, belief = crowd(**physics)
    joint, divided = both(scene, belief, make_propagator("monte_carlo", samples=20))
    np.testing.assert_array_equal(joint.belief.mean, divided.belief.mean)
    np.testing.assert_array_equal(joint.belief.covariance, divided.belief.covariance)
    np.testing.assert_array_equal(joint.carry.states, divided.carry.states)
    np.testing.assert_array_equal(
        joint.carry.contact_history.first_time, divided.carry.contact_history.first_time
    )
    assert (
        np.isfinite(joint.carry.contact_history.first_time).any(axis=0).sum() > 2
    )  # of all pairs, more than two touch


@pytest.mark.parametrize("name", ["linearization", "surrogate"])
def test_a_nominal_rollout_is_the_same_with_islands(name):
    scene, belief = crowd()
    joint, divided = both(scene, belief, name)
    np.testing.assert_allclose(divided.belief.mean, joint.belief.mean, rtol=0.0, atol=ROUND_OFF)
    np.testing.assert_allclose(divided.belief.joint, joint.belief.joint, rtol=0.0, atol=ROUND_OFF)
    np.testing.assert_array_equal(
        joint.carry.contact_history.first_time, divided.carry.contact_history.first_time
    )


@pytest.mark.parametrize("name", ["sigma_points", "local_sampling"])
def test_drawn_and_spread_points_agree_to_first_order_in_the_covariance(name):
    """Ten times smaller standard deviations make the difference a hundred times smaller, relative to the
    covariance.
    """
    off = []
    for spread in (1e-2, 1e-3):
        joint, divided = both(*crowd(spread), make_propagator(name))
        scale = np.abs(joint.belief.joint).max()
        if name == "sigma_points":
            off.append(np.abs(divided.belief.joint - joint.belief.joint).max() / scale)
        else:  # its draws differ, which leaves their statistical error
            assert np.abs(divided.belief.joint - joint.belief.joint).max() < 0.5 * scale
        moved = np.abs(divided.belief.mean - joint.belief.mean).max()
        assert moved < 2.0 * scale
    if off:
        assert off[1] < 0.05 * off[0]


@pytest.mark.parametrize("name", PROPAGATORS)
def test_islands_merge_when_bodies_meet(name):
    scene, belief = crowd(spread=0.3)
    options = {"samples": 10} if "samples" in PROPAGATORS[name].options() else {}
    propagator = make_propagator(name, **options)
    first = IslandRunner(propagator, scene, [whole(200, scene.dt)]).init(belief)
    assert [island.bodies.tolist() for island in first.islands] == [[k] for k in (0, 1, 2, 3, 5, 6)]
    found = [island.bodies.tolist() for island in by_islands(scene, belief, propagator).islands]
    assert [[k for k in island if k != 4] for island in found] == [
        [k for k in island if k != 4] for island in ENDS
    ]
    assert [4, 5] in found  # the fixed body is in the island of whom it may touch


def test_bodies_whose_beliefs_are_correlated_are_together():
    scene, belief = crowd()
    P = belief.joint.copy()
    P[24, 36] = P[36, 24] = 0.0
    a, b = 12 * 2, 12 * 4  # alone's and visitor's positions
    P[a, b] = P[b, a] = 0.5 * P[a, a]
    joined = IslandRunner(make_propagator("surrogate"), scene, [whole(1, scene.dt)]).init(
        Belief(belief.mean, P, belief.moving)
    )
    assert [island.bodies.tolist() for island in joined.islands] == [[0], [1], [2, 5], [3], [6]]


def test_a_certain_body_is_a_single_trajectory():
    scene, belief = crowd()
    carry = by_islands(scene, belief, make_propagator("sigma_points"))
    points = {
        tuple(island.bodies.tolist()): len(now.states)
        for island, now in zip(carry.islands, carry.carries, strict=True)
    }
    assert points[3,] == 1
    assert points[2,] == 2 * 9 + 1  # three positions, velocities and rotations
    linear = by_islands(scene, belief, make_propagator("linearization"))
    assert [now.root.shape[1] for now in linear.carries] == [27, 9, 0, 9]


@pytest.mark.parametrize("name", ["linearization", "surrogate", "sigma_points"])
def test_a_lone_body_flies_in_closed_form_as_step_by_step(name):
    scene, belief, _ = scene_from_dict(two_bodies() | {"gravity": [0.3, 0.0, -5.0]})
    mean = belief.mean.copy()
    mean[:, 0] *= 100.0
    joint, divided = both(scene, Belief(mean, belief.covariance), name, times=[0.37, 1.0])
    for a, b in zip(joint.beliefs, divided.beliefs, strict=True):
        np.testing.assert_allclose(
            b.mean, a.mean, rtol=0.0, atol=1e3 * ROUND_OFF if name != "sigma_points" else 1e-3
        )
        scale = np.abs(a.joint).max()
        np.testing.assert_allclose(
            b.joint, a.joint, rtol=0.0, atol=(1e-9 if name != "sigma_points" else 0.02) * scale
        )


def scattered(count, touching=()):
    """Bodies far from each other, but for those that follow one ahead of them closely."""
    pin = load_model("pin").prefix(10)
    scene = Scene([RigidBody(f"pin{k}", pin, 1.0) for k in range(count)], islands=True)
    x = 10.0 * np.arange(count)
    for k in touching:
        x[k] = x[k - 1] + 0.9 * pin.bounding_radius
    return scene, independent(*(state((own, 0, 0)) for own in x), position=0.01)


def states_of(carry):
    """States of single bodies that the rollouts advance."""
    return sum(now.states.shape[0] * now.states.shape[1] for now in carry.carries)


def test_scattered_bodies_cost_as_many_times_one():
    sigma_points = make_propagator("sigma_points")
    one, many, close = (
        states_of(by_islands(*scattered(*case), sigma_points, 0.1)) for case in ((1,), (64,), (64, [20]))
    )
    assert one == 2 * 3 + 1
    assert many == 64 * one
    assert close - many == 2 * (2 * 6 + 1) - 2 * one < 2 * one
    samples = make_propagator("monte_carlo", samples=10)
    assert states_of(by_islands(*scattered(64, [20]), samples, 0.1)) == 64 * 10


def test_shared_parameters_keep_all_bodies_together_also_in_additional_rollouts():
    """Uncertain friction of all surfaces: islands change nothing, and the points of rollouts are nested."""
    pin = load_model("pin").prefix(10)
    bodies = [RigidBody(name, pin, mass=1.0) for name in ("a", "b")]
    scene = Scene.everyday(bodies, environment=[Plane()], islands=True)
    assert scene.shared_parameters
    stds = dict.fromkeys(("position", "velocity", "rotation", "spin"), 0.01)
    belief = independent(state((0, 0, 0.3)), state((1, 0, 0.3)), **stds)
    auto = predict(scene, belief, make_propagator("auto", error=1e-3, runs=80), 0.05)
    cloud = predict(replace(scene, islands=False), belief, make_propagator("cloud", runs=80), 0.05)
    assert auto.snapshots[-1].rollout_states.shape[0] == 80
    np.testing.assert_array_equal(auto.snapshots[-1].rollout_states, cloud.snapshots[-1].rollout_states)
