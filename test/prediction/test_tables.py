"""Predictions as text and as plain values."""

import json
from dataclasses import replace

import numpy as np
import pytest
import yaml
from example_scenes import CONTENTS
from plain_scenes import BALL, ball, state

from unc_physics import (
    Belief,
    BodyBelief,
    Box,
    ErrorCode,
    Plane,
    RigidBody,
    Scene,
    Tracker,
    make_propagator,
    predict,
    primitive_model,
)
from unc_physics.__main__ import main
from unc_physics.prediction.tables import FEW_LINES, as_table, why_no_pose


@pytest.fixture(scope="module")
def prediction(loaded):
    scene, belief, _ = loaded("two_bodies")
    times = [0.01 * k for k in range(1, 31)]
    return predict(scene, belief, make_propagator("monte_carlo", samples=3), times=times)


def test_a_prediction_prints_as_a_table(prediction):
    lines = str(prediction).splitlines()
    end = next(k for k, line in enumerate(lines) if line.startswith("t = 0.3 s"))
    assert end + 4 <= FEW_LINES and lines[0].startswith("monte_carlo; explicit")
    assert lines[1] == "... 23 earlier times are not shown"
    left, right = lines[end + 2 : end + 4]
    assert left.startswith("left ") and right.startswith("right ")
    assert f"{prediction['left'].position[0]:.4f}" in left
    # flags and their reasons follow
    status = prediction[:1]["left"].status()
    wanted = f"left: {status.flags}" if status.flags else "status: fine"
    assert str(prediction[:1]).splitlines()[5] == wanted


def test_texts_of_objects_are_one_line(prediction):
    scene = prediction.scene
    assert repr(scene) == "<Scene of 2 bodies (left, right) and 0 elements; explicit, dt 0.01 s>"
    shown = repr(scene.bodies[0])
    assert shown.startswith("RigidBody(name='left', model=") and "friction" not in shown
    assert repr(Box(size=(1, 2, 3), friction=0.2)).startswith("Box(friction=0.2, ") and "std" not in shown
    assert repr(prediction.initial) == "<Belief with means of 2 and covariances of 2 bodies>"
    assert repr(prediction) == "<Prediction of 2 bodies (left, right) by monte_carlo at 30 times>"
    of_left = prediction["left"]
    assert repr(of_left.status()).startswith(f"<BodyStatus 'left': {of_left.status().flags}")
    assert repr(of_left.modes[0]).startswith("<Mode of probability 1.000, position [")
    tracker = Tracker(scene, prediction.initial, members=16)
    assert repr(tracker) == "<Tracker of 2 bodies (left, right) at 0 s>"
    many = Scene([RigidBody(f"ball{k}", BALL, 1.0) for k in range(9)])
    assert "9 bodies (ball0, ball1, ball2, ball3, ...)" in repr(many)


def test_outcomes_follow_the_table_where_a_body_splits(tmp_path):
    """A tall box on its edge falls to one of two sides."""
    turn = np.array([0.0, np.sin(np.pi / 8), 0.0, np.cos(np.pi / 8)])
    box = primitive_model("box", size=(0.1, 0.4, 0.1))
    scene = Scene.everyday([RigidBody("box", box, 1.0)], environment=[Plane((0, 0, 1), 0.0)])
    given = BodyBelief(position=(0, 0, 0.0708), orientation=turn, orientation_std=(0, 0.05, 0))
    prediction = predict(
        scene, Belief.of(scene, {"box": given}), make_propagator("monte_carlo", samples=64), 1.0
    )
    lines = str(prediction).splitlines()
    assert "MEAN_NOT_POSSIBLE" in lines[4]
    (first,) = (k for k, line in enumerate(lines) if line == "box: 2 outcomes")
    weights = [float(line.split()[0]) for line in lines[first + 2 : first + 4]]
    assert sum(weights) == pytest.approx(1.0, abs=2e-3) and min(weights) > 0.2
    # no path leads to a mean between them
    paths = [axes.lines for axes in prediction.plot().axes]
    assert not any(len(line.get_xdata()) == 2 and line.get_zorder() == 4 for lines in paths for line in lines)


def test_a_notebook_shows_the_table(prediction):
    assert prediction._repr_html_().startswith("<pre>monte_carlo; explicit")


def test_a_plot_shows_each_body_from_two_sides(prediction, tmp_path):
    figure = prediction.plot("collision")
    assert len(figure.axes) == 2 and "collision" in figure.get_suptitle()
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert {"left", "right"} <= set(labels)
    figure.savefig(tmp_path / "plot.png")
    assert (tmp_path / "plot.png").stat().st_size > 10_000


def test_plain_values_are_those_of_the_command(prediction):
    found = json.loads(json.dumps(prediction.to_dict()))
    assert found["time"] == prediction.time and len(found["trajectory"]) == 30
    assert found["bodies"][0]["position"] == prediction["left"].position.tolist()


