"""Answers that agree with each other and with the world: samples, modes, probabilities, rare outcomes."""

import math

import numpy as np
import pytest
from plain_scenes import lowest

from unc_physics import (
    PROPAGATORS,
    Belief,
    BodyBelief,
    Box,
    BoxRegion,
    FellOff,
    InRegion,
    Plane,
    RigidBody,
    Scene,
    assess,
    load_model,
    make_propagator,
    predict,
)
from unc_physics.propagators.base import Samples, rollout_count
from unc_physics.propagators.overlap_depths import overlaps
from unc_physics.scene.scene_file import scene_from_dict

PUSH = {
    "physics": "everyday",
    "exact": True,
    "horizon": 1.0,
    "friction": 0.4,
    "environment": [
        {"name": "table", "box": {"size": [1.0, 0.6, 0.04], "position": [0, 0, -0.02]}},
        {"name": "ground", "plane": {"offset": -0.7}},
    ],
    "bodies": [
        {
            "name": "carton",
            "model": "salt_box",
            "spheres": 300,
            "position": [0.40, 0, 0.0612],
            "roll_pitch_yaw": [0, 0, 0.3],
            "linear_velocity": [0.80, 0, 0],
            "position_std": [0.005, 0.005, 0],
            "orientation_std": [0, 0, 0.05],
            "linear_velocity_std": [0.08, 0.02, 0],
        }
    ],
}
WITH_ROLLOUTS = [name for name, kind in PROPAGATORS.items() if issubclass(kind, Samples)]


@pytest.fixture(scope="module")
def pushed():
    """The tutorial's carton, which stays on the table or falls."""
    return scene_from_dict(PUSH)


@pytest.mark.parametrize("name", [name for name in WITH_ROLLOUTS if name in ("monte_carlo", "cloud", "auto")])
def test_modes_that_stay_have_the_probability_to_stay(pushed, name):
    """Both count the same rollouts: exactly, for every propagator that has some."""
    scene, belief, horizon = pushed
    options = {"samples": 100} if name == "monte_carlo" else {}
    falls = FellOff("carton", support="table")
    prediction = predict(scene, belief, make_propagator(name, **options), horizon)
    found = prediction.probability(falls)
    modes = prediction["carton"].modes
    assert len(modes) > 1, "the case must split"
    stay = sum(mode.weight for mode in modes if mode.mean[2] > 0.0)
    assert stay == pytest.approx(1.0 - found.estimate, abs=1e-12)
    assert found.method == "samples" and found.rollouts == rollout_count(prediction.carry)


def test_auto_goes_on_until_probabilities_of_all_bodies_are_known():
    """To a tenth by default, or as asked for; time may end it before, with an interval."""
    content = PUSH | {"horizon": 0.6}
    content["bodies"] = [
        PUSH["bodies"][0] | {"name": name, "position": [0.40, y, 0.0612]}
        for name, y in (("one", -0.2), ("other", 0.2))
    ]
    scene, belief, horizon = scene_from_dict(content)
    here = BoxRegion("here", (0.02, 1.0, 1.0), (0.5, 0, 0))
    events, widths = [FellOff("one", support="table"), InRegion("other", here)], []
    for options in ({}, {"probability_error": 0.05}, {"time": 1e-6}):
        found = predict(scene, belief, make_propagator("auto", **options), horizon, events=events)
        known = [found.probability(event) for event in events]
        widths.append(max(0.5 * (one.high - one.low) for one in known))
    assert widths[0] <= 3.29 * 0.03 < widths[1] <= 3.29 * 0.05 < widths[2]
    assert known[0].rollouts == 12


