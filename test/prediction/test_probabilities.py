"""Probabilities of events: of contact, of being in a region, of being at rest, and of what combines them."""

import json

import numpy as np
import pytest
from example_scenes import two_bodies
from plain_scenes import BLOCK, G, state
from scipy.stats import binomtest, norm

from unc_physics import (
    AtRest,
    Belief,
    BodyBelief,
    BoxRegion,
    InRegion,
    Plane,
    RigidBody,
    Scene,
    Touches,
    Upright,
    load_model,
    make_propagator,
    predict,
)
from unc_physics.__main__ import main
from unc_physics.checks.errors import InvalidEnvironmentError, InvalidRequestError, PredictionTimeoutError
from unc_physics.cli.predict_command import probabilities_as_table
from unc_physics.prediction.snapshot import ContactTime, Probability
from unc_physics.scene.scene_file import scene_from_dict

TOUCH = Touches("left", "right")
HERE = BoxRegion("here", (1.0, 1.0, 1.0))


def grazing(offset, sigma=0.05):
    """The two bodies, passing each other so that some touch."""
    content = two_bodies()
    content["bodies"][0]["position"][1] += offset
    for body in content["bodies"]:
        body["position_std"] = sigma
    return scene_from_dict(content)


def monte_carlo(samples=400, seed=1):
    return make_propagator("monte_carlo", samples=samples, seed=seed)


@pytest.mark.parametrize("samples", [1, 10, 400])
def test_monte_carlo_counts_its_samples(samples):
    """With the interval of so many draws."""
    scene, belief, _ = grazing(0.7)
    prediction = predict(scene, belief, monte_carlo(samples), 2.0)
    found, when = prediction.probability(TOUCH), prediction.contact_time(TOUCH)
    first = prediction.carry.contact_history.first_time[:, 0, 1]
    touch = np.isfinite(first)
    assert samples < 400 or 0.1 < touch.mean() < 0.9, "the case must leave it open"
    interval = binomtest(int(touch.sum()), samples).proportion_ci(0.999, "wilson")
    assert (found.estimate, found.low, found.high) == pytest.approx((touch.mean(), *interval), abs=1e-4)
    assert (found.method, found.rollouts) == ("samples", samples)
    assert when == (pytest.approx((first[touch].mean(), first[touch].std())) if touch.any() else None)
    assert prediction.probability(Touches("right", "left")) == found
    # those that touched have other velocities than free flight leaves
    free = belief.sample(samples, np.random.default_rng(1))[:, :, 3:6] * np.exp(-scene.damping * 2.0)
    deflected = np.abs(prediction.carry.states[:, :, 3:6] - free).max(axis=(1, 2)) > 1e-9
    np.testing.assert_array_equal(deflected, touch)


def test_events_combine_rollout_by_rollout():
    scene, belief, _ = grazing(0.7)
    prediction = predict(scene, belief, monte_carlo(), 2.0)
    x = prediction.samples()
    touch = np.isfinite(prediction.carry.contact_history.first_time[:, 0, 1])
    half = BoxRegion("half", (100.0, 100.0, 100.0), prediction.belief.mean[0, :3] + [50.0, 0.0, 0.0])
    inside = half.contains(x[:, 0, :3])
    for event, expected in (
        (TOUCH & InRegion("left", half), touch & inside),
        (TOUCH | InRegion("left", half), touch | inside),
        (~(TOUCH & ~InRegion("left", half)), ~touch | inside),
    ):
        assert prediction.probability(event).estimate == pytest.approx(expected.mean())
    assert str(TOUCH & ~AtRest("left")) == "left touches right and not left at rest"
    either = TOUCH | AtRest("left")
    assert str(either & Upright("left")) == "(left touches right or left at rest) and left upright"
    assert str(~(TOUCH | AtRest("left"))) == "not (left touches right or left at rest)"


