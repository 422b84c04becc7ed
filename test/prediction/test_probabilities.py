"""Probabilities of contact, of being in a region, and of being at rest; and when a propagator cannot tell
them.
"""

import json
from dataclasses import replace

import numpy as np
import pytest
from example_scenes import two_bodies
from scipy.stats import binomtest

from unc_physics import Belief, make_propagator, predict
from unc_physics.__main__ import main
from unc_physics.checks.errors import DuplicateIdError, InvalidEnvironmentError
from unc_physics.cli.predict_command import answers_as_table
from unc_physics.prediction.probabilities import (
    TOLERANCE,
    UNKNOWN,
    BoxRegion,
    ContactProbability,
    RestProbability,
    contact_probabilities,
    region_probabilities,
    rest_probabilities,
)
from unc_physics.scene.scene_file import scene_from_dict

FAR = 50.0  # m


def grazing(offset, sigma=0.05):
    """The two bodies, passing each other so that some touch."""
    content = two_bodies()
    content["bodies"][0]["position"][1] += offset
    for body in content["bodies"]:
        body["position_std"] = sigma
    return scene_from_dict(content)


def monte_carlo(samples=400, seed=1):
    return make_propagator("monte_carlo", samples=samples, seed=seed)


def test_monte_carlo_counts_its_samples():
    scene, belief, _ = grazing(0.7)
    prediction = predict(scene, belief, monte_carlo(), 2.0)
    (answer,) = contact_probabilities(prediction)
    first = prediction.carry.contact_history.first_time[:, 0, 1]
    touch = np.isfinite(first)
    assert 0.1 < touch.mean() < 0.9, "the case must leave it open"
    assert answer.available and answer.probability == pytest.approx(touch.mean())
    assert (answer.object_a, answer.object_b, answer.time_from_start) == ("left", "right", pytest.approx(2.0))
    assert answer.first_contact_time_available
    assert answer.first_contact_time_mean == pytest.approx(first[touch].mean())
    assert answer.first_contact_time_std == pytest.approx(first[touch].std())
    # those that touched have other velocities than free flight leaves
    free = belief.sample(400, np.random.default_rng(1))[:, :, 3:6] * np.exp(-scene.damping * 2.0)
    deflected = np.abs(prediction.carry.states[:, :, 3:6] - free).max(axis=(1, 2)) > 1e-9
    np.testing.assert_array_equal(deflected, touch)


def test_an_answer_comes_with_the_interval_of_its_draws():
    prediction = predict(*grazing(0.7)[:2], monte_carlo(), 2.0)
    (answer,) = contact_probabilities(prediction)
    touch = np.isfinite(prediction.carry.contact_history.first_time[:, 0, 1])
    expected = binomtest(int(touch.sum()), len(touch)).proportion_ci(0.999, "wilson")
    assert (answer.low, answer.high) == pytest.approx((expected.low, expected.high), abs=1e-4)
    for unknown in contact_probabilities(predict(*grazing(0.7)[:2], monte_carlo(10), 2.0)):
        assert (unknown.available, unknown.probability, unknown.low, unknown.high) == UNKNOWN


def test_few_samples_tell_only_what_is_clear():
    open_case, clear_case = grazing(0.7), grazing(FAR)
    for samples, tells_open, tells_clear in ((10, False, False), (100, False, True), (400, True, True)):
        for (scene, belief, _), tells in ((open_case, tells_open), (clear_case, tells_clear)):
            (answer,) = contact_probabilities(predict(scene, belief, monte_carlo(samples), 2.0))
            assert answer.available == tells
            assert tells or answer.probability is None


def test_first_contacts_answer_for_propagators_without_samples():
    """Whether bodies touch is decided in free flight; where they are after it is not."""
    scene, belief, _ = grazing(0.7)
    truth = predict(scene, belief, monte_carlo(4000), 2.0)
    prediction = predict(scene, belief, "linearization", 2.0)
    (told,), (right,) = contact_probabilities(prediction), contact_probabilities(truth)
    assert told.available and abs(told.probability - right.probability) < TOLERANCE
    assert told.first_contact_time_mean == pytest.approx(right.first_contact_time_mean, abs=0.02)
    region = BoxRegion("here", [1.0, 1.0, 1.0], prediction.belief.mean[0, :3])
    assert not any(answer.available for answer in region_probabilities(prediction, [region]))
    assert not any(answer.available for answer in rest_probabilities(prediction))
    # without flights there is nothing to tell it from
    assert not contact_probabilities(prediction, flights=0)[0].available
    assert contact_probabilities(prediction)[0] == told


