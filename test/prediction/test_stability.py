"""Stability against statics: a box near an edge, on a slope, in the air, and margins."""

import math
from statistics import NormalDist

import numpy as np
import pytest

from unc_physics import Belief, BodyBelief, Box, Plane, RigidBody, Scene, assess_stability, primitive_model
from unc_physics.checks.errors import InvalidRequestError, NotSupportedError

SIZE, FRICTION = 0.1, 0.4  # m
CONFIDENCE = 0.999  # of intervals, so that none misses its value by chance
CUBE = primitive_model("box", size=[SIZE, SIZE, SIZE])
FLOOR = Plane(name="floor")
SHELF = Box((0.6, 0.6, 0.04), (-0.3, 0.0, -0.02), name="shelf")  # its edge is at x = 0
INSIDE, STD = 0.005, 0.005  # m


def assessed(environment, x=0.0, z=0.5 * SIZE, body=(), known=(), gravity=(0.0, 0.0, -9.81), **options):
    """The stability of a cube."""
    cube = RigidBody("cube", CUBE, 0.5, **dict(body))
    scene = Scene.everyday([cube], environment=environment, gravity=gravity, **options)
    belief = Belief.of(scene, {"cube": BodyBelief(position=(x, 0.0, z), **dict(known))})
    return assess_stability(scene, belief, "cube", confidence=CONFIDENCE)


def test_a_box_with_an_uncertain_centre_of_mass_near_an_edge():
    found = assessed([SHELF], x=-INSIDE, body={"center_of_mass_std": (STD, 0.0, 0.0)}, friction=0.8)
    assert found.low <= NormalDist().cdf(INSIDE / STD) <= found.high < found.low + 0.25
    assert found.supports == ("shelf",)
    assert found.distance_margin == pytest.approx(INSIDE, abs=1e-4)
    assert found.angle_margin == pytest.approx(math.atan2(INSIDE, 0.5 * SIZE), abs=2e-3)


def test_a_box_with_an_uncertain_position_near_an_edge():
    found = assessed([SHELF], x=-INSIDE, known={"position_std": (STD, 0.0, 0.002)}, friction=0.8)
    assert found.low <= NormalDist().cdf(INSIDE / STD) <= found.high


@pytest.mark.parametrize("slope", [0.9, 1.0, 1.1])
def test_a_box_on_a_slope_near_its_friction_angle(slope):
    """Friction of a contact is lognormal."""
    std, angle = 0.1, math.atan(slope * FRICTION)
    gravity = (9.81 * math.sin(angle), 0.0, -9.81 * math.cos(angle))
    found = assessed([FLOOR], gravity=gravity, friction=FRICTION, friction_std=std, restitution=0.1)
    wanted = NormalDist().cdf(-math.log(slope) / (std / FRICTION))
    assert found.low <= wanted <= found.high
    assert found.angle_margin == pytest.approx(max(0.0, math.atan(FRICTION) - angle), abs=1e-6)


def test_a_box_on_a_floor_and_one_above_it():
    stands = assessed([FLOOR], known={"position_std": 0.002}, friction=FRICTION)
    assert (stands.probability, stands.high) == (1.0, 1.0) and stands.low > 0.9
    assert stands.distance_margin == pytest.approx(0.5 * SIZE, abs=1e-4)
    assert stands.angle_margin == pytest.approx(math.atan(FRICTION), abs=1e-6)  # it slides before it tips
    falls = assessed([FLOOR], z=0.2, known={"position_std": 0.002}, friction=FRICTION)
    assert (falls.probability, falls.low, falls.supports, falls.angle_margin) == (0.0, 0.0, (), None)
    moves = assessed([FLOOR], known={"linear_velocity": (0.5, 0.0, 0.0)}, friction=FRICTION)
    assert moves.probability == 0.0


def test_a_box_on_another_one():
    scene = Scene.everyday(
        [RigidBody(name, CUBE, 0.5) for name in ("lower", "upper")], environment=[FLOOR], friction=FRICTION
    )
    known = {
        name: BodyBelief(position=(x, 0.0, z)) for name, x, z in (("lower", 0, 0.05), ("upper", 0.03, 0.15))
    }
    found = assess_stability(scene, Belief.of(scene, known), "upper")
    assert found.supports == ("lower",) and found.probability == 1.0
    assert found.distance_margin == pytest.approx(0.02, abs=1e-3)


def test_bad_arguments_are_named():
    scene = Scene.everyday([RigidBody("cube", CUBE, 0.5), RigidBody("fixed", CUBE, 1.0, fixed=True)])
    belief = Belief.of(
        scene, {"cube": BodyBelief(position=(0, 0, 0)), "fixed": BodyBelief(position=(1, 0, 0))}
    )
    for name, words in (
        ("cub", "body is no body of the scene; did you mean 'cube'"),
        ("fixed", "body must move"),
    ):
        with pytest.raises(InvalidRequestError, match=words):
            assess_stability(scene, belief, name)
    for field, value in (("confidence", 1.0), ("duration", 0.0), ("angle", np.nan)):
        with pytest.raises(Exception, match=field):
            assess_stability(scene, belief, "cube", **{field: value})
    paper = Scene([RigidBody("cube", CUBE, 0.5)], stiffness=1e4)
    with pytest.raises(NotSupportedError, match="integrator"):
        assess_stability(paper, Belief.of(paper, {"cube": BodyBelief(position=(0, 0, 0))}), "cube")