def test_events_with_the_same_arguments_are_equal():
    again = BoxRegion("here", (1.0, 1.0, 1.0))
    assert InRegion("left", HERE) == InRegion("left", again) and InRegion("left", HERE) != InRegion(
        "right", HERE
    )
    assert hash(InRegion("left", HERE)) == hash(InRegion("left", again))
    assert TOUCH == Touches("right", "left") and AtRest("left") != AtRest("left", speed=1.0) != Upright(
        "left"
    )
    assert TOUCH & AtRest("left") == TOUCH & AtRest("left") != TOUCH | AtRest("left")


def test_the_gaussian_answers_where_no_event_was_asked_for():
    """For an event that was, rollouts are simulated."""
    scene = Scene.everyday([RigidBody("can", load_model("can"))], environment=[Plane(name="table")])
    pose = BodyBelief(position=(0, 0, 0.055), position_std=(0.01, 0.01, 0), origin="model")
    belief = Belief.of(scene, {"can": pose})
    upright = Upright("can")
    alone = predict(scene, belief, "sigma_points", 0.2).probability(upright)
    found = predict(scene, belief, "sigma_points", 0.2, events=[upright]).probability(upright)
    assert alone.method == "gaussian" and alone.estimate > 0.99 and (alone.low, alone.high) == (0.0, 1.0)
    assert found.method == "samples" and found.estimate > 0.99 and found.low > 0.7


def test_rollouts_answer_for_propagators_without_samples():
    """Also about places after contacts, of which their Gaussian says nothing."""
    scene, belief, _ = grazing(0.7)
    truth = predict(scene, belief, monte_carlo(4000), 2.0)
    inside = InRegion("left", BoxRegion("here", (1.0, 1.0, 1.0), truth.belief.mean[0, :3]))
    prediction = predict(scene, belief, "linearization", 2.0, events=[TOUCH, inside])
    for event in (TOUCH, inside):
        found, right = prediction.probability(event), truth.probability(event)
        assert found.method == "samples" and found.low <= right.estimate <= found.high < found.low + 0.21
    assert prediction.contact_time(TOUCH).mean == pytest.approx(truth.contact_time(TOUCH).mean, abs=0.02)


@pytest.mark.parametrize(
    ("propagator", "std", "body", "physics", "simulated"),
    [
        ("linearization", 0.1, {}, {}, True),
        ("sigma_points", 0.1, {}, {"friction_std": 0.1}, True),
        ("sigma_points", 0.1, {"mass_std": 0.1}, {}, True),
        ("cloud", 0.1, {}, {}, False),
        ("auto", 0.1, {}, {}, False),
        ("monte_carlo", 0.1, {}, {}, False),
        ("sigma_points", 0.0, {}, {}, False),
        ("linearization", 0.1, {"fixed": True}, {}, False),
    ],
)
def test_rollouts_are_simulated_beside_predictions_without_samples(propagator, std, body, physics, simulated):
    """Unless there is one outcome."""
    model = load_model("can").prefix(20)
    scene = Scene.everyday(
        [RigidBody("can", model, 1.0, **body)], environment=[Plane(offset=-0.3)], exact=True, **physics
    )
    belief = Belief.of(scene, {"can": BodyBelief(position_std=0.0 if body.get("fixed") else std)})
    found = predict(scene, belief, propagator, 0.1, times=[0.05], events=[AtRest("can")])
    assert [snapshot.counted is not None for snapshot in found.snapshots] == [simulated] * 2
    assert predict(scene, belief, propagator, 0.1).at().counted is None


def test_rollouts_of_events_draw_friction():
    """A block slides v^2 / (2 mu g), beyond the distance for 0.8 mu if its friction is lower than this.

    The logarithm of its friction is normal with a standard deviation of ``std / mu``.
    """
    mu, std, speed = 0.4, 0.1, 1.0
    scene = Scene.everyday(
        [RigidBody("block", BLOCK, 0.4)],
        exact=True,
        environment=[Plane(name="floor")],
        friction=mu,
        friction_std=std,
    )
    belief = Belief.exact([state((0.0, 0.0, 0.02), (speed, 0.0, 0.0))])
    reach = speed**2 / (2.0 * 0.8 * mu * G)
    beyond = InRegion("block", BoxRegion("beyond", (2.0, 1.0, 1.0), (reach + 1.0, 0.0, 0.0)))
    found = predict(scene, belief, "sigma_points", 0.8, events=[beyond]).probability(beyond)
    assert found.method == "samples"
    assert found.estimate == pytest.approx(norm.cdf(np.log(0.8) * mu / std), abs=0.04)


