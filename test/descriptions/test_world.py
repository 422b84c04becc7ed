"""Surroundings and bodies from SDF and URDF, and the scene file that is made of them."""

import numpy as np
import pytest
from files import write_descriptions

from unc_physics import load_scene, load_world
from unc_physics.__main__ import main

pytest.importorskip("yourdfpy")
HALF = np.sqrt(0.5)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return write_descriptions(tmp_path_factory.mktemp("descriptions"))


@pytest.fixture(scope="module")
def kitchen(folder):
    return load_world(folder / "kitchen.sdf", spheres=8)


def test_what_does_not_move_is_the_environment(kitchen):
    found = {element.name: element for element in kitchen.environment}
    assert set(found) == {"floor", "table_0", "table_1", "bar", "gate"}
    np.testing.assert_allclose(found["floor"].normal, [0, 0, 1])
    assert (found["floor"].offset, found["floor"].friction) == (0.0, 0.7)
    top, leg, bar, gate = (found[name] for name in ("table_0", "table_1", "bar", "gate"))
    np.testing.assert_allclose(top.position, [1.0, 2.1, 0.7], atol=1e-12)
    np.testing.assert_allclose(top.size, [1, 0.5, 0.04])
    np.testing.assert_allclose(np.abs(top.orientation), [0, 0, HALF, HALF], atol=1e-12)
    np.testing.assert_allclose(leg.position, [1.0, 2.0, 0.34], atol=1e-12)
    assert (leg.radius, leg.length, bar.radius, bar.length) == (0.03, 0.68, 0.1, 0.4)
    np.testing.assert_allclose(bar.rotation[:, 2], [1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(gate.position, [0, 5, 1.5], atol=1e-12)


def test_meshes_are_fixed_bodies_and_what_is_free_moves(kitchen):
    lump, ball = kitchen.bodies
    assert (lump.name, lump.fixed, ball.name, ball.fixed) == ("lump", True, "ball", False)
    assert (ball.mass, ball.restitution) == (0.2, 0.6)
    np.testing.assert_allclose(kitchen.beliefs["ball"].position, [1, 2, 0.8], atol=1e-9)


def test_all_that_is_left_out_is_named(kitchen):
    said = "\n".join(kitchen.left_out)
    assert len(kitchen.left_out) == 4
    assert "table_2: a heightmap is no shape that is known here" in said
    assert "door: is held by joints (hinge)" in said
    assert "odd: relative_to" in said
    assert "include model://nowhere: is not found" in said


def test_a_robot_is_fixed_as_far_as_no_joint_moves_it(folder):
    done = []
    arm = load_world(folder / "arm.urdf", progress=lambda *counts: done.append(counts))
    base, post = arm.environment
    assert (base.shape, post.shape, post.name) == ("box", "cylinder", "post")
    np.testing.assert_allclose(post.position, [0, 0, 0.3], atol=1e-12)
    assert done == [(k, 5) for k in range(5)]
    assert arm.left_out == (
        "post: a shape that is not read: cone",
        "hand: moves with the joint turn",
        "visual_only: moves with the joint tip",
    )


def test_at_a_configuration_all_of_it_is_fixed(folder):
    world = load_world(folder / "arm.urdf", spheres=5, configuration={"turn": np.pi / 2, "tip": 0.1})
    knob = next(element for element in world.environment if element.shape == "sphere")
    np.testing.assert_allclose(knob.position, [0, 0.3, 0.55], atol=1e-12)
    brick = next(element for element in world.environment if element.name == "hand_0")
    np.testing.assert_allclose(brick.position, [0, 0.1, 0.55], atol=1e-7)  # 0.1 m along the hand
    assert not world.bodies, "a mesh of a box is a box"


def test_import_writes_a_scene_that_can_be_predicted(folder, tmp_path, capsys):
    out = tmp_path / "kitchen.yaml"
    assert main(["import", str(folder / "kitchen.sdf"), "-o", str(out), "-n", "8"]) == 0
    shown = capsys.readouterr().out
    assert "5 elements of the environment and 2 bodies, 1 of which move" in shown
    assert "left out: door" in shown
    scene, belief, horizon = load_scene(out)
    assert [body.name for body in scene.bodies] == ["lump", "ball"]
    assert scene.environment[0].name == "floor"
    np.testing.assert_allclose(belief.mean[1, :3], [1, 2, 0.8], atol=1e-9)
    assert horizon == 1.0
