"""Friction and restitution of bodies, elements and scenes: whose value counts, what varies, is refused."""

import numpy as np
import pytest
from example_scenes import CONTENTS

from unc_physics import Box, Capsule, Cylinder, Plane, RigidBody, Scene, Sphere
from unc_physics.checks.errors import (
    InvalidEnvironmentError,
    InvalidOptionError,
    InvalidRequestError,
    NotFiniteError,
    UncPhysicsError,
)
from unc_physics.physics.everyday.columns import FRICTION, RESTITUTION
from unc_physics.scene.contact_world import variation
from unc_physics.scene.material_table import MATERIALS
from unc_physics.scene.scene_file import scene_from_dict

ROUND = [(shape, {"radius": 1, "length": 1}) for shape in (Cylinder, Capsule)]
FLOOR = {"plane": {"normal": [0, 0, 1], "offset": -3.0}}


@pytest.fixture(scope="module")
def model(loaded):
    """A packing of ten spheres."""
    return loaded("two_bodies").scene.bodies[0].model


def implicit(bodies, environment=(), **options):
    options = {"gravity": (0.0, 0.0, 0.0)} | options
    return Scene(bodies, environment=environment, integrator="implicit", **options)


def test_a_surface_has_its_own_values_or_else_the_scene_s(model):
    bodies = [
        RigidBody("a", model, 1.0, friction=0.2),
        RigidBody("b", model, 1.0, restitution=0.9),
        RigidBody("c", model, fixed=True),
    ]
    surroundings = [Plane(friction=0.0), Box((1, 1, 1), friction=1.5, restitution=0.3)]
    scene = implicit(bodies, surroundings, friction=0.5, restitution=0.1)
    assert scene.surfaces == (*bodies, *surroundings)
    np.testing.assert_array_equal(scene.materials.friction, [0.2, 0.5, 0.5, 0.0, 1.5])
    np.testing.assert_array_equal(scene.materials.restitution, [0.1, 0.9, 0.1, 0.1, 0.3])


def test_where_nothing_is_said_implicit_is_plastic_and_explicit_elastic(model):
    bodies = [RigidBody("a", model, 1.0, friction=0.2)]
    scene = implicit(bodies, [Plane()])
    np.testing.assert_array_equal(scene.materials.friction, [0.2, 0.0])
    np.testing.assert_array_equal(scene.materials.restitution, [0.0, 0.0])
    scene = Scene([RigidBody("a", model, 1.0)], gravity=(0.0, 0.0, 0.0), environment=[Plane()])
    np.testing.assert_array_equal(scene.materials.friction, [0.0, 0.0])
    np.testing.assert_array_equal(scene.materials.restitution, [1.0, 1.0])


BAD = [
    ({"friction": -0.1}, "friction"),
    ({"restitution": 1.1}, "restitution"),
    ({"restitution": -0.1}, "restitution"),
    ({"friction": 0.5, "friction_std": -0.1}, "friction_std"),
    ({"friction_std": 0.1}, "friction_std"),
    ({"friction": 0.0, "friction_std": 0.1}, "friction_std"),
    ({"friction": 0.5, "friction_std": 0.6}, "friction_std"),
    ({"restitution_std": 0.1}, "restitution_std"),
    ({"restitution": 0.5, "restitution_std": 1.1}, "restitution_std"),
]


@pytest.mark.parametrize("options, field", BAD)
def test_bad_materials_are_named(model, options, field):
    with pytest.raises((InvalidRequestError, NotFiniteError), match=f"{field} of body 'a'"):
        RigidBody("a", model, 1.0, **options)
    for element, size in ((Plane, {}), (Box, {"size": (1, 1, 1)}), (Sphere, {"radius": 1}), *ROUND):
        with pytest.raises((InvalidEnvironmentError, NotFiniteError), match=field):
            element(**size, **options)
    with pytest.raises(UncPhysicsError, match=field):
        implicit([RigidBody("a", model, 1.0)], **options)


NEEDS_IMPLICIT = [
    ({"friction": 0.5}, "friction"),
    ({"restitution": 0.9}, "restitution"),
    ({"restitution": 1.0, "restitution_std": 0.1}, "restitution_std"),
]


@pytest.mark.parametrize("options, field", [*NEEDS_IMPLICIT, ({"sleep": True}, "sleep")])
def test_a_scene_with_the_explicit_step_has_none(model, options, field):
    with pytest.raises(InvalidOptionError, match=rf"^{field} .*implicit"):
        Scene([RigidBody("a", model, 1.0)], **options)
    with pytest.raises(InvalidOptionError, match=rf"^{field} .*implicit"):
        scene_from_dict(CONTENTS["two_bodies"]() | options)