def test_rollouts_of_events_keep_the_time_limit(monkeypatch):
    """Without time for them the answer stays, and nothing is known of the event."""
    scene, belief, _ = grazing(0.7)

    def too_long(*_):
        raise PredictionTimeoutError("ran out")

    monkeypatch.setattr("unc_physics.prediction.driver.Propagation.counted", too_long)
    found = predict(scene, belief, "sigma_points", 0.5, events=[TOUCH], max_computation_time=100.0)
    answer = found.probability(TOUCH)
    assert found.time == 0.5 and (answer.low, answer.high, answer.method) == (0.0, 1.0, "gaussian")


def test_a_certain_prediction_is_certain_of_its_answers():
    scene, belief, _ = grazing(0.0)
    sure = Belief(belief.mean, np.zeros((2, 12, 12)))
    prediction = predict(scene, sure, "sigma_points", 2.0)
    found = prediction.probability(TOUCH)
    assert found.low == found.estimate == found.high == 1.0 and found.method == "certain"
    assert prediction.contact_time(TOUCH).std == 0.0
    slow = Belief(
        np.where(np.isin(np.arange(13), [3, 4, 5, 10, 11, 12]), 0.0, belief.mean), np.zeros((2, 12, 12))
    )
    for propagator in ("linearization", monte_carlo(1)):
        found = predict(scene, slow, propagator, 0.5).probability(AtRest("left"))
        assert found.low == found.estimate == 1.0 and found.method == "certain"


def test_regions_are_boxes_in_any_pose():
    turned = BoxRegion("turned", [2.0, 0.2, 0.2], [1.0, 0.0, 0.0], [0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)])
    inside = turned.contains(
        np.array([[1.0, 0.9, 0.0], [1.9, 0.0, 0.0], [1.05, -0.9, 0.05], [1.0, 1.1, 0.0]])
    )
    assert inside.tolist() == [True, False, True, False]
    with pytest.raises(InvalidEnvironmentError, match="size"):
        BoxRegion("flat", [1.0, 0.0, 1.0])
    for name in ("", 3):
        with pytest.raises(InvalidRequestError, match="name of region must be a non-empty text"):
            BoxRegion(name, [1.0, 1.0, 1.0])


def test_the_command_line_reports_probabilities(tmp_path, capsys):
    path = tmp_path / "scene.json"
    path.write_text(json.dumps(two_bodies()))  # YAML, too
    arguments = ["predict", str(path), "--propagator", "monte_carlo", "--samples", "100", "--probabilities"]
    assert main([*arguments, "--json"]) == 0
    contact, *rests = json.loads(capsys.readouterr().out)["probabilities"]
    assert contact["event"] == "left touches right" and 0.0 < contact["estimate"] <= 1.0
    assert [rest["event"] for rest in rests] == ["left at rest", "right at rest"]
    assert main(arguments) == 0
    assert "left touches right" in capsys.readouterr().out


def test_the_command_says_of_what_nothing_is_known():
    known = TOUCH, Probability(0.25, 0.2, 0.3, "samples", 900), ContactTime(0.5, 0.1)
    unknown = AtRest("left"), Probability(0.5, 0.0, 1.0, "gaussian", 1), None
    few = probabilities_as_table([known, unknown]).splitlines()
    assert few[0] == "left touches right  0.250  (0.200 to 0.300)  first after 0.500 s, std 0.100 s"
    assert few[1] == "left at rest        0.500  (0.000 to 1.000)"
    assert few[2].startswith("(0.000 to 1.000): nothing is known") and "--samples 300" in few[2]
    many = probabilities_as_table([known, *[unknown] * 50]).splitlines()
    assert many[0] == few[0] and many[1].startswith("50 more (0.000 to 1.000)") and len(many) == 2
