"""Physics by name, the integrator's names, a stiffness that is chosen, and what answers say of all that."""

import numpy as np
import pytest
from example_scenes import CONTENTS

from unc_physics import Box, Plane, RigidBody, Scene, auto_stiffness
from unc_physics.checks.errors import (
    InvalidHorizonError,
    InvalidOptionError,
    InvalidRequestError,
    LimitExceededError,
)
from unc_physics.physics.everyday.columns import FRICTION
from unc_physics.scene.contact_world import variation
from unc_physics.scene.physics_summary import physics_as_text, physics_of
from unc_physics.scene.presets import EXACT_PRESETS
from unc_physics.scene.scene import IMPACT_STDS
from unc_physics.scene.scene_file import scene_from_dict


@pytest.fixture(scope="module")
def model(loaded):
    """A packing of ten spheres."""
    return loaded("two_bodies").scene.bodies[0].model


def read(**entries):
    """The scene of a file with the bodies of `two_bodies` and these entries only."""
    return scene_from_dict({"bodies": CONTENTS["two_bodies"]()["bodies"]} | entries).scene


# -- presets -----------------------------------------------------------------------------------------

UNCERTAIN = ("friction_std", "restitution_std", *IMPACT_STDS)


@pytest.mark.parametrize("exact", [False, True])
def test_everyday_is_a_robot_s_world_and_the_default_of_files(model, exact):
    bodies = [RigidBody(name, model, 1.0) for name in "ab"]
    unset = dict.fromkeys(("physics", "dt", "integrator", "stiffness"))  # null says nothing
    for scene in (
        Scene.everyday(bodies, exact=exact),
        read(physics="everyday", exact=exact),
        read(exact=exact),
        read(exact=exact, **unset),
    ):
        assert scene.integrator == "implicit" and scene.dt == 1.0 / 240.0 and scene.stiffness is None
        assert scene.gravity.tolist() == [0.0, 0.0, -9.81] and scene.gyroscopic
        assert scene.damping == 0.0 and not scene.sleep
        assert all((getattr(scene, name) == 0.0) == exact for name in UNCERTAIN)
        assert (scene.impact_friction_speed is None) == exact == (not scene.uncertain)
        assert scene.draws_impacts != exact


@pytest.mark.parametrize("key, value", [("stiffness", 1e4), ("stiffness", "auto"), ("damping", 0.5)])
def test_a_file_that_shows_to_be_of_version_0_2_must_name_its_physics(key, value):
    sentence = f"physics must be given beside {key}: 'physics: paper', .*, or 'physics: everyday'"
    with pytest.raises(InvalidOptionError, match=sentence):
        read(**{key: value})
    assert read(physics="paper", **{key: value}).integrator == "explicit"


@pytest.mark.parametrize(
    "entries, field",
    [
        ({"stiffness": 1e9}, "stiffness"),
        ({"stiffness": "auto"}, "stiffness"),
        ({"stiffness_std": 1e5}, "stiffness_std"),
    ],
)
def test_the_implicit_integrator_has_no_stiffness(model, entries, field):
    with pytest.raises(InvalidOptionError, match=f"^{field} must be absent with 'integrator: implicit'"):
        read(physics="everyday", **entries)
    if entries[field] != "auto":
        with pytest.raises(InvalidOptionError, match=f"^{field} must be absent"):
            Scene.everyday([RigidBody("a", model, 1.0)], **entries)


def test_the_prior_of_friction_covers_the_objects_that_were_measured(model):
    """Sliding friction of tossed cubes 0.21, of pushed steel 0.14 to 0.35 on four surfaces."""
    scene = Scene.everyday([RigidBody(name, model, 1.0) for name in "ab"])
    z = np.random.default_rng(0).standard_normal((500, len(scene.uncertain)))
    friction = np.sqrt(variation(scene, z).materials[:, FRICTION].prod(axis=1))
    low, high = np.quantile(friction, (0.05, 0.95))
    assert low < 0.15 and 0.5 < high < 0.8 and friction.min() > 0.0


@pytest.mark.parametrize(
    "entry, friction, std",
    [(0.4, 0.4, 0.0), ({"mean": 0.4, "std": 0.1}, 0.4, 0.1), (None, None, 0.0), (0, 0.0, 0.0)],
)
def test_a_given_friction_is_exact_unless_its_std_is_given(entry, friction, std):
    scene = read(friction=entry)
    assert (scene.friction, scene.friction_std) == (friction, std)
    assert scene.restitution_std > 0.0 and scene.draws_impacts
    assert read(friction_std=0.05).friction_std == 0.05


RATE = "dt is in seconds and must be at most 0.25; for 240 steps a second write 0.004167"


@pytest.mark.parametrize(
    "entries, error, sentence",
    [
        ({"friction": {"mean": 0.4}}, InvalidRequestError, "friction.std must be given"),
        ({"friction": {"mean": 0.4, "spread": 1}}, InvalidRequestError, "friction has no key 'spread'"),
        (
            {"friction": {"mean": 0.4, "std": 0.1}, "friction_std": 0.1},
            InvalidRequestError,
            "must not be given beside friction.std",
        ),
        ({"dt": 0.5}, InvalidHorizonError, RATE),
        ({"dt": 240.0}, InvalidHorizonError, RATE),
        ({"integrator": "explicit", "friction": 0.3}, InvalidOptionError, "friction .*implicit"),
    ],
)
def test_bad_physics_is_refused(entries, error, sentence):
    with pytest.raises(error, match=sentence):
        read(**entries)


