"""Linearization on the everyday step: spreads of differences against samples and closed forms."""

import numpy as np
import pytest
from plain_scenes import BALL, BLOCK, FLOOR, G, independent, state
from scipy.spatial.transform import Rotation

from unc_physics import (
    Belief,
    BodyBelief,
    Plane,
    PosePath,
    RigidBody,
    Scene,
    Wrench,
    make_propagator,
    predict,
)
from unc_physics.prediction.body_status import Status
from unc_physics.prediction.status import assess
from unc_physics.propagators.linearization import LIMITS, REACH
from unc_physics.scene.environment import Sphere
from unc_physics.spatial.moments import pose_spreads

SAMPLES = 2000
STATISTICS = 4.0 / np.sqrt(2.0 * SAMPLES)  # four standard errors of a standard deviation
SWING = PosePath(
    times=[0, 0.4],
    positions=[[-0.3, -0.02, 0.01], [0.3, 0.05, 0.01]],
    orientations=Rotation.from_rotvec([[0, 0, 0.1], [0, 0.2, 0.5]]).as_quat(),
    linear_velocities=[[1.0, 0.2, 0.05], [2.5, 0.1, 0.0]],
)
BELT = Plane(surface_velocity=(0.5, 0.1, 0), surface_angular_velocity=(0, 0, 1.0), surface_center=(0.2, 0, 0))
PUSHES = [
    Wrench(force=(0.5, 0.8, 0.1), torque=(1e-3, 2e-3, 5e-3), start=0.001, duration=0.1),
    Wrench(force=(0, 0.3, 0), torque=(0, 1e-3, 1e-3), start=0.006, body_axes=True),
]


def everyday(*bodies, **more):
    return Scene.everyday(list(bodies), exact=True, **{"environment": [FLOOR]} | more)


def ball(x=0.0, z=0.1, velocity=(1.0, 0.2, -0.5), spin=(3.0, -2.0, 5.0)):
    return state((x, 0, z), velocity, spin)


@pytest.mark.parametrize(
    "bodies, x, time, more",
    [
        ([RigidBody("ball", BALL, 0.3)], [ball()], 0.2, {"restitution": 0.6, "friction": 0.1}),
        (
            [RigidBody("ball", BALL, 0.3)],
            [ball(velocity=(0.3, 0.2, -0.5))],
            0.2,
            {"restitution": 0.6, "friction": 0.9},
        ),
        ([RigidBody("ball", BALL, 0.3)], [ball()], 0.15, {"friction": 0.1}),
        ([RigidBody("ball", BALL, 0.3)], [ball(z=0.05, velocity=(1, 0, 0))], 0.3, {"friction": 0.2}),
        (
            [RigidBody("ball", BALL, 0.3)],
            [ball(z=0.05, velocity=(0.5, 0, 0), spin=(0, 10, 0))],
            0.3,
            {"friction": 0.5},
        ),
        (
            [RigidBody("ball", BALL, 0.3)],
            [ball(z=0.25)],
            0.3,
            {"restitution": 0.5, "environment": [Sphere(0.1, (0.1, 0.05, 0))]},
        ),
        (
            [RigidBody("a", BALL, 0.3), RigidBody("b", BALL, 0.3)],
            [ball(-0.08, 0.3, (1, 0.1, 0)), ball(0.08, 0.32, (-0.5, 0, 0))],
            0.2,
            {"restitution": 0.7, "damping": 0.3},
        ),
        ([RigidBody("ball", BALL, 0.3)], [ball(z=0.05, velocity=(0, 0, 0))], 0.2, {"environment": [BELT]}),
        (
            [RigidBody("ball", BALL, 0.3, wrenches=PUSHES)],
            [ball(velocity=(1, 0.2, -0.5))],
            0.2,
            {"restitution": 0.6, "friction": 0.1},
        ),
    ],
    ids=[
        "slips",
        "sticks",
        "stays",
        "slides",
        "rolls",
        "on a sphere",
        "two balls",
        "a belt carries",
        "wrenches",
    ],
)
def test_spreads_of_tight_beliefs_are_those_of_samples(bodies, x, time, more):
    belief = independent(*x, position=5e-4, velocity=5e-3, rotation=5e-3)
    scene = everyday(*bodies, **more)
    found = predict(scene, belief, "linearization", time)
    truth = predict(scene, belief, make_propagator("monte_carlo", samples=SAMPLES), time)
    floors = np.column_stack([np.full(len(bodies), 1e-6), np.full(len(bodies), 1e-5)])
    spreads = (np.maximum(pose_spreads(one.belief.blocks), floors) for one in (found, truth))
    np.testing.assert_allclose(*spreads, rtol=STATISTICS)
    assert all(status.flags == Status.FINE for status in assess(found))