@pytest.mark.parametrize("options, field", NEEDS_IMPLICIT)
def test_bodies_and_elements_with_the_explicit_step_have_none(model, options, field):
    with pytest.raises(InvalidOptionError, match=rf"bodies\[1\]\.{field} .*implicit"):
        Scene([RigidBody("a", model, 1.0), RigidBody("b", model, 1.0, **options)])
    with pytest.raises(InvalidOptionError, match=rf"environment\[0\]\.{field} .*implicit"):
        Scene([RigidBody("a", model, 1.0)], environment=[Plane(**options)])


@pytest.mark.parametrize(
    "options",
    [
        {"friction": 0, "restitution": 1},
        {"friction": None, "restitution": None},
        {"friction": 0.0},
        {"restitution": 1.0},
    ],
)
def test_what_the_explicit_step_does_of_itself_may_be_said(model, options):
    scene = Scene(
        [RigidBody("a", model, 1.0, **options)],
        gravity=(0.0, 0.0, 0.0),
        environment=[Plane(**options)],
        **options,
    )
    assert not scene.materials.friction.any() and (scene.materials.restitution == 1.0).all()
    plain = scene_from_dict(CONTENTS["two_bodies"]() | options).scene
    assert plain.world.environment is None  # the paper's kernels, as without


def test_a_material_stands_for_what_is_not_given(model):
    """Its friction and restitution, with their standard deviations."""
    cardboard = MATERIALS["cardboard"]
    body = RigidBody("a", model, 1.0, material="cardboard")
    assert (body.friction, body.restitution) == (cardboard.friction, cardboard.restitution)
    assert body.friction_std == pytest.approx(2**0.5 * cardboard.friction_std)
    assert body.restitution_std == pytest.approx(2**0.5 * cardboard.restitution_std)
    body = RigidBody("a", model, 1.0, material="cardboard", friction=0.4)
    assert (body.friction, body.friction_std) == (0.4, 0.0) and body.restitution == cardboard.restitution
    content = CONTENTS["two_bodies"]() | {"physics": "everyday", "environment": [FLOOR]}
    del content["stiffness"]
    content["bodies"][0]["material"] = "wood"
    content["environment"] = [FLOOR | {"material": "steel", "restitution": {"mean": 0.2, "std": 0.05}}]
    scene = scene_from_dict(content).scene
    assert scene.bodies[0].friction == MATERIALS["wood"].friction
    floor = scene.environment[0]
    assert floor.friction == MATERIALS["steel"].friction and floor.friction_std > 0.0
    assert (floor.restitution, floor.restitution_std) == (0.2, 0.05)


@pytest.mark.parametrize("name", MATERIALS)
def test_a_contact_of_two_surfaces_of_a_material_varies_as_the_table_says(model, name):
    """Each surface has its own draw, and the contact the geometric mean of both."""
    scene, material = implicit([RigidBody(k, model, 1.0, material=name) for k in "ab"]), MATERIALS[name]
    draws = np.random.default_rng(1).standard_normal((4000, len(scene.uncertain)))
    of_surfaces = variation(scene, draws).materials
    friction, restitution = np.sqrt(of_surfaces[:, [FRICTION, RESTITUTION]].prod(axis=2)).T
    assert friction.std() == pytest.approx(material.friction_std, rel=0.1)
    assert restitution.std() == pytest.approx(material.restitution_std, rel=0.35)


@pytest.mark.parametrize("name", ["cardbord", "", 3])
def test_an_unknown_material_is_refused(model, name):
    with pytest.raises(InvalidRequestError, match="material of body 'a' must be one of aluminum, cardboard"):
        RigidBody("a", model, 1.0, material=name)
    content = {"environment": [FLOOR | {"material": name}], "bodies": CONTENTS["two_bodies"]()["bodies"]}
    with pytest.raises(InvalidEnvironmentError, match=r"environment\[0\].material must be one of"):
        scene_from_dict(content)


@pytest.mark.parametrize("name", MATERIALS)
def test_materials_are_within_the_limits_of_their_laws(model, name):
    body = RigidBody("a", model, 1.0, material=name)
    assert 0.0 < body.friction_std < body.friction and 0.0 < body.restitution_std < body.restitution < 1.0