@pytest.mark.parametrize("name", ["cloud", "auto"])
def test_samples_reach_into_walls_no_deeper_than_rollouts(name):
    """A mug that slides and turns in a box that it barely fits into."""
    model = load_model("mug").prefix(300)
    half = model.bounding_radius + 4e-3
    wall = {"friction": 0.3}
    sides = [
        Box((0.02, 1.0, 0.4), (side * (half + 0.01), 0.0, 0.2), name=f"x{side}", **wall) for side in (-1, 1)
    ] + [Box((1.0, 0.02, 0.4), (0.0, side * (half + 0.01), 0.2), name=f"y{side}", **wall) for side in (-1, 1)]
    scene = Scene.everyday([RigidBody("mug", model)], exact=True, environment=[Plane(name="floor"), *sides])
    start = BodyBelief(
        position=(0.0, 0.0, 0.06),
        position_std=(3e-3, 3e-3, 2e-3),
        orientation_std=(0.1, 0.1, 0.5),
        linear_velocity=(0.3, 0.2, 0.0),
        linear_velocity_std=0.2,
        angular_velocity_std=2.0,
    )
    prediction = predict(scene, Belief.of(scene, {"mug": start}), name, 0.4)
    snapshot, scene = prediction.at(), prediction.scene
    rollouts = overlaps(scene, snapshot.rollout_states)[0].max()
    samples = overlaps(scene, prediction.samples())[0]
    assert (samples <= rollouts + 1e-4).all()
    states = prediction.samples()[:, 0]
    assert len(np.unique(states[:, 0])) > 1.5 * rollout_count(prediction.carry), (
        "most are samples of their own"
    )
    # they still spread as the rollouts do
    spread = states[:, :3].std(axis=0)
    np.testing.assert_allclose(spread, snapshot.rollout_states[:, 0, :3].std(axis=0), rtol=0.35, atol=1e-4)


def on_edge(distance):
    """A brick that lies with its centre of mass that many standard deviations from a table's edge."""
    model, std = load_model("brick").prefix(300), 0.004
    table = Box((0.8, 0.8, 0.02), (-0.4, 0.0, 0.39), name="table")
    body = RigidBody("brick", model, at_rest=True)
    scene = Scene.everyday([body], exact=True, environment=[Plane(name="floor"), table])
    height = 0.4 - lowest(model)
    start = BodyBelief(position=(-distance * std, 0.0, height), position_std=(std, std, 0.0))
    return scene, Belief.of(scene, {"brick": start}), std


def test_a_picture_holds_all_outcomes_that_it_draws(pushed):
    """Cartons that fell lie farther out than two standard deviations from the mean of all."""
    scene, belief, horizon = pushed
    prediction = predict(scene, belief, make_propagator("monte_carlo", samples=60, seed=0), horizon)
    assert len(prediction["carton"].modes) > 1
    drawn = 0
    for axes in prediction.plot().axes[:2]:
        (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
        for image in axes.images:
            one, other, below, above = image.get_extent()
            assert left <= one and other <= right and bottom <= below and above <= top
            drawn += 1
    assert drawn > 10


def test_a_rare_fall_is_flagged_or_simulated():
    """Of probability 0.5 %, which 32 rollouts miss six times in seven; not of one that never happens."""
    scene, belief, std = on_edge(2.6)
    rare = 0.5 * math.erfc(2.6 / math.sqrt(2.0))
    expected = math.hypot(std, math.sqrt(rare) * 0.4)  # down to the floor
    for seed in range(2):
        (cloud,) = assess(predict(scene, belief, make_propagator("cloud", seed=seed), 1.0))
        spread = math.sqrt(
            np.trace(predict(scene, belief, make_propagator("auto", seed=seed), 1.0).belief.blocks[0][:3, :3])
        )
        assert cloud.flags
        assert cloud.measures["rare_outcomes"] > 1.4 or cloud.measures["spread_error"] > 0.1
        assert expected / 1.8 < spread < 1.8 * expected
    scene, belief, std = on_edge(7.0)
    for name in ("cloud", "auto"):
        prediction = predict(scene, belief, name, 0.6)
        (status,) = assess(prediction)
        assert status.measures["rare_outcomes"] < 1.1 and not status.flags
        assert rollout_count(prediction.carry) <= 128


def test_nothing_is_judged_twice(pushed, monkeypatch):
    """Statuses of a prediction, of its slices and of its bodies come from one judgement."""
    scene, belief, horizon = pushed
    prediction = predict(scene, belief, make_propagator("cloud", runs=12), horizon, times=[0.5])
    first = assess(prediction)
    monkeypatch.setattr("unc_physics.prediction.diagnosis._judge", None)
    assert assess(prediction) == first == (prediction["carton"].status(),)
