"""Materials of pairs: how they are given, kept and refused; what they do is in the laws."""

import pytest

from unc_physics import (
    Belief,
    BodyBelief,
    Box,
    Plane,
    RigidBody,
    Scene,
    make_propagator,
    predict,
    primitive_model,
)
from unc_physics.checks.errors import DuplicateIdError, InvalidOptionError, InvalidRequestError
from unc_physics.scene.pairs import pairs_among
from unc_physics.scene.scene_file import scene_from_dict

G = 9.81
R = 0.03
FLOOR = Plane(name="floor")
BALL = primitive_model("sphere", radius=R)
BOX = primitive_model("box", size=(0.1, 0.1, 0.1))


def scene_of(*bodies, **given):
    return Scene.everyday(bodies, **{"exact": True, "environment": [FLOOR]} | given)


def run(scene, times, **states):
    belief = Belief.of(scene, {name: BodyBelief(**state) for name, state in states.items()})
    return predict(scene, belief, make_propagator("monte_carlo", samples=1), times=times)


def test_a_pair_of_bodies_has_its_own_restitution_whatever_is_uncertain():
    bodies = [RigidBody("post", BALL, fixed=True), RigidBody("a", BALL, 0.1, mass_std=0.01)]
    pairs = [{"between": ("a", "post"), "restitution": 0.9}]
    scene = scene_of(*bodies, environment=[], gravity=None, restitution=0.2, friction=0.0, pairs=pairs)
    p = run(scene, [0.2], post={}, a={"position": (0.1, 0, 0), "linear_velocity": (-1.0, 0, 0)})
    assert p["a"].linear_velocity[0] == pytest.approx(0.9, rel=1e-6)


def test_pairs_are_read_from_files_and_kept_by_name():
    content = {
        "physics": "everyday",
        "bodies": [{"name": "a", "shape": {"sphere": {"radius": R}}, "mass": 0.1}],
        "environment": [{"plane": {"normal": [0, 0, 1], "offset": 0.0}, "name": "floor"}],
        "pairs": [
            {"between": ["a", "floor"], "friction": 0.3, "rolling_friction": 2e-4, "restitution": None}
        ],
    }
    scene = scene_from_dict(content).scene
    (pair,) = scene.pairs
    assert pair.between == ("a", "floor") and pair.given == {"friction": 0.3, "rolling_friction": 2e-4}
    assert pairs_among(scene.pairs, ["a"]) == () and pairs_among(scene.pairs, ["a", "floor"]) == (pair,)
    assert scene_from_dict(content | {"pairs": None}).scene.pairs == ()


@pytest.mark.parametrize(
    ("pairs", "error", "field", "problem"),
    [
        ("floor", InvalidRequestError, "pairs", "list of pairs"),
        ([{"between": ["a"], "friction": 1}], InvalidRequestError, "pairs[0].between", "two names"),
        (
            [{"between": ["a", "flor"], "friction": 1}],
            InvalidRequestError,
            "pairs[0].between",
            "mean 'floor'",
        ),
        ([{"between": ["a", "a"], "friction": 1}], InvalidRequestError, "pairs[0].between", "two things"),
        ([{"between": ["w", "floor"], "friction": 1}], InvalidRequestError, "pairs[0].between", "a body"),
        ([{"between": ["a", "floor"]}], InvalidRequestError, "pairs[0]", "one of friction"),
        ([{"between": ["a", "floor"], "mu": 1}], InvalidRequestError, "pairs[0]", "mean 'friction'"),
        ([{"between": ["a", "floor"], "friction": -1}], InvalidRequestError, "pairs[0].friction", "negative"),
        ([{"between": ["a", "floor"], "restitution": 2}], InvalidRequestError, "pairs[0].restitution", "1"),
        (
            [{"between": ["a", "floor"], "friction": 1}, {"between": ["floor", "a"], "restitution": 0}],
            DuplicateIdError,
            "pairs[1].between",
            "stands before",
        ),
    ],
)
def test_bad_pairs_are_named(pairs, error, field, problem):
    floor = [FLOOR, Box((1, 1, 1), name="w")]
    with pytest.raises(error, match=problem) as caught:
        scene_of(RigidBody("a", BALL, 0.1), environment=floor, pairs=pairs)
    assert caught.value.field == field


@pytest.mark.parametrize(
    ("own", "given", "field"),
    [
        ({}, {"pairs": [{"between": ["a", "floor"], "friction": 0.0}]}, "pairs"),
        ({}, {"rolling_friction": 1e-4}, "rolling_friction"),
        ({"rolling_friction": 1e-4}, {}, "bodies[0].rolling_friction"),
    ],
)
def test_the_explicit_step_refuses_them(own, given, field):
    body = RigidBody("a", BALL, 0.1, **own)
    with pytest.raises(InvalidOptionError, match="integrator: implicit") as caught:
        Scene([body], environment=[FLOOR], **given)
    assert caught.value.field == field


def test_everyday_scenes_roll_to_a_stop_unless_they_are_exact():
    ball = RigidBody("a", BALL, 0.1)
    assert Scene.everyday([ball], environment=[FLOOR]).rolling_friction == 1e-4
    assert scene_of(ball).rolling_friction is None
    assert Scene.everyday([ball], rolling_friction=None).rolling_friction is None
