"""Predictions as text and as plain values."""

import json
import re

import pytest
from plain_scenes import BALL, independent, state

from unc_physics import Plane, RigidBody, Scene, make_propagator, predict
from unc_physics.prediction.tables import FEW_LINES


@pytest.fixture(scope="module")
def prediction(loaded):
    scene, belief, _ = loaded("two_bodies")
    times = [0.01 * k for k in range(1, 31)]
    return predict(scene, belief, make_propagator("monte_carlo", samples=3), times=times)


def test_a_prediction_prints_as_a_table(prediction):
    lines = str(prediction).splitlines()
    assert len(lines) <= FEW_LINES and lines[0].startswith("monte_carlo; explicit")
    assert lines[1] == "... 23 earlier times are not shown" and lines[-4].startswith("t = 0.3 s")
    left, right = lines[-2:]
    assert left.startswith("left ") and right.startswith("right ")
    assert f"{prediction['left'].position[0]:.4f}" in left
    assert len(str(prediction[:1]).splitlines()) == 5


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


def test_a_spread_beyond_the_scene_has_a_reason_in_place_of_a_pose():
    """Two balls that bounce in a box for a minute, which stretches the linear map, not rollouts."""
    walls = [Plane(normal, -1.0) for normal in ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0))]
    scene = Scene(
        [RigidBody("a", BALL.scaled(4.0), 1.0), RigidBody("b", BALL.scaled(4.0), 1.0)],
        stiffness=1e5,
        dt=0.005,
        environment=walls,
        gravity=(0, 0, 0),
    )
    states = state((0.5, 0.1, 0), (1.0, 0.3, 0)), state((-0.5, 0, 0), (-0.7, 0.4, 0))
    belief = independent(*states, position=0.01)
    text = str(predict(scene, belief, "linearization", 60.0))
    assert re.search(
        r"^a +no pose: the standard deviation of \S+ m exceeds the size of the scene, \d", text, re.MULTILINE
    )
    text = str(predict(scene, belief, make_propagator("monte_carlo", samples=5), 60.0))
    assert "no pose" not in text
    assert "no pose" not in str(predict(scene, belief, "linearization", 0.2))
