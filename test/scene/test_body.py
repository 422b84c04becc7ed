"""A body's mass: the one given, or else its model's own."""

from dataclasses import replace

import numpy as np
import pytest
from example_scenes import CONTENTS

from unc_physics import RigidBody, Scene, UncPhysicsError, load_model, save_packing
from unc_physics.scene.scene_file import scene_from_dict

PIN = load_model("pin").prefix(10)
WITHOUT_MASS = replace(PIN, name="pebble", mass=None)


def test_a_body_without_a_mass_takes_its_models_own():
    assert RigidBody("a", PIN).mass == PIN.mass
    assert RigidBody("a", PIN.scaled(2.0)).mass == 8.0 * PIN.mass
    assert (
        RigidBody("a", PIN, 0.3).mass == replace(RigidBody("a", PIN, 0.3), model=PIN.scaled(2.0)).mass == 0.3
    )


def test_no_mass_anywhere_is_refused_but_for_fixed_bodies():
    with pytest.raises(
        UncPhysicsError, match="mass of body 'a' must be given, since model 'pebble'"
    ) as found:
        RigidBody("a", WITHOUT_MASS)
    assert found.value.code.name == "INVALID_MASS"
    assert RigidBody("a", WITHOUT_MASS, fixed=True).fixed


def test_a_name_instead_of_a_model_is_refused_with_the_function_that_loads_it():
    with pytest.raises(UncPhysicsError, match=r"must be a SpherePacking, as load_model\('pin'\) returns"):
        RigidBody("a", "pin")  # pyright: ignore[reportArgumentType]


def test_a_scene_file_needs_no_mass_where_the_model_has_one(tmp_path):
    content = CONTENTS["two_bodies"]()
    body = content["bodies"][1]
    del body["mass"]
    assert (
        scene_from_dict(content).scene.bodies[1].mass == load_model(body["model"]).scaled(body["scale"]).mass
    )
    save_packing(tmp_path / "pebble.npz", WITHOUT_MASS)
    body["model"] = "pebble.npz"
    with pytest.raises(UncPhysicsError, match=r"bodies\[1\]\.mass must be given, since model 'pebble'"):
        scene_from_dict(content, folder=tmp_path)


def test_a_bodys_inertia_in_place_of_its_models():
    assert (RigidBody("a", PIN).unit_inertia == PIN.inertia).all()
    tensor = np.array([[2e-3, 1e-4, 0.0], [1e-4, 3e-3, 0.0], [0.0, 0.0, 2.5e-3]])
    moments = [1e-3, 2e-3, 2.5e-3]
    for given, expected in ((2e-3, 2e-3 * np.eye(3)), (moments, np.diag(moments)), (tensor, tensor)):
        body = RigidBody("a", PIN, 2.0, inertia=given)
        np.testing.assert_array_equal(body.unit_inertia, expected)
        np.testing.assert_array_equal(Scene([body]).world.bodies.inertia[0], 2.0 * expected)
    content = CONTENTS["two_bodies"]()
    content["bodies"][0]["inertia"] = [1e-3, 2e-3, 2.5e-3]
    body = scene_from_dict(content).scene.bodies[0]
    np.testing.assert_array_equal(body.unit_inertia, np.diag([1e-3, 2e-3, 2.5e-3]))


@pytest.mark.parametrize(
    "inertia, problem",
    [
        (-1.0, "has a principal moment that is not positive"),
        ([1.0, 1.0, 3.0], "belongs to no solid"),
        ([1.0, 2.0], "must have shape"),
        (np.nan, "finite"),
    ],
)
def test_what_is_no_inertia_is_refused(inertia, problem):
    with pytest.raises(UncPhysicsError, match=f"inertia of body 'a'.*{problem}"):
        RigidBody("a", PIN, inertia=inertia)
