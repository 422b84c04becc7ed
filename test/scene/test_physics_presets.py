"""Physics by name, the integrator's names, a stiffness that is chosen, and what answers say of all that."""

import numpy as np
import pytest
from example_scenes import CONTENTS
from plain_scenes import ball

from unc_physics import Box, Plane, RigidBody, Scene, auto_stiffness
from unc_physics.checks.errors import (
    InvalidHorizonError,
    InvalidOptionError,
    InvalidRequestError,
    LimitExceededError,
)
from unc_physics.scene.parameters import vary_materials
from unc_physics.scene.physics_summary import physics_as_text, physics_of
from unc_physics.scene.presets import EXACT_PRESETS
from unc_physics.scene.scene import IMPACT_STDS
from unc_physics.scene.scene_file import scene_from_dict
from unc_physics.scene.stiffness import REST_DEPTH, rest_stiffness, with_stiffness

DOWN = (0.0, 0.0, -9.81)
BALL = ball(0.03)


@pytest.fixture(scope="module")
def model(loaded):
    """A packing of ten spheres."""
    return loaded("two_bodies").scene.bodies[0].model


def without_dt(**entries):
    content = CONTENTS["two_bodies"]() | entries
    del content["dt"], content["stiffness"], content["damping"]
    return content | {key: value for key, value in entries.items() if key in ("dt", "stiffness", "damping")}


def read(**entries):
    return scene_from_dict(without_dt(**entries)).scene


def at_rest(count=1):
    mean = np.zeros((count, 13))
    mean[:, 9] = 1.0
    return mean


# -- presets -----------------------------------------------------------------------------------------


def assert_everyday(scene):
    assert scene.integrator == "implicit" and scene.dt == 1.0 / 240.0 and scene.stiffness is None
    assert scene.gravity.tolist() == [0.0, 0.0, -9.81] and scene.gyroscopic
    assert scene.damping == 0.0 and not scene.sleep


UNCERTAIN = ("friction_std", "restitution_std", *IMPACT_STDS)


@pytest.mark.parametrize("exact", [False, True])
def test_everyday_is_a_robot_s_world(model, exact):
    bodies = [RigidBody(name, model, 1.0) for name in "ab"]
    for scene in (read(physics="everyday", exact=exact), Scene.everyday(bodies, exact=exact)):
        assert_everyday(scene)
        assert all((getattr(scene, name) == 0.0) == exact for name in UNCERTAIN)
        assert (scene.impact_friction_speed is None) == exact == (not scene.uncertain)
        assert scene.draws_impacts != exact


def test_the_prior_of_friction_covers_the_objects_that_were_measured(model):
    """Sliding friction of tossed cubes 0.21, of pushed steel 0.14 to 0.35 on four surfaces."""
    scene = Scene.everyday([RigidBody(name, model, 1.0) for name in "ab"])
    z = np.random.default_rng(0).standard_normal((500, 2))
    friction = np.array([vary_materials(scene, one).friction[0] for one in z])
    low, high = np.quantile(friction, (0.05, 0.95))
    assert low < 0.15 and 0.5 < high < 0.8 and friction.min() > 0.0


@pytest.mark.parametrize(
    "entry, friction, std",
    [(0.4, 0.4, 0.0), ({"mean": 0.4, "std": 0.1}, 0.4, 0.1), (None, None, 0.0), (0, 0.0, 0.0)],
)
def test_a_given_friction_is_exact_unless_its_std_is_given(entry, friction, std):
    scene = read(physics="everyday", friction=entry)
    assert (scene.friction, scene.friction_std) == (friction, std)
    assert scene.restitution_std > 0.0 and scene.draws_impacts
    assert read(physics="everyday", friction_std=0.05).friction_std == 0.05


