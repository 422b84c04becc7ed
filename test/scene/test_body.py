"""A body's mass: the one given, or else its model's own."""

from dataclasses import replace

import pytest
from example_scenes import CONTENTS

from unc_physics import RigidBody, UncPhysicsError, load_model, save_packing
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
