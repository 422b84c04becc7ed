"""Materials of pairs, and rolling friction, against closed forms; and what is refused."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from unc_physics import (
    Belief,
    BodyBelief,
    Box,
    Plane,
    RigidBody,
    Scene,
    SpherePacking,
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
    return Scene.everyday(bodies, **{"exact": True, "integrator": "contact", "environment": [FLOOR]} | given)


def run(scene, times, **states):
    belief = Belief.of(scene, {name: BodyBelief(**state) for name, state in states.items()})
    return predict(scene, belief, make_propagator("monte_carlo", samples=1), times=times)


def rolling(speed):
    return {"position": (0, 0, R), "linear_velocity": (speed, 0, 0), "angular_velocity": (0, speed / R, 0)}


# -- pairs -------------------------------------------------------------------------------------------


def test_a_pair_slides_with_its_own_friction_and_others_with_the_mean():
    boxes = [RigidBody(name, BOX, 1.0, friction=0.4) for name in "ab"]
    scene = scene_of(*boxes, friction=0.4, pairs=[{"between": ["floor", "b"], "friction": 0.1}])
    start = {"position": (0, 0, 0.05), "linear_velocity": (1.0, 0, 0)}
    p = run(scene, [0.2], a=start, b=start | {"position": (0, 1.0, 0.05)})
    speeds = [p[name].linear_velocity[0] for name in "ab"]
    np.testing.assert_allclose(speeds, [1.0 - 0.2 * mu * G for mu in (0.4, 0.1)], rtol=1e-6)


def test_a_pair_of_bodies_has_its_own_restitution_whatever_is_uncertain():
    bodies = [RigidBody("post", BALL, fixed=True), RigidBody("a", BALL, 0.1, mass_std=0.01)]
    pairs = [{"between": ("a", "post"), "restitution": 0.9}]
    scene = scene_of(*bodies, environment=[], gravity=None, restitution=0.2, friction=0.0, pairs=pairs)
    p = run(scene, [0.2], post={}, a={"position": (0.1, 0, 0), "linear_velocity": (-1.0, 0, 0)})
    assert p["a"].linear_velocity[0] == pytest.approx(0.9, rel=1e-6)


def test_pairs_are_read_from_files_and_kept_by_name():
    content = {
        "physics": "everyday",
        "integrator": "contact",
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


@pytest.mark.parametrize("integrator", ["implicit", "explicit"])
@pytest.mark.parametrize(
    ("own", "given", "field"),
    [
        ({}, {"pairs": [{"between": ["a", "floor"], "friction": 0.0}]}, "pairs"),
        ({}, {"rolling_friction": 1e-4}, "rolling_friction"),
        ({"rolling_friction": 1e-4}, {}, "bodies[0].rolling_friction"),
    ],
)
def test_other_integrators_refuse_them(integrator, own, given, field):
    laws = {"friction": None, "restitution": None} if integrator == "explicit" else {}
    with pytest.raises(InvalidOptionError, match="integrator: contact") as caught:
        scene_of(RigidBody("a", BALL, 0.1, **own), integrator=integrator, **laws | given)
    assert caught.value.field == field


# -- rolling friction --------------------------------------------------------------------------------


@pytest.mark.parametrize("dt", [1 / 120, 1 / 1000])
@pytest.mark.parametrize("r", [1e-4, 1e-3])
def test_a_ball_that_rolls_slows_down_as_in_closed_form(r, dt):
    p = run(scene_of(RigidBody("a", BALL, 0.1), rolling_friction=r, dt=dt), [0.5], a=rolling(0.5))
    assert p["a"].linear_velocity[0] == pytest.approx(0.5 - 0.5 * 5.0 / 7.0 * G * r / R, rel=1e-9)
    assert p["a"].angular_velocity[1] * R == pytest.approx(p["a"].linear_velocity[0], rel=1e-9)


@pytest.mark.parametrize(("share", "rolls"), [(0.9, False), (1.1, True)])
def test_a_ball_lies_still_on_a_slope_up_to_the_right_angle(share, rolls):
    r = 1e-3
    angle = math.atan(share * r / R)
    g = (G * math.sin(angle), 0.0, -G * math.cos(angle))
    p = run(scene_of(RigidBody("a", BALL, 0.1), rolling_friction=r, gravity=g), [1.0], a=rolling(0.0))
    way = 0.5 * 5.0 / 7.0 * G * (math.sin(angle) - math.cos(angle) * r / R)
    assert p["a"].position[0] == pytest.approx(way if rolls else 0.0, rel=1e-3, abs=1e-6)


def test_a_loaded_ball_swings_out_as_friction_says():
    """Its centre of mass is below its middle; each swing ends nearer, until friction holds it."""
    r, d, m, start = 1e-3, 0.01, 0.1, 0.9
    inertia = 0.3 * R * R
    model = SpherePacking(
        "loaded",
        [[0, 0, d]],
        [R],
        inertia=inertia * np.eye(3),
        volume=1e-4,
        origin=np.zeros(3),
        bounding_radius=R + d,
    )

    def rates(_, y):  # while it rolls to smaller angles
        s, c, w = math.sin(y[0]), math.cos(y[0]), y[1]
        mass = inertia + R * R + d * d - 2.0 * R * d * c - r * d * s
        return w, (-R * d * s * w * w - G * d * s + r * (G + d * c * w * w)) / mass

    def turns(t, y):
        return y[1] if t > 0.0 else -1.0

    turns.terminal = True
    end = solve_ivp(rates, (0.0, 2.0), [start, 0.0], events=turns, rtol=1e-10, atol=1e-10)
    half, angle = end.t[-1], end.y[0, -1]
    state = {
        "position": (-d * math.sin(start), 0.0, R - d * math.cos(start)),
        "orientation": (0.0, math.sin(start / 2), 0.0, math.cos(start / 2)),
    }
    scene = scene_of(RigidBody("a", model, m), rolling_friction=r, friction=2.0)
    p = run(scene, [half, 5.0, 6.0], a=state)
    angles = [
        2.0 * math.atan2(q[1], q[3]) for q in (p.body("a", time=t).orientation for t in (half, 5.0, 6.0))
    ]
    assert angles[0] == pytest.approx(angle, abs=0.01)
    assert abs(angles[1]) < r / d * 1.02 and angles[2] == pytest.approx(angles[1], abs=1e-5)


def test_own_values_and_pairs_come_before_the_scenes():
    for own, given, r in (
        ({"rolling_friction": 4e-4}, {"rolling_friction": 1e-4}, 2e-4),
        (
            {},
            {"rolling_friction": 1e-4, "pairs": [{"between": ["a", "floor"], "rolling_friction": 3e-4}]},
            3e-4,
        ),
        ({"rolling_friction": 4e-4}, {}, 0.0),
    ):
        p = run(scene_of(RigidBody("a", BALL, 0.1, **own), **given), [0.5], a=rolling(0.5))
        assert p["a"].linear_velocity[0] == pytest.approx(0.5 - 0.5 * 5.0 / 7.0 * G * r / R, rel=1e-9)


def test_everyday_scenes_roll_to_a_stop_unless_they_are_exact():
    ball = RigidBody("a", BALL, 0.1)
    scene = Scene.everyday([ball], integrator="contact", environment=[FLOOR])
    assert scene.rolling_friction == 1e-4
    assert scene_of(ball).rolling_friction is None
    assert Scene.everyday([ball], integrator="contact", rolling_friction=None).rolling_friction is None
    assert Scene.everyday([ball]).rolling_friction is None