@pytest.mark.parametrize(
    "entries, sentence",
    [
        ({"friction": {"mean": 0.4}}, "friction.std must be given"),
        ({"friction": {"mean": 0.4, "spread": 1}}, "friction has no key 'spread'"),
        (
            {"friction": {"mean": 0.4, "std": 0.1}, "friction_std": 0.1},
            "must not be given beside friction.std",
        ),
        ({"restitution": {"mean": 0.4, "std": -1}}, "restitution_std must not be negative"),
    ],
)
def test_bad_spreads_are_refused(entries, sentence):
    with pytest.raises(InvalidRequestError, match=sentence):
        read(physics="everyday", **entries)


@pytest.mark.parametrize("dt", [0.5, 240.0])
def test_a_rate_in_place_of_a_step_is_refused(dt):
    sentence = "dt is in seconds and must be at most 0.25; for 240 steps a second write 0.004167"
    with pytest.raises(InvalidHorizonError, match=sentence):
        read(physics="everyday", dt=dt)


def test_nothing_is_uncertain_where_nothing_can_touch(model):
    scene = Scene.everyday([RigidBody("a", model, 1.0)])
    assert not scene.uncertain and not scene.draws_impacts
    assert not read(physics="everyday", bodies=CONTENTS["two_bodies"]()["bodies"][:1]).uncertain


