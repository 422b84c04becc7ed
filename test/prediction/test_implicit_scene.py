"""Scenes with the implicit integrator through the whole library: materials and answers."""

import json

import numpy as np
import pytest
import yaml
from example_scenes import CONTENTS
from plain_scenes import BALL, G, state

from unc_physics import Plane, RigidBody, Scene, predict
from unc_physics.__main__ import main
from unc_physics.scene.belief import Belief
from unc_physics.scene.physics_summary import physics_as_text, physics_of

R = 0.05  # m, the ball's radius


def on_floor(*bodies, floor=None, **options):
    return Scene.everyday(bodies, exact=True, environment=[floor or Plane(name="floor")], **options)


# -- materials ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "own, floor, expected", [(0.4, None, 0.4), (0.9, 0.1, 0.3), (None, 0.1, np.sqrt(0.02)), (0.5, 0.0, 0.0)]
)
def test_friction_is_the_geometric_mean_of_the_partners(own, floor, expected):
    """A ball that slides, but does not yet roll, is braked by mu g."""
    scene = on_floor(
        RigidBody("ball", BALL, 0.5, friction=own),
        floor=Plane(friction=floor),
        friction=0.2 if own is None else 0.4,
    )
    speed, time = 4.0, 0.1
    belief = Belief.exact([state((0, 0, R), (speed, 0, 0))])
    end = predict(scene, belief, "sigma_points", time).belief.mean[0]
    assert speed - end[3] == pytest.approx(
        expected * G * round(time / scene.dt) * scene.dt, rel=0.01, abs=1e-6
    )


# -- files and the command ---------------------------------------------------------------------------


def test_the_command_says_which_physics(tmp_path, capsys):
    content = CONTENTS["two_bodies"]() | {
        "physics": "everyday",
        "exact": True,
        "environment": [{"plane": {"normal": [0, 0, 1], "offset": -1.0}}],
    }
    for key in ("dt", "stiffness", "damping"):
        del content[key]
    path = tmp_path / "scene.yaml"
    path.write_text(yaml.safe_dump(content))
    assert main(["predict", str(path), "--horizon", "0.1", "--json", "--samples-out", "2"]) == 0
    answer = json.loads(capsys.readouterr().out)
    physics = answer["physics"]
    assert physics["integrator"] == "implicit" and physics["dt"] == 1.0 / 240.0 and physics["stiffness"] > 1e4
    assert physics["friction"] == 0.5 and physics["restitution"] == 0.1 and physics["gyroscopic"]
    assert physics["overlap"] == "project"
    assert np.shape(answer["bodies"][0]["samples"]) == (2, 13)
    assert main(["predict", str(path), "--horizon", "0.1"]) == 0
    assert capsys.readouterr().out.startswith("auto; implicit, dt 0.0041667 s, stiffness ")


def test_the_command_says_where_the_prediction_began(tmp_path, capsys):
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
    standing, flying, post = json.loads(capsys.readouterr().out)["bodies"]
    assert [body["at_rest"] for body in (standing, flying, post)] == [True, False, False]
    for key in ("position", "orientation", "linear_velocity", "angular_velocity"):
        assert len(standing["start"][key]) == len(standing[key])
    assert np.allclose(flying["start"]["position"], [0, 0, 1])
    assert np.allclose(flying["start"]["linear_velocity"], [0, 1, 0])
    assert flying["start"]["covariance"][0][0] == pytest.approx(0.01**2 + 0.02**2)
    assert post["start"]["covariance"] is None
    assert not np.any(standing["start"]["linear_velocity"])


@pytest.mark.parametrize("overlap", ["reject", "keep"])
def test_answers_name_what_becomes_of_overlap(overlap):
    scene = on_floor(RigidBody("ball", BALL, 1.0), overlap=overlap)
    assert physics_of(scene)["overlap"] == overlap
    assert f"overlap {overlap}" in physics_as_text(scene)
