"""What a robot does to single bodies, with tight and wide beliefs: pushes, belts, releases, throws."""

from __future__ import annotations

import math

import numpy as np

from unc_physics import Belief, Plane, PosePath, RigidBody, Scene, Wrench, load_model
from unc_physics.scene.action_arrays import with_driven

from .everyday_cases import BELIEFS, MASS, Case, ball, brick, lowest
from .scenarios import resting, spread

BELT_SPEED, HAND_SPEED = 0.4, 0.5  # m/s
TURN = (0.0, 0.0, 1.0)  # of the hand while it swings [rad]


def case(name: str, belief: str) -> Case:
    """A case by its name, with one of the beliefs."""
    scene, mean, horizon = ACTION_CASES[name]()
    position, rotation, velocity = BELIEFS[belief]
    P = spread(1, position=position, rotation=rotation, velocity=velocity)
    mean = with_driven(scene, np.concatenate([mean, resting(np.zeros((len(scene.bodies) - 1, 3)))]), 0.0)
    return Case(scene, Belief(mean, P, scene.moving), horizon)


def _brick_scene(floor=None, others=(), **body):
    """A brick at rest on a plane, and its mean state."""
    model = brick()
    lying = RigidBody("body", model, MASS, at_rest=True, **body)
    scene = Scene.everyday([lying, *others], environment=[floor or Plane(name="floor")])
    return scene, resting([[0.0, 0.0, lowest(model)]])


def _pushed():
    """A finger comes along x beside the middle, touches after about 0.1 s, and pushes for 2 cm."""
    model = brick()
    reach, height = float(np.max(model.radii - model.centers[:, 0])) + 0.02, lowest(model)
    places = [[-reach - 0.005, 0.01, height], [-reach + 0.02, 0.01, height]]
    line = PosePath(times=[0.0, 0.5], positions=places)
    finger = RigidBody("finger", ball("finger", 0.02), trajectory=line)
    scene, mean = _brick_scene(others=[finger])
    return scene, mean, 0.4


def _on_belt(horizon):
    """The belt drags it for 0.08 s, then carries it."""
    scene, mean = _brick_scene(Plane(name="belt", surface_velocity=(BELT_SPEED, 0.0, 0.0)))
    return scene, mean, horizon


def _forced():
    wrench = Wrench(force=(3.0, 0.5, 0.0), torque=(0.0, 0.0, 0.02), start=0.05, duration=0.2)
    scene, mean = _brick_scene(wrenches=[wrench])
    return scene, mean, 0.3


def _disc():
    disc = RigidBody("body", ball("disc", 0.05, 0.5), MASS)
    scene = Scene.everyday([disc], environment=[Plane(name="floor", torsional_friction=0.002)])
    mean = resting([[0.0, 0.0, 0.05]])
    mean[0, 12] = 10.0
    return scene, mean, 0.3


def _swing(time):
    """A hand's path along x, upwards, and turning."""
    half = 0.5 * np.linalg.norm(TURN)
    there = [0.5 * HAND_SPEED * time, 0.0, 1.0 + 0.3 * HAND_SPEED * time]
    turned = [*(math.sin(half) * np.array(TURN) / np.linalg.norm(TURN)), math.cos(half)]
    return PosePath(
        times=[0.0, time],
        positions=[[0.0, 0.0, 1.0], there],
        orientations=[[0.0, 0.0, 0.0, 1.0], turned],
        linear_velocities=[[0.0, 0.0, 0.0], [HAND_SPEED, 0.0, 0.3 * HAND_SPEED]],
    )


def _released():
    """A mug is released at 0.3 s, known to 5 ms, by a hand that swings, whose path is known to 1 mm."""
    held = {"attached_to": "hand", "released_at": 0.3, "released_at_std": 0.005}
    mug = RigidBody("body", load_model("mug").prefix(500), MASS, **held)
    off = [1e-3] * 3 + [0.01] * 3
    hand = RigidBody("hand", ball("hand", 0.02), trajectory=_swing(0.4), trajectory_std=off)
    return Scene.everyday([mug, hand]), resting([[0.05, 0.02, 0.9]]), 0.6


def _thrown():
    """A ball that flies meets a wall, a large sphere, that comes faster and faster."""
    path = PosePath(
        times=[0.0, 0.4],
        positions=[[-1.25, 0.0, 0.5], [-0.95, 0.0, 0.5]],
        linear_velocities=[[0.5, 0.0, 0.0], [1.5, 0.0, 0.0]],
    )
    wall = RigidBody("wall", ball("wall", 1.0), trajectory=path, trajectory_std=[1e-3, 0, 0, 0, 0, 0])
    thrown = RigidBody("body", ball("ball", 0.05), MASS)
    mean = resting([[0.0, 0.0, 0.6]])
    mean[0, 3:6] = -0.5, 0.2, 0.5
    return Scene.everyday([thrown, wall], restitution=0.7, friction=0.2), mean, 0.5


#: What makes each case: scene, mean state of the body and horizon.
ACTION_CASES = {
    "finger pushes a box": _pushed,
    "belt drags a box": lambda: _on_belt(0.07),
    "belt carries a box": lambda: _on_belt(0.5),
    "wrench pushes a box": _forced,
    "disc spins down": _disc,
    "hand lets go of a mug": _released,
    "moving wall throws a ball": _thrown,
}