def test_before_any_contact_everything_is_told():
    scene, belief, _ = grazing(FAR)
    prediction = predict(scene, belief, "linearization", 0.5)
    x = prediction.belief.mean[0, :3]
    half = BoxRegion("half", [100.0, 100.0, 100.0], x + [50.0, 0.0, 0.0])
    left, right = region_probabilities(prediction, [half])
    assert (left.object, right.object) == ("left", "right")
    assert left.available and left.probability == pytest.approx(0.5, abs=TOLERANCE)
    assert contact_probabilities(prediction)[0].probability == 0.0
    assert all(a.available and a.probability == 0.0 for a in rest_probabilities(prediction))
    slow = Belief(
        np.where(np.isin(np.arange(13), [3, 4, 5, 10, 11, 12]), 0.0, belief.mean), np.zeros((2, 12, 12))
    )
    prediction = predict(scene, slow, "linearization", 0.5)
    assert [a.probability for a in rest_probabilities(prediction)] == [1.0, 1.0]


def test_a_certain_prediction_is_certain_of_its_answers():
    scene, belief, _ = grazing(0.0)
    sure = Belief(belief.mean, np.zeros((2, 12, 12)))
    prediction = predict(scene, sure, "sigma_points", 2.0)
    (answer,) = contact_probabilities(prediction)
    assert answer.available and answer.low == answer.probability == answer.high == 1.0
    assert answer.first_contact_time_available and answer.first_contact_time_std == 0.0


def test_regions_are_boxes_in_any_pose():
    turned = BoxRegion("turned", [2.0, 0.2, 0.2], [1.0, 0.0, 0.0], [0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)])
    inside = turned.contains(
        np.array([[1.0, 0.9, 0.0], [1.9, 0.0, 0.0], [1.05, -0.9, 0.05], [1.0, 1.1, 0.0]])
    )
    assert inside.tolist() == [True, False, True, False]
    with pytest.raises(InvalidEnvironmentError, match="size"):
        BoxRegion("flat", [1.0, 0.0, 1.0])


def test_two_regions_of_one_name_are_refused():
    scene, belief, _ = grazing(FAR)
    prediction = predict(scene, belief, monte_carlo(100), 0.1)
    with pytest.raises(DuplicateIdError, match="bin"):
        region_probabilities(prediction, [BoxRegion("bin", [1, 1, 1]), BoxRegion("bin", [1, 1, 1])])


def test_islands_give_the_same_answers():
    scene, belief, _ = grazing(0.7)
    answers = [
        contact_probabilities(predict(own, belief, monte_carlo(), 2.0))
        for own in (scene, replace(scene, islands=True))
    ]
    assert answers[0] == answers[1]


def test_the_command_line_reports_probabilities(tmp_path, capsys):
    path = tmp_path / "scene.json"
    path.write_text(json.dumps(two_bodies()))  # YAML, too
    arguments = ["predict", str(path), "--propagator", "monte_carlo", "--samples", "100", "--probabilities"]
    assert main([*arguments, "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    (contact,) = content["contact_probabilities"]
    assert contact["object_a"] == "left" and contact["available"] and 0.0 < contact["probability"] <= 1.0
    assert [rest["object"] for rest in content["rest_probabilities"]] == ["left", "right"]
    assert main(arguments) == 0
    assert "left and right touch" in capsys.readouterr().out


def test_the_command_says_what_it_does_not_know():
    known, unknown = ContactProbability("a", "b", 1.0, True, 0.25), RestProbability("a", 1.0)
    few = answers_as_table({"contact_probabilities": [known], "rest_probabilities": [unknown]}).splitlines()
    assert few[:2] == ["a and b touch  0.250", "a is at rest       -"]
    assert few[2].startswith("-: not known") and "--samples 300" in few[2]
    many = answers_as_table(
        {"contact_probabilities": [known], "rest_probabilities": [unknown] * 50}
    ).splitlines()
    assert (
        many[0] == "a and b touch  0.250" and many[1].startswith("50 more are not known") and len(many) == 2
    )