def test_uncertain_friction_is_a_direction():
    """A block slides ``v^2 / (2 mu g)`` far."""
    scene = everyday(RigidBody("box", BLOCK, 0.5, friction=0.4, friction_std=0.02), friction=0.4)
    belief = Belief.of(scene, {"box": BodyBelief(position=(0, 0, 0.02), linear_velocity=(1.0, 0, 0))})
    prediction = predict(scene, belief, "linearization", 0.6)
    assert len(prediction.carry.states) == 3 and not prediction.left_out
    # of the geometric mean with the floor's friction
    expected = 1.0 / (2.0 * 0.4 * G) * 0.5 * 0.02 / 0.4
    assert prediction.body("box").position_std[0] == pytest.approx(expected, rel=0.02)


def test_the_mean_is_the_nominal_rollout():
    scene = everyday(RigidBody("ball", BALL, 0.3), restitution=0.6, friction=0.1)
    belief = independent(ball(z=0.2), position=0.02, velocity=0.1, rotation=0.1)
    wide = predict(scene, belief, "linearization", 0.4)
    certain = predict(scene, independent(ball(z=0.2)), "linearization", 0.4)
    np.testing.assert_allclose(wide.belief.mean, certain.belief.mean, atol=1e-12)
    assert len(wide.carry.states) == 2 * 9 + 1 and len(certain.carry.states) == 1


@pytest.mark.parametrize("block, limit", LIMITS, ids=["position", "rotation", "velocity", "angular velocity"])
def test_points_are_a_tenth_of_a_standard_deviation_away_and_within_limits(block, limit):
    scene, x = everyday(RigidBody("ball", BALL, 0.3)), ball(z=5.0)[None]
    for std, expected in ((limit, REACH), (100.0 * limit, 0.01)):
        P = np.zeros((1, 12, 12))
        P[0, block, block] = std**2 * np.eye(3)
        carry = make_propagator("linearization").init(scene, Belief(x, P))
        np.testing.assert_allclose(carry.reach, expected, rtol=1e-12)


def test_an_uncertain_path_is_within_the_limits():
    hand = RigidBody("hand", BALL, trajectory=SWING, trajectory_std=(0.1, 0, 0, 0, 0, 1.0))
    scene = everyday(RigidBody("ball", BALL, 0.3), hand)
    belief = Belief.of(scene, {"ball": BodyBelief(position=(3.0, 0, 3.0))})
    carry = make_propagator("linearization").init(scene, belief)
    np.testing.assert_allclose(carry.reach, 0.01, rtol=1e-12)
    moved = np.linalg.norm(carry.states[:, 1, :3] - carry.states[0, 1, :3], axis=1)
    assert moved.max() == pytest.approx(1e-3)


@pytest.mark.parametrize("aside, changes", [(0.1, True), (0.2, False)])
def test_an_outcome_that_changes_at_the_mean_is_flagged(aside, changes):
    """Of a ball that flies past another one, and hits it where it flies nearer."""
    bodies = [RigidBody("ball", BALL, 0.3), RigidBody("post", BALL, fixed=True)]
    scene = everyday(*bodies, gravity=None, environment=(), restitution=1.0)
    x = np.array([state((-0.3, aside, 0), (1, 0, 0)), state()])
    belief = Belief(x, np.diag([1e-6] * 3 + [0.0] * 9)[None], [0])
    status = assess(predict(scene, belief, "linearization", 0.8))[0]
    assert bool(status.flags & Status.OUTSIDE_VALIDITY) == changes
    assert ("that of rollouts" in status.message) == changes