def test_nothing_is_uncertain_where_nothing_can_touch(model):
    scene = Scene.everyday([RigidBody("a", model, 1.0)])
    assert not scene.uncertain and not scene.draws_impacts
    assert not read(bodies=CONTENTS["two_bodies"]()["bodies"][:1]).uncertain


@pytest.mark.parametrize(
    "key, given, value",
    [
        ("dt", 0.002, 0.002),
        ("gyroscopic", False, False),
        ("friction", 0.2, 0.2),
        ("friction", 0.0, 0.0),
        ("restitution", 0.7, 0.7),
        ("damping", 0.3, 0.3),
        ("sleep", True, True),
        ("gravity", [0, 0, -1.62], [0, 0, -1.62]),
        ("gravity", None, [0, 0, 0]),  # null takes a law away
        ("gyroscopic", None, False),
        ("friction", None, None),
        ("restitution", None, None),
    ],
)
def test_a_key_overrides_the_preset(model, key, given, value):
    for scene in (
        read(physics="everyday", exact=True, **{key: given}),
        Scene.everyday([RigidBody("a", model, 1.0)], exact=True, **{key: given}),
    ):
        assert np.array_equal(getattr(scene, key), value)
        preset = EXACT_PRESETS["everyday"]
        others = {name: preset[name] for name in ("friction", "restitution", "integrator")}
        assert all(getattr(scene, name) == own for name, own in others.items() if name != key)
        assert value is not None or not getattr(scene.materials, key).any()


@pytest.mark.parametrize(
    "reason, body, laws",
    [
        ("an environment", {}, {"environment": [Plane()]}),
        ("friction", {}, {"friction": 0.3, "integrator": "implicit"}),
        ("friction", {"friction": 0.3}, {"integrator": "implicit"}),
        ("bodies at rest", {"at_rest": True}, {"integrator": "implicit"}),
    ],
)
def test_a_scene_that_looks_as_if_it_had_gravity_must_say(model, reason, body, laws):
    bodies = [RigidBody("a", model, 1.0, **body)]
    with pytest.raises(InvalidRequestError, match=f"gravity must be .* has {reason}: use .*Scene.everyday"):
        Scene(bodies, **laws)
    Scene(bodies, gravity=(0, 0, -9.81), **laws)
    assert not Scene([RigidBody("a", model, 1.0)]).gravity.any()


def test_the_explicit_step_drops_what_nobody_asked_for():
    scene = read(physics="everyday", integrator="explicit", friction=None, restitution=None)
    assert scene.integrator == "explicit" and scene.gravity.tolist() == [0.0, 0.0, -9.81]


# -- stiffness ---------------------------------------------------------------------------------------


def test_too_much_for_any_stiffness_is_refused(model, recwarn):
    mean = np.zeros((1, 13))
    mean[0, 3] = 1e200
    with pytest.raises(LimitExceededError):
        auto_stiffness([RigidBody("a", model, 1.0)], mean)
    assert not recwarn.list


def test_auto_in_a_file():
    scene, belief, _ = scene_from_dict(CONTENTS["two_bodies"]() | {"stiffness": "auto"})
    assert scene.stiffness == auto_stiffness(scene.bodies, belief.mean)


# -- what answers say --------------------------------------------------------------------------------


def test_the_physics_of_a_scene_in_words(model):
    pairs = [{"between": ["a", "table"], "friction": 0.3}]
    everyday = Scene.everyday(
        [RigidBody("a", model, 1.0, friction=0.2)],
        exact=True,
        environment=[Box((1, 1, 1), name="table")],
        friction_std=0.1,
        rolling_friction=2e-4,
        pairs=pairs,
        overlap="keep",
    )
    physics = physics_of(everyday)
    expected = {
        "integrator": "implicit",
        "dt": 1.0 / 240.0,
        "gravity": [0.0, 0.0, -9.81],
        "friction": 0.5,
        "friction_of": {"a": 0.2},
        "friction_std": 0.1,
        "restitution": 0.1,
        "rolling_friction": 2e-4,
        "pairs": pairs,
    }
    assert {key: physics[key] for key in expected} == expected
    assert not {"restitution_of", "stiffness"} & set(physics)
    assert physics_as_text(everyday) == (
        "implicit, dt 0.0041667 s, gravity (0, 0, -9.81) m/s^2, friction 0.5 +- 0.1 (some surfaces have their"
        " own), restitution 0.1, rolling friction 0.2 mm, pairs a and table, overlap keep, gyroscopic"
    )
    paper = Scene([RigidBody("a", model, 1.0)])
    assert physics_of(paper)["friction"] == 0.0 and physics_of(paper)["restitution"] == 1.0
    assert physics_as_text(paper) == "explicit, dt 0.01 s, stiffness 1e+04 N/m^3"
