"""Random everyday scenes: one object, or two that collide, with beliefs from tight to wide."""

from __future__ import annotations

import math

import numpy as np

from unc_physics import Belief, Box, Plane, RigidBody, Scene, load_model
from unc_physics.spatial.layout import ANGULAR_VELOCITY, POSITION, QUATERNION, VELOCITY
from unc_physics.spatial.rotation import rotation_matrix

from .everyday_cases import Case
from .scenarios import resting, spread

SPHERES = 300
MODELS = ("brick", "salt_box", "can", "mug", "bottle", "bowl", "plate", "rounded_box")
#: Standard deviations of position [m], rotation [rad], velocity [m/s] and spin [rad/s]: from, to.
_STDS = {"position": (1e-3, 3e-2), "rotation": (1e-2, 0.3), "velocity": (1e-2, 0.2), "spin": (3e-2, 0.5)}
_HORIZON = (0.3, 1.0)  # s
_DROP = (0.01, 0.15)  # m
_SPEED = (0.1, 0.8)  # of what is pushed or thrown [m/s]
_TABLE, _WALL = 0.4, 0.02  # height of a table, thickness of walls [m]


def random_case(number: int) -> Case:
    """Return the scene of a number: a drop, a push on a table, a throw at a wall, or a drop beside a body."""
    rng = np.random.default_rng([19, number])
    kind = KINDS[number % len(KINDS)]
    models = [
        load_model(name).prefix(SPHERES) for name in rng.choice(MODELS, size=2 if kind is _beside else 1)
    ]
    mean, environment = kind(rng, models)
    bodies = [RigidBody(f"body{k}", model) for k, model in enumerate(models)]
    stds = {name: log_uniform(rng, *limits) for name, limits in _STDS.items()}
    scene = Scene.everyday(bodies, exact=True, environment=[Plane(name="floor"), *environment])
    return Case(scene, Belief(mean, spread(len(bodies), **stds)), log_uniform(rng, *_HORIZON))


def _dropped(rng, models):
    """Drop an object in any orientation, with a spin."""
    mean = state_above(rng, models[0], log_uniform(rng, *_DROP), upright=False)
    mean[0, ANGULAR_VELOCITY] = rng.normal(0.0, 1.0, 3)
    return mean, []


def _pushed(rng, models):
    """Push an object that stands near the edge of a table towards the edge."""
    mean = state_above(rng, models[0], 1e-4, upright=True)
    mean[0, POSITION] += rng.uniform(-0.15, -0.02), 0.0, _TABLE
    mean[0, VELOCITY] = log_uniform(rng, *_SPEED), 0.0, 0.0
    return mean, [Box((0.8, 0.8, _WALL), (-0.4, 0.0, _TABLE - 0.5 * _WALL), name="table")]


def _thrown(rng, models):
    """Throw an object towards a wall."""
    mean = state_above(rng, models[0], log_uniform(rng, *_DROP), upright=False)
    mean[0, VELOCITY] = log_uniform(rng, *_SPEED), rng.normal(0.0, 0.1), 0.0
    wall = 2.0 * models[0].bounding_radius + rng.uniform(0.0, 0.1)
    return mean, [Box((_WALL, 1.0, 0.4), (wall, 0.0, 0.2), name="wall")]


def _beside(rng, models):
    """Drop an object beside or onto another one."""
    standing = state_above(rng, models[0], 1e-4, upright=True)
    falling = state_above(rng, models[1], log_uniform(rng, *_DROP), upright=False)
    radius = models[0].bounding_radius
    falling[0, POSITION] += rng.uniform(0.0, radius), rng.uniform(0.0, radius), 2.0 * radius
    return np.concatenate([standing, falling]), []


#: By turns.
KINDS = (_dropped, _pushed, _thrown, _beside)


def state_above(rng, model, height, upright):
    """Return a state (1, 13) at rest at a height above the floor."""
    q = rng.standard_normal(4)
    if upright:
        q = np.array([0.0, 0.0, math.sin(q[0]), math.cos(q[0])])
    mean = resting([[0.0, 0.0, 0.0]])
    mean[0, QUATERNION] = q / np.linalg.norm(q)
    down = rotation_matrix(mean[0, QUATERNION])[2]
    mean[0, POSITION] = 0.0, 0.0, height + float(np.max(model.radii - model.centers @ down))
    return mean


def log_uniform(rng, low, high):
    """Return a number that is uniform in its logarithm."""
    return math.exp(rng.uniform(math.log(low), math.log(high)))
