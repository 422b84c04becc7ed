"""Linearization of what a robot does against central differences: paths, belts, wrenches, spins, releases."""

import math

import numpy as np
import pytest
from derivatives import CLOSE, assert_derivative_of_steps, derivative, difference
from plain_scenes import BALL, BLOCK, PLATE, packing, run, state, world
from scipy.spatial.transform import Rotation
from twins.states import boxminus

from unc_physics import Plane, PosePath, RigidBody, Wrench
from unc_physics.dynamics import contact_history
from unc_physics.dynamics.rollout import rollout
from unc_physics.scene.kinematic_states import path_states, start_states
from unc_physics.scene.parameters import vary
from unc_physics.scene.stiffness import with_stiffness

DEPTH = 2.5e-5  # m, about as deep as a block lies
OFF = (0.01, 0.02, 0.03, 0.1, 0.2, 0.3)  # m, rad
WALL = packing("wall", [[-1.0, 0, 0]], [1.0], np.eye(3))
FINGER = BALL.scaled(0.2)
#: Its friction and the moment against its spin do not depend on each other, so that both are solved at once.
DISC = packing("disc", [[0, 0, 0]], [0.05], 4e-4 * np.eye(3))
BELT = Plane(
    surface_velocity=(0.5, 0.1, 3.0), surface_angular_velocity=(0, 0, 1.0), surface_center=(0.2, 0, 0)
)
STRAIGHT = Plane(surface_velocity=(0.5, 0.1, 3.0))
ROUGH = Plane(torsional_friction=0.002)
SWING = PosePath(  # faster and faster, and turning
    times=[0, 0.4],
    positions=[[-0.3, -0.02, 0.01], [0.3, 0.05, 0.01]],
    orientations=Rotation.from_rotvec([[0, 0, 0.1], [0, 0.2, 0.5]]).as_quat(),
    linear_velocities=[[1.0, 0.2, 0.05], [2.5, 0.1, 0.0]],
    angular_velocities=[[0, 0.5, 1.0], [0.3, 0, 2]],
)
HAND = PosePath(
    times=[0, 0.25, 0.6],
    positions=[[0, 0, 0.5], [0.2, 0.1, 0.6], [0.5, 0.1, 0.7]],
    orientations=Rotation.from_rotvec([[0.1, 0, 0], [0.3, 0.4, 0.2], [0, 0.8, 0.3]]).as_quat(),
)
PUSHES = [  # from and until times within steps
    Wrench(force=(0.5, 0.8, 0.1), torque=(1e-3, 2e-3, 5e-3), start=0.001, duration=0.1),
    Wrench(force=(0, 0.3, 0), torque=(0, 1e-3, 1e-3), start=0.006, body_axes=True),
]


def varied(scene, x, time, length):
    """(12 M, K): central differences of a rollout by the scene's uncertain parameters."""
    columns, z = [], length * np.eye(len(scene.uncertain))
    for direction in z:
        ends = []
        for own in (direction, -direction):
            states, its = start_states(scene, x[None].copy(), own[None]), vary(scene, own)
            rollout(states, contact_history.fresh(1, its), its, 0, round(time / scene.dt))
            ends.append(states[0])
        columns.append(boxminus(*ends)[scene.moving].ravel() / (2.0 * length))
    return np.array(columns).T


def begun(scene, x):
    """The scene with its stiffness, and the state (B, 13) with kinematic bodies on their paths."""
    x = np.array(x, float)
    for k, body in enumerate(scene.bodies):
        if body.trajectory is not None:
            x[k] = path_states(scene, k, [0.0])[0]
    return with_stiffness(scene, x), x


thrown = state((0.05, 0, 0), (-0.3, 0.1, 0.2), (1, 2, 3))
lying = state((0, 0, 0.05 - DEPTH), (1, 0.2, 0), (0, 5, 1))
in_hand = state((0.1, 0.05, 0.4), orientation=Rotation.from_rotvec([0.1, 0.2, 0.3]).as_quat())
held = {"attached_to": "hand", "released_at_std": 0.1}
wall = RigidBody("wall", WALL, trajectory=SWING, trajectory_std=OFF)
hand = RigidBody("hand", FINGER, trajectory=HAND, trajectory_std=OFF)


