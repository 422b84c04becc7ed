"""Everyday motions of single bodies with tight and wide beliefs: rest, slides, bounces, rolling, pushes."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from unc_physics import Belief, Plane, PosePath, RigidBody, Scene, load_model
from unc_physics.scene.kinematic_states import with_kinematic
from unc_physics.shapes.packing_file import SpherePacking
from unc_physics.shapes.primitive_models import ball
from unc_physics.spatial.layout import ANGULAR_VELOCITY, POSITION, QUATERNION, VELOCITY
from unc_physics.spatial.rotation import rotation_matrix

from .scenarios import resting, spread

MASS = 0.4  # kg
BALL_RADIUS = 0.05  # m
SLOPE = math.radians(20.0)  # of the incline; friction 0.5 holds up to 26.6 degrees
SPEED = 0.3  # of what is pushed or rolls [m/s]
#: Standard deviations of position [m], rotation [rad] and velocity [m/s] of each belief.
BELIEFS = {"tight": (1e-3, 1e-2, 1e-2), "wide": (1e-2, 5e-2, 5e-2), "very wide": (3e-2, 0.3, 0.2)}


class Case(NamedTuple):
    """A scene to predict."""

    scene: Scene
    belief: Belief
    horizon: float


def names() -> list[str]:
    """Return the names of all motions with each belief."""
    return [f"{motion}, {belief}" for motion in CASES for belief in BELIEFS]


def case(name: str, belief: str) -> Case:
    """Return a case by its name, with one of the beliefs."""
    scene, mean, horizon = (CASES | ACTION_CASES)[name]()
    position, rotation, velocity = BELIEFS[belief]
    P = spread(1, position=position, rotation=rotation, velocity=velocity)
    mean = with_kinematic(scene, np.concatenate([mean, resting(np.zeros((len(scene.bodies) - 1, 3)))]), 0.0)
    return Case(scene, Belief(mean, P, scene.moving), horizon)


def _everyday(model, floor=None, at_rest=False, **physics):
    """Return a case of one body on a plane."""
    body = RigidBody("body", model, MASS, at_rest=at_rest)
    return Scene.everyday([body], exact=True, environment=[floor or Plane(name="floor")], **physics)


def lowest(model: SpherePacking, q=(0.0, 0.0, 0.0, 1.0)) -> float:
    """Return the depth of a model's lowest point below its centre of mass [m]."""
    return float(np.max(model.radii - model.centers @ rotation_matrix(q)[2]))


def _state(height, velocity=(0.0, 0.0, 0.0), spin=(0.0, 0.0, 0.0), q=(0.0, 0.0, 0.0, 1.0)):
    """Return a state (1, 13) at a height above the origin."""
    mean = resting([[0.0, 0.0, height]])
    mean[0, VELOCITY], mean[0, ANGULAR_VELOCITY], mean[0, QUATERNION] = velocity, spin, q
    return mean


def brick() -> SpherePacking:
    """Return the model that lies, slides and lands."""
    return load_model("brick").prefix(500)


def _lying():
    model = brick()
    return _everyday(model, at_rest=True), _state(lowest(model)), 0.5


def _pushed():
    model = brick()
    return _everyday(model), _state(lowest(model), (SPEED, 0.0, 0.0)), 0.03


def _sliding_to_rest():
    scene, mean, _ = _pushed()
    return scene, mean, 0.5


def _on_incline():
    model = brick()
    normal = np.array([-math.sin(SLOPE), 0.0, math.cos(SLOPE)])
    mean = _state(0.0, q=(0.0, -math.sin(0.5 * SLOPE), 0.0, math.cos(0.5 * SLOPE)))
    mean[0, POSITION] = lowest(model) * normal
    return _everyday(model, Plane(normal, name="incline"), at_rest=True), mean, 0.5


def _ball_bounces(restitution, horizon):
    model = ball(BALL_RADIUS)
    mean = _state(BALL_RADIUS + 0.2, (0.5, 0.0, 0.0), (1.0, 0.0, 0.0))
    return _everyday(model, restitution=restitution), mean, horizon


def _box_bounces():
    model = brick()
    return _everyday(model, restitution=0.5), _state(lowest(model) + 0.1), 0.25


def _can_rolls():
    model, q = load_model("can").prefix(1000), (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))
    height = lowest(model, q)
    return _everyday(model), _state(height, (SPEED, 0.0, 0.0), (0.0, SPEED / height, 0.0), q), 0.5


def _finger():
    """Return a finger that moves along x beside the middle, touches after about 0.1 s and pushes 2 cm."""
    model = brick()
    reach, height = float(np.max(model.radii - model.centers[:, 0])) + 0.02, lowest(model)
    line = PosePath(
        times=[0.0, 0.5], positions=[[-reach - 0.005, 0.01, height], [-reach + 0.02, 0.01, height]]
    )
    scene = _everyday(model, at_rest=True)
    finger = RigidBody("finger", ball(0.02), trajectory=line)
    return replace(scene, bodies=[*scene.bodies, finger]), _state(height), 0.4


#: What makes each case: scene, mean state of the body and horizon.
CASES = {
    "box lying": _lying,
    "box pushed at 0.3 m/s": _pushed,
    "box sliding to rest": _sliding_to_rest,
    "box on an incline": _on_incline,
    "ball after one bounce": lambda: _ball_bounces(0.7, 0.3),
    "ball after three bounces": lambda: _ball_bounces(0.8, 1.1),
    "box after a bounce on a face": _box_bounces,
    "can rolling": _can_rolls,
}
#: The same where a robot acts.
ACTION_CASES = {"finger pushes a box": _finger}
