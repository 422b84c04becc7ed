"""Scenes with the implicit integrator through the whole library: materials, stiffness, islands, answers."""

import json
from dataclasses import replace

import numpy as np
import pytest
import yaml
from example_scenes import CONTENTS
from plain_scenes import ball

from unc_physics import Plane, RigidBody, Scene, make_propagator, predict
from unc_physics.__main__ import main
from unc_physics.checks.errors import NotSupportedError
from unc_physics.prediction.request_checks import check_supported
from unc_physics.scene.belief import Belief
from unc_physics.scene.parameters import vary
from unc_physics.scene.physics_summary import physics_as_text, physics_of

R = 0.03  # m, the ball's radius
BALL = ball(R)
G = 9.81


def state(*position, velocity=(0.0, 0.0, 0.0)):
    """A state (13,) in the identity's orientation."""
    return np.concatenate([position, velocity, (0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0)])


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
    end = predict(
        scene, Belief.exact([state(0, 0, R, velocity=(speed, 0, 0))]), "sigma_points", time
    ).belief.mean[0]
    assert speed - end[3] == pytest.approx(
        expected * G * round(time / scene.dt) * scene.dt, rel=0.01, abs=1e-6
    )


@pytest.mark.parametrize(
    "own, floor, expected",
    [(0.6, None, 0.6), (0.9, 0.4, 0.6), (None, 0.4, 0.6), (0.5, 0.0, 0.0), (1.0, 1.0, 1.0)],
)
def test_restitution_is_the_geometric_mean_of_the_partners(own, floor, expected):
    """A ball flies at a wall and comes back."""
    scene = on_floor(
        RigidBody("ball", BALL, 0.5, restitution=own),
        floor=Plane(restitution=floor),
        gravity=None,
        restitution=0.9 if own is None else 0.6,
    )
    end = predict(
        scene, Belief.exact([state(0, 0, R + 0.01, velocity=(0, 0, -1))]), "sigma_points", 0.1
    ).belief.mean[0]
    assert end[5] == pytest.approx(expected, rel=0.02, abs=0.02)


def test_the_kernels_get_the_varied_materials():
    bodies = [RigidBody("a", BALL, 1.0, friction=0.4, friction_std=0.05), RigidBody("b", BALL, 1.0)]
    scene = replace(on_floor(*bodies, restitution_std=0.05), stiffness=1e9)
    np.testing.assert_array_equal(scene.world.implicit.friction, scene.materials.friction)
    np.testing.assert_array_equal(scene.world.implicit.restitution, scene.materials.restitution)
    world = vary(scene, np.array([1.0, -2.0]))  # the scene's restitution, a's friction
    np.testing.assert_allclose(world.implicit.friction, [0.4 * np.exp(-2.0 * 0.05 / 0.4), 0.5, 0.5])
    np.testing.assert_allclose(world.implicit.restitution, [0.15, 0.15, 0.15])


# -- islands -----------------------------------------------------------------------------------------


def two_apart(**options):
    bodies = [RigidBody("left", BALL, 1.0, friction=0.3), RigidBody("right", BALL, 1.0, restitution=0.7)]
    scene = on_floor(*bodies, RigidBody("post", BALL, fixed=True, **options), islands=True)
    mean = np.array(
        [
            state(-1, 0, R + 0.01, velocity=(0.3, 0, 0)),
            state(1, 0, R + 0.01, velocity=(-0.2, 0, 0)),
            state(0, 0, R),
        ]
    )
    return scene, Belief(mean, np.tile(1e-6 * np.eye(12), (2, 1, 1)), scene.moving)


@pytest.mark.parametrize("options", [{}, {"friction": 0.5, "friction_std": 0.1}])
def test_islands_have_the_materials_of_their_bodies(options):
    scene, belief = two_apart(**options)
    propagator = make_propagator("monte_carlo", samples=20)
    apart, joint = (predict(s, belief, propagator, 0.3) for s in (scene, replace(scene, islands=False)))
    assert apart.scene.stiffness == joint.scene.stiffness
    np.testing.assert_array_equal(apart.samples(), joint.samples())


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


def test_monte_carlo_alone_rejects():
    scene = on_floor(RigidBody("ball", BALL, 1.0), overlap="reject")
    with pytest.raises(NotSupportedError, match="^overlap .*monte_carlo.*sigma_points.*'reject'"):
        predict(scene, Belief.exact([state(0, 0, 1)]), "sigma_points", 0.1)
    check_supported(scene, make_propagator("monte_carlo"))
