"""Linearization on the implicit step against central differences of what it is the derivative of."""

import math

import numpy as np
import pytest
from derivatives import CLOSE, assert_derivative_of_steps, derivative, difference
from plain_scenes import BALL, BLOCK, FLOOR, packing, run, state, turned, world
from scipy.spatial.transform import Rotation

from unc_physics import RigidBody
from unc_physics.scene.environment import Plane, Sphere
from unc_physics.scene.stiffness import with_stiffness

CORNERS = packing(
    "corners",
    [(x, y, z) for x in (-0.06, 0.06) for y in (-0.04, 0.04) for z in (-0.01, 0.01)],
    [0.01] * 8,
    BLOCK.inertia,
)
CAN = packing("can", [(0, -0.05, 0), (0, 0.05, 0)], [0.03] * 2, np.diag([2.5e-3, 4e-4, 2.5e-3]))


def ball(x=0.0, z=0.1, velocity=(1.0, 0.2, -0.5), spin=(3.0, -2.0, 5.0)):
    return state((x, 0, z), velocity, spin)


@pytest.mark.parametrize(
    "bodies, x, time, more",
    [
        ([BLOCK], [state((0, 0, 1), (1, 0.2, 0), (3, -2, 5), turned(0.3, 0.2, 0.1))], 0.2, {}),
        ([BALL], [ball()], 0.2, {"restitution": 0.6, "friction": 0.1}),
        ([BALL], [ball(velocity=(0.3, 0.2, -0.5))], 0.2, {"restitution": 0.6, "friction": 0.9}),
        ([BALL], [ball()], 0.2, {"restitution": 0.6, "friction": 0.2, "impact_friction_speed": 1.5}),
        ([BALL], [ball()], 0.12, {"restitution": 0.0, "friction": 0.2, "impact_friction_speed": 1.5}),
        (
            [BALL],
            [ball(velocity=(0.3, 0.2, -0.5))],
            0.2,
            {"restitution": 0.6, "friction": 0.9, "impact_friction_speed": 1.5},
        ),
        ([BALL], [ball()], 0.9, {"restitution": 0.8, "friction": 0.1}),
        ([BALL], [ball()], 0.15, {"friction": 0.1}),
        ([BALL], [ball(z=0.0501, velocity=(1, 0, 0), spin=(0, 5, 0))], 0.3, {"friction": 0.2}),
        ([BALL], [ball(z=0.0501, velocity=(0.5, 0, 0), spin=(0, 10, 0))], 0.3, {"friction": 0.5}),
        ([BALL], [ball(z=0.25)], 0.3, {"restitution": 0.5, "environment": [Sphere(0.1, (0.1, 0.05, 0))]}),
        (  # with much friction, normal and friction depend on each other, and are not solved well enough
            [CORNERS],
            [state((0, 0, 0.16), (0.2, 0, -0.5), (1, 2, 0), turned(0.5, 0.6, 0))],
            0.12,
            {"friction": 0.05},
        ),
        (
            [BALL, BALL],
            [ball(-0.08, 0.3, (1, 0.1, 0)), ball(0.08, 0.32, (-0.5, 0, 0))],
            0.2,
            {"restitution": 0.7, "gyroscopic": False, "damping": 0.3},
        ),
    ],
    ids=[
        "flight",
        "slips",
        "sticks",
        "slips with speed",
        "slips without rebound",
        "sticks with speed",
        "thrice",
        "stays",
        "slides",
        "rolls",
        "on a sphere",
        "corner",
        "two balls",
    ],
)
def test_a_rollout_s_derivative_is_that_of_differences(bodies, x, time, more):
    x = np.array(x)
    scene = with_stiffness(world(*(RigidBody(f"b{k}", m, 0.3) for k, m in enumerate(bodies)), **more), x)
    found = difference(lambda s: run(scene, s, time), x, scene.moving, 1e-6)
    np.testing.assert_allclose(derivative(scene, x, time), found, rtol=0, atol=CLOSE * np.abs(found).max())


# -- several contacts --------------------------------------------------------------------------------

SLOPE = 0.3  # rad
INCLINE = Plane((-math.sin(SLOPE), 0, math.cos(SLOPE)), name="incline")
DEPTH = 2.5e-5  # m, about as deep as the block lies
#: Contacts that roll together are damped with the speed of the deepest (`implicit_solver.find_leads`). Of
#: contacts at the same depth a difference to one side would choose another than to the other side.
TILT = Rotation.from_rotvec((1e-6, 5e-7, 0))


@pytest.mark.parametrize(
    "velocity, spin, slope, friction, steps",
    [
        ((0, 0, 0), (0, 0, 0), 0.0, 0.5, 1),
        ((0, 0, 0), (0, 0, 0), 0.0, 0.5, 3),
        ((1, 0.2, 0), (0, 0, 1), 0.0, 0.3, 3),
        # Only one step: in the next, contacts lie a micrometre deeper than others, so that friction at one
        # holds what turns about another. By how much is left to the order in which they are solved, which a
        # nanometre changes.
        ((0, 0, 0), (0, 0, 0), SLOPE, 0.5, 1),
        ((-0.3, 0.1, 0), (0, 0, 0), SLOPE, 0.2, 3),
    ],
    ids=["lies", "lies on", "slides", "holds on an incline", "slides on an incline"],
)
def test_a_block_s_steps_have_the_derivative_of_differences(velocity, spin, slope, friction, steps):
    tilt = Rotation.from_rotvec((0, -slope, 0))
    x = state(tilt.apply((0, 0, 0.02 - DEPTH)), tilt.apply(velocity), spin, (tilt * TILT).as_quat())[None]
    scene = world(
        RigidBody("block", BLOCK, 0.5),
        environment=[INCLINE if slope else FLOOR],
        friction=friction,
        gyroscopic=False,
    )
    assert_derivative_of_steps(scene, x, steps)


@pytest.mark.parametrize(
    "spin, friction", [((0, 10, 0), 0.3), ((0, 5, 0.1), 0.1)], ids=["rolls", "rolls and slips"]
)
def test_a_can_s_steps_have_the_derivative_of_differences(spin, friction):
    x = state((0, 0, 0.03 - DEPTH), (0.3, 0, 0), spin, TILT.as_quat())[None]
    scene = world(RigidBody("can", CAN, 0.5), friction=friction, gyroscopic=False)
    assert_derivative_of_steps(scene, x, 6)


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_what_moves_on_another_has_the_derivative_of_differences(friction):
    """Where it is a single sphere; several that lie on several others are two faces, not what they are."""
    low = state((0, 0, 0.05 - 1.5 * DEPTH), (0.3, 0, 0))
    high = state((0.01, 0, 0.05 - 3.0 * DEPTH + math.sqrt(0.0099)), (0.3, 0.1, 0), (0, 1, 0))
    bodies = [RigidBody(name, BALL, 0.5) for name in ("low", "high")]
    scene = world(*bodies, friction=friction, gyroscopic=False)
    assert_derivative_of_steps(scene, np.array([low, high]), 3)


def test_what_is_pushed_out_slowly_has_the_derivative_of_differences():
    """Overlap that no force explains: with one solution, as the next one would explain it."""
    x = state((0, 0, 0.049), (1, 0.2, 0), (0, 5, 1))[None]
    scene = world(RigidBody("ball", BALL, 0.3), friction=0.2)
    assert_derivative_of_steps(scene, x, 1, times=1)
