"""What a scene file says about the physics arrives in the scene."""

import numpy as np
import pytest
import yaml
from example_scenes import CONTENTS

from unc_physics import load_model, load_scene
from unc_physics.checks.errors import InvalidModelError
from unc_physics.scene.environment import Box, Capsule, Cylinder, Plane, Sphere, element_names
from unc_physics.scene.physics_keys import PHYSICS_KEYS
from unc_physics.scene.scene_file import scene_from_dict

TURNED = [0.0, 0.0, 0.6, 0.8]
FLOOR = {"plane": {"normal": [0, 0, 1], "offset": -3.0}}
SURROUNDINGS = [
    {"plane": {"normal": [0, 0, 2], "offset": -0.5}},
    {"name": "wall", "box": {"size": [0.1, 2, 1], "position": [1, 0, 0.5], "orientation": TURNED}},
    {"box": {"size": [1, 1, 1]}},
    {"name": "knob", "sphere": {"radius": 0.05, "position": [0, 0, 2]}},
    {"cylinder": {"radius": 0.1, "length": 0.4, "position": [0, 1, 0], "orientation": TURNED}},
    {"capsule": {"radius": 0.1, "length": 0.4}},
]


def scene_with(**entries):
    return scene_from_dict(CONTENTS["two_bodies"]() | entries).scene


def test_elements_arrive_in_order_with_their_names(tmp_path):
    path = tmp_path / "scene.yaml"
    path.write_text(yaml.safe_dump(CONTENTS["two_bodies"]() | {"environment": SURROUNDINGS, "gravity": None}))
    floor, wall, block, knob, post, rail = elements = load_scene(path).scene.environment
    assert [type(element) for element in elements] == [Plane, Box, Box, Sphere, Cylinder, Capsule]
    assert element_names(elements) == ["plane_0", "wall", "box_2", "knob", "cylinder_4", "capsule_5"]
    np.testing.assert_array_equal(floor.normal, [0, 0, 1])
    assert floor.offset == -0.5
    np.testing.assert_array_equal(wall.size, [0.1, 2.0, 1.0])
    np.testing.assert_array_equal(wall.position, [1.0, 0.0, 0.5])
    np.testing.assert_allclose(wall.orientation, TURNED)
    np.testing.assert_array_equal(block.position, 0.0)
    np.testing.assert_array_equal(block.orientation, [0, 0, 0, 1])
    assert (knob.radius, post.radius, post.length) == (0.05, 0.1, 0.4)
    np.testing.assert_array_equal(knob.position, [0, 0, 2])
    np.testing.assert_array_equal(post.position, [0, 1, 0])
    np.testing.assert_allclose(post.orientation, TURNED)
    np.testing.assert_array_equal(rail.position, 0.0)


NULLABLE = [key for key in PHYSICS_KEYS if key != "overlap"]  # whose null would be read in two ways


@pytest.mark.parametrize(
    "entries",
    [
        {},
        dict.fromkeys((*NULLABLE, "environment", "common_pose_std", "common_pose_origin")),
        {"environment": []},
    ],
)
def test_what_a_file_does_not_name_is_not_there(entries):
    content = CONTENTS["two_bodies"]() | entries
    scene = scene_from_dict(content).scene
    assert scene.dt == 0.01 and scene.stiffness == 1e4 and not scene.gravity.any()
    assert scene.environment == () and scene.friction is None and scene.restitution is None
    assert not scene.gyroscopic and scene.integrator == "explicit"
    assert scene.overlap == "keep" and not any(body.at_rest for body in scene.bodies)
    assert scene.uncertain == () and scene.world.environment is None


def test_uncertain_parameters():
    """Each surface has its own draw, of the scene's spread of a contact where it has no value."""
    content = CONTENTS["everyday"]() | {
        "friction": 0.4,
        "friction_std": 0.05,
        "restitution": {"mean": 0.5, "std": 0.1},
        "gravity_direction_std": 0.02,
    }
    content["bodies"][0] |= {"friction": 0.3, "friction_std": 0.1, "restitution": None}
    content["bodies"][1] |= {"mass_std": 0.05, "center_of_mass_std": [0.0, 0.01, 0.02]}
    content["environment"] = [FLOOR | {"restitution": {"mean": 0.7, "std": 0.2}, "surface_tilt_std": 0.01}]
    scene = scene_from_dict(content).scene
    np.testing.assert_array_equal(scene.materials.friction, [0.3, 0.4, 0.4])
    np.testing.assert_array_equal(scene.materials.restitution, [0.5, 0.5, 0.7])
    found = {(parameter.name, parameter.body, parameter.axis): parameter.std for parameter in scene.uncertain}
    assert found == {
        ("gravity_direction", -1, 0): 0.02,
        ("gravity_direction", -1, 1): 0.02,
        ("mass", 1, 0): 0.05,
        ("center_of_mass", 1, 1): 0.01,
        ("center_of_mass", 1, 2): 0.02,
        ("friction", 0, 0): 0.1,
        ("restitution", 0, 0): pytest.approx(0.1 * 2**0.5),
        ("friction", 1, 0): pytest.approx(0.05 * 2**0.5),
        ("restitution", 1, 0): pytest.approx(0.1 * 2**0.5),
        ("friction", 2, 0): pytest.approx(0.05 * 2**0.5),
        ("restitution", 2, 0): 0.2,
        ("surface_tilt", 2, 0): 0.01,
        ("surface_tilt", 2, 1): 0.01,
    }


def test_overlap_is_projected_away_by_the_implicit_step_alone():
    everyday = CONTENTS["everyday"]()
    assert scene_from_dict(everyday).scene.overlap == "project"
    assert scene_with().overlap == scene_with(overlap="keep").overlap == "keep"
    assert scene_from_dict(everyday | {"overlap": "reject"}).scene.overlap == "reject"


def test_bodies_at_rest():
    content = CONTENTS["everyday"]()
    content["bodies"][0]["at_rest"] = True
    content["bodies"][1]["at_rest"] = None
    scene = scene_from_dict(content).scene
    assert [body.at_rest for body in scene.bodies] == [True, False]


@pytest.mark.parametrize("origin", [None, [0.2, 0.1, -3]])
def test_an_error_that_all_bodies_share(origin):
    std = [0.01, 0.02, 0, 3e-3, 0, 0.01]
    plain = scene_from_dict(CONTENTS["everyday"]())
    shared = scene_from_dict(CONTENTS["everyday"]() | {"common_pose_std": std, "common_pose_origin": origin})
    expected = plain.belief.with_common_pose_std(
        [0.01, 0.02, 0, 3e-3, 0, 0.01], (0, 0, 0) if origin is None else (0.2, 0.1, -3.0)
    )
    np.testing.assert_array_equal(shared.belief.mean, plain.belief.mean)
    np.testing.assert_array_equal(shared.belief.joint, expected.joint)
    assert not np.allclose(shared.belief.joint, plain.belief.joint)


@pytest.mark.parametrize("physics", ["everyday", "paper"])
def test_a_body_has_all_spheres_of_its_model_or_the_first_ones(physics):
    def count(**entries):
        body = {"name": "a", "model": "salt_box"} | entries
        return len(scene_from_dict({"physics": physics, "bodies": [body]}).scene.bodies[0].model)

    assert count() == count(spheres=None) == len(load_model("salt_box")) and count(spheres=123) == 123
    for value in ("auto", "many"):
        with pytest.raises(InvalidModelError, match="spheres must be"):
            count(spheres=value)