@pytest.mark.parametrize(
    "key, given, value",
    [
        *((key, value, value) for key, value in (("dt", 0.002), ("stiffness", 1e9), ("gyroscopic", False))),
        *((key, value, value) for key, value in (("friction", 0.2), ("friction", 0.0), ("restitution", 0.7))),
        *(
            (key, value, value)
            for key, value in (("damping", 0.3), ("sleep", True), ("gravity", [0, 0, -1.62]))
        ),
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


LIKELY_GRAVITY = {
    "an environment": {"environment": [{"plane": {"normal": [0, 0, 1]}}]},
    "friction": {"friction": 0.3, "integrator": "implicit"},
    "bodies at rest": {"integrator": "implicit"},
}


@pytest.mark.parametrize("reason", LIKELY_GRAVITY)
def test_a_scene_that_looks_as_if_it_had_gravity_must_say(reason):
    content = without_dt(**LIKELY_GRAVITY[reason])
    if reason == "bodies at rest":
        body = content["bodies"][0]
        content["bodies"][0] = {key: body[key] for key in ("name", "model", "spheres", "mass") if key in body}
        content["bodies"][0] |= {"at_rest": True}
    with pytest.raises(InvalidRequestError, match=f"gravity must be given, as the scene has {reason}"):
        scene_from_dict(content)
    scene_from_dict(content | {"gravity": [0, 0, -9.81]})
    scene_from_dict(content | {"physics": "everyday", "exact": True})
    if reason == "an environment":
        scene_from_dict(content | {"physics": "paper"})
        assert not scene_from_dict(content | {"gravity": None}).scene.gravity.any()


def test_python_scenes_need_gravity_likewise(model):
    with pytest.raises(InvalidRequestError, match="Scene.everyday"):
        Scene([RigidBody("a", model, 1.0)], environment=[Plane()])
    assert not Scene([RigidBody("a", model, 1.0)]).gravity.any()


def test_null_says_nothing_where_there_is_no_law_to_take_away():
    assert_everyday(read(physics="everyday", dt=None, integrator=None, stiffness=None))


def test_everyday_with_the_explicit_step_needs_its_laws_away():
    with pytest.raises(InvalidOptionError, match="friction .*implicit"):
        read(physics="everyday", integrator="explicit")
    scene = read(physics="everyday", integrator="explicit", friction=None, restitution=None)
    assert scene.integrator == "explicit" and scene.gravity.tolist() == [0.0, 0.0, -9.81]


# -- stiffness ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("mass", [0.1, 1.0, 5.0])
def test_what_rests_on_one_small_sphere_sinks_in_by_less_than_a_tenth_of_a_millimetre(model, mass):
    for shape in (model, BALL):
        kappa = rest_stiffness(
            [RigidBody("a", shape, mass), RigidBody("b", shape, fixed=True)], at_rest(2), DOWN
        )
        depth = np.sqrt(mass * 9.81 / (kappa * np.pi * shape.radii.min()))
        assert 0.9 * REST_DEPTH < depth <= REST_DEPTH
        on_its_like = np.sqrt(mass * 9.81 / (kappa * np.pi * 0.5 * shape.radii.min()))
        assert on_its_like < 1e-4


def test_what_is_tiny_sinks_in_by_a_small_share_of_its_size(model):
    tiny = model.scaled(0.0005 / model.radii.min())
    kappa = rest_stiffness([RigidBody("a", tiny, 1e-6)], at_rest(), DOWN)
    depth = np.sqrt(1e-6 * 9.81 / (kappa * np.pi * tiny.radii.min()))
    assert 0.9 * 2.5e-5 < depth <= 2.5e-5


def test_without_gravity_it_takes_up_impacts(model):
    bodies, mean = [RigidBody("a", model, 1.0), RigidBody("b", model, 1.0)], at_rest(2)
    mean[0, 3] = 2.0
    assert rest_stiffness(bodies, mean, (0.0, 0.0, 0.0)) == auto_stiffness(bodies, mean)
    assert rest_stiffness(bodies, at_rest(2), (0.0, 0.0, 0.0)) > 0.0
    assert rest_stiffness([RigidBody("a", model, fixed=True)], at_rest(1), DOWN) > 0.0


def test_too_much_for_any_stiffness_is_refused(model, recwarn):
    with pytest.raises(LimitExceededError):
        rest_stiffness([RigidBody("a", model, 1e50)], at_rest(), (0.0, 0.0, -1e300))
    mean = at_rest()
    mean[0, 3] = 1e200
    with pytest.raises(LimitExceededError):
        auto_stiffness([RigidBody("a", model, 1.0)], mean)
    assert not recwarn.list


def test_a_stiffness_is_chosen_once(model):
    scene = Scene.everyday([RigidBody("a", model, 1.0)], exact=True, environment=[Plane()])
    chosen = with_stiffness(scene, at_rest())
    assert (
        chosen.stiffness == rest_stiffness(scene.bodies, at_rest(), scene.gravity)
        and chosen.world.stiffness == chosen.stiffness
    )
    assert with_stiffness(scene, at_rest()) is chosen and with_stiffness(chosen, at_rest()) is chosen
    with pytest.raises(InvalidRequestError, match="stiffness"):
        scene.world  # noqa: B018
    assert scene.stiffness is None


def test_auto_in_a_file():
    assert read(physics="everyday", stiffness="auto").stiffness is None
    scene, belief, _ = scene_from_dict(without_dt(stiffness="auto"))
    assert scene.stiffness == auto_stiffness(scene.bodies, belief.mean)
    with pytest.raises(InvalidRequestError, match="stiffness_std"):
        read(physics="everyday", stiffness_std=1e5)


# -- what answers say --------------------------------------------------------------------------------


def test_the_physics_of_a_scene_in_words(model):
    everyday = Scene.everyday(
        [RigidBody("a", model, 1.0, friction=0.2)],
        exact=True,
        environment=[Box((1, 1, 1), name="table")],
        friction_std=0.1,
    )
    physics = physics_of(everyday)
    assert (
        physics["integrator"] == "implicit"
        and physics["dt"] == 1.0 / 240.0
        and physics["gravity"] == [0.0, 0.0, -9.81]
    )
    assert (
        physics["friction"] == 0.5 and physics["friction_of"] == {"a": 0.2} and physics["friction_std"] == 0.1
    )
    assert physics["restitution"] == 0.1 and "restitution_of" not in physics and physics["stiffness"] is None
    text = physics_as_text(with_stiffness(everyday, at_rest()))
    assert text.startswith("implicit, dt 0.0041667 s, stiffness ") and "gravity (0, 0, -9.81) m/s^2" in text
    assert "friction 0.5 +- 0.1 (some surfaces have their own), restitution 0.1, gyroscopic" in text
    paper = Scene([RigidBody("a", model, 1.0)])
    assert physics_of(paper)["friction"] == 0.0 and physics_of(paper)["restitution"] == 1.0
    assert physics_as_text(paper) == "explicit, dt 0.01 s, stiffness 1e+04 N/m^3"