@pytest.mark.parametrize(
    "bodies, x, time, more",
    [
        ([RigidBody("ball", BALL, 0.3), wall], [thrown, thrown], 0.3, {"restitution": 0.7, "friction": 0.1}),
        ([RigidBody("ball", BALL, 0.3), wall], [thrown, thrown], 0.3, {"friction": 0.9, "gravity": None}),
        (
            [RigidBody("ball", BALL, 0.3), RigidBody("other", BALL, fixed=True)],
            [state((0, 0, 0.3), (0.1, 0, -0.5), (1, 2, 3)), state((0.01, 0.005, 0))],
            0.4,
            {"restitution": 0.5, "friction": 0.2},
        ),
        ([RigidBody("ball", BALL, 0.3)], [lying], 0.2, {"friction": 0.1, "environment": [BELT]}),
        ([RigidBody("ball", BALL, 0.3)], [lying], 0.3, {"friction": 0.8, "environment": [BELT]}),
        ([RigidBody("plate", PLATE, 0.5, wrenches=PUSHES)], [in_hand], 0.3, {}),
        (
            [RigidBody("ball", BALL, 0.3, wrenches=PUSHES)],
            [state((0, 0, 0.1), (1, 0.2, -0.5), (3, -2, 5))],
            0.2,
            {"restitution": 0.6, "friction": 0.1, "environment": [Plane()]},
        ),
        ([RigidBody("plate", PLATE, 0.05, wrenches=PUSHES[:1], drag=0.1)], [in_hand], 0.3, {}),
        (
            [RigidBody("ball", BALL, 0.03, drag=0.1)],
            [state((0, 0, 0.1), (1, 0.2, -0.5), (3, -2, 5))],
            0.2,
            {"restitution": 0.6, "friction": 0.1, "environment": [Plane()]},
        ),
        ([RigidBody("disc", DISC, 0.7)], [lying], 0.2, {"friction": 0.1, "environment": [ROUGH]}),
        ([RigidBody("disc", DISC, 0.7)], [lying], 0.4, {"friction": 0.8, "environment": [ROUGH]}),
        (
            [RigidBody("mug", PLATE, 0.3, released_at=0.3041, **held), hand],
            [in_hand] * 2,
            0.5,
            {"damping": 0.5},
        ),
        (  # a body that keeps its momentum is thrown a little else within a step than at its end
            [RigidBody("mug", PLATE, 0.3, released_at=0.3, **held), hand],
            [in_hand] * 2,
            0.5,
            {"gyroscopic": False},
        ),
        (
            [RigidBody("ball", BALL, 0.3, attached_at=0.1013, released_at=0.3041, **held), hand],
            [state((0.1, 0.05, 0.3), (0.2, 0.1, 1.0), (1, 2, 3))] * 2,
            0.5,
            {},
        ),
        (
            [RigidBody("ball", BALL, 0.3), RigidBody("bat", BALL, 0.3, attached_to="hand"), hand],
            [state((0.3, 0.15, 0.42), (-0.3, 0.1, 0.2), (1, 2, 3)), in_hand, in_hand],
            0.4,
            {"restitution": 0.7, "friction": 0.1, "gravity": (0, 0, -1)},
        ),
    ],
    ids=[
        "a moving wall throws a ball",
        "one that does not slip",
        "a fixed ball",
        "a belt that turns",
        "it carries",
        "wrenches in flight",
        "wrenches and a bounce",
        "drag in flight",
        "drag and a bounce",
        "a disc spins down",
        "until it rolls",
        "a hand lets go",
        "at a step's end",
        "a hand closes and lets go",
        "a bat in a hand",
    ],
)
def test_a_rollout_s_derivative_is_that_of_differences(bodies, x, time, more):
    """By the state, and by offsets of paths and times of release."""
    scene, x = begun(world(*bodies, **{"environment": ()} | more), x)
    found = difference(lambda s: run(scene, s, time), x, scene.moving, 1e-6)
    found = np.concatenate([found, varied(scene, x, time, 1e-6).reshape(len(found), -1)], axis=1)
    np.testing.assert_allclose(derivative(scene, x, time), found, rtol=0, atol=CLOSE * np.abs(found).max())


block = RigidBody("box", BLOCK, 0.5)
#: Beside a sphere of the block's side, a little above its place and along it, so that it pushes and turns it.
SLOWLY = PosePath(
    times=[0, 1],
    positions=[[-0.06 - math.sqrt(0.0004 - 9e-6) + 1e-5, 0.023, 0.03], [0.1, 0.04, 0.03]],
    linear_velocities=[[0.2, 0.02, 0], [0.1, 0, 0]],
    angular_velocities=[[0, 0, 1.0], [0.3, 0, 2]],
)


@pytest.mark.parametrize(
    "bodies, velocity, floor, friction",
    [
        ([block, RigidBody("finger", FINGER, trajectory=SLOWLY)], (0.2, 0.02, 0), Plane(), 0.3),
        ([block], (0, 0, 0), BELT, 0.2),
        ([block], (0.5, 0.1, 0), STRAIGHT, 0.5),
        ([RigidBody("box", BLOCK, 0.5, wrenches=PUSHES)], (0.5, 0.1, 0), Plane(), 0.2),
    ],
    ids=["a finger pushes", "a belt drags", "a belt carries", "wrenches push"],
)
def test_a_block_s_steps_have_the_derivative_of_differences(bodies, velocity, floor, friction):
    x = [state((0, 0, 0.02 - DEPTH), velocity)] + [state()] * (len(bodies) - 1)
    scene, x = begun(world(*bodies, environment=[floor], friction=friction, gyroscopic=False), x)
    assert_derivative_of_steps(scene, x, 3)