def test_hidden_lines_are_counted(prediction):
    """Of one time with more bodies than lines: the first ones are shown."""
    (lines,) = (as_table(prediction[:1], most).splitlines() for most in (4,))
    assert len(lines) == 4 and lines[-1] == "... 2 more bodies"
    assert as_table(prediction[:1], 5) == as_table(prediction[:1])
    assert len(as_table(prediction).splitlines()) == 1 + 30 * 4
    assert as_table(prediction, 10).splitlines()[1] == "... 28 earlier times are not shown"


@pytest.mark.parametrize(
    ("walls", "gravity", "velocity", "std", "size"),
    [
        ((), 0.0, 0.0, 0.0, 3.13),  # two balls of 5 and 8 cm that are 3 m apart
        ((5.0,), 0.0, 0.0, 0.0, 5.08),
        ((), 2.0, 0.0, 0.0, 3.13 + 4.0),
        ((), 2.0, 0.7, 0.0, 3.13 + 4.0 + 1.4),
        ((), 0.0, 0.7, 0.1, 3.13 + 1.4 + 0.1 + 0.2),
    ],
)
def test_a_spread_beyond_the_scene_has_a_reason_in_place_of_a_pose(walls, gravity, velocity, std, size):
    """Beyond the extent at the start, and what bodies may fly and be off in two seconds."""
    bodies = [RigidBody("a", BALL, 1.0), RigidBody("b", ball(0.08), 1.0), RigidBody("c", BALL, fixed=True)]
    environment = [Box((0.1, 0.1, 0.1), (0, x, 0)) for x in walls]
    scene = Scene(bodies, dt=0.1, gravity=(0, gravity, 0), environment=environment)
    states = [state((1, 0, 0), (0, 0, velocity)), state((4, 0, 0)), state((2, 0, 0))]
    P = np.zeros((2, 12, 12))
    P[0, 0, 0] = P[0, 5, 5] = std**2
    found = predict(scene, Belief(np.array(states), P, [0, 1]), "linearization", 2.0)
    for share, missing in ((0.995, False), (1.005, True)):
        wide = np.zeros((2, 12, 12))
        wide[1, 1, 1] = (share * size) ** 2
        belief = Belief(found.belief.mean, wide, [0, 1])
        one = replace(found, snapshots=(replace(found.at(), belief=belief),))
        assert [why_no_pose(one, 0, k) is not None for k in range(3)] == [False, missing, False]
        assert ("exceeds the size of the scene, " in str(one)) == missing
        assert why_no_pose(replace(one, propagator=make_propagator("sigma_points")), 0, 1) is None


def test_the_command_says_where_the_prediction_began_and_by_which_physics(tmp_path, capsys):
    body = {"model": "brick", "spheres": 60, "position_std": [0.01, 0.01, 0.0]}
    content = {
        "physics": "everyday",
        "exact": True,
        "horizon": 0.02,
        "common_pose_std": [0.02, 0, 0, 0, 0, 0],
        "environment": [{"plane": {"normal": [0, 0, 1]}}],
        "bodies": [
            body | {"name": "standing", "mass": 0.5, "position": [0, 0, 0.04], "at_rest": True},
            body | {"name": "flying", "mass": 0.5, "position": [0, 0, 1], "linear_velocity": [0, 1, 0]},
            {"name": "post", "model": "brick", "spheres": 60, "position": [1, 0, 0.1], "fixed": True},
        ],
    }
    path = tmp_path / "scene.yaml"
    path.write_text(yaml.safe_dump(content))
    assert main(["predict", str(path), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    standing, flying, post = answer["bodies"]
    physics = answer["physics"]
    assert (physics["integrator"], physics["dt"], physics["overlap"]) == ("implicit", 1.0 / 240.0, "project")
    assert [body["at_rest"] for body in (standing, flying, post)] == [True, False, False]
    for key in ("position", "orientation", "linear_velocity", "angular_velocity"):
        assert len(standing["start"][key]) == len(standing[key])
    assert np.allclose(flying["start"]["position"], [0, 0, 1])
    assert np.allclose(flying["start"]["linear_velocity"], [0, 1, 0])
    assert flying["start"]["covariance"][0][0] == pytest.approx(0.01**2 + 0.02**2)
    assert post["start"]["covariance"] is None
    assert not np.any(standing["start"]["linear_velocity"])


def test_the_command_adds_samples(tmp_path, capsys, loaded):
    """Those of a Gaussian are drawn with the prediction's seed."""
    path = tmp_path / "scene.yaml"
    path.write_text(yaml.safe_dump(CONTENTS["three_bodies"]()))
    command = ["predict", str(path), "--horizon", "0.3", "--propagator", "local_sampling", "--seed", "5"]
    assert main([*command, "--json", "--samples-out", "3"]) == 0
    prediction = predict(*loaded("three_bodies")[:2], make_propagator("local_sampling", seed=5), 0.3)
    expected = prediction.belief.sample(3, np.random.default_rng(5))
    for k, body in enumerate(json.loads(capsys.readouterr().out)["bodies"]):
        np.testing.assert_array_equal(body["samples"], expected[:, k])
    assert main([*command, "--samples-out", "3"]) == ErrorCode.INVALID_OPTION
    assert "--samples-out needs --json" in capsys.readouterr().err
