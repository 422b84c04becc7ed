"""A push, a belt and a release with things that every engine knows: boxes, cylinders, balls."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from unc_physics import Belief, BodyBelief, Box, Plane, PosePath, RigidBody, Scene, load_model
from unc_physics.physics.layout import QUATERNION

from .everyday_cases import ball
from .limit_surface import Contact, step
from .scenarios import open_bin

_FRICTION, _FENCE, _SPHERES = 0.3, math.radians(30.0), 1000
_TURNED = math.radians(20.0)
_FINGER, _FINGER_RADIUS, _WAY = (-0.06, 0.01), 0.01, 0.1  # m: where it begins, beside the middle
_BELT = 0.3  # m/s
_STEPS = 500  # of the limit surface
_BIN = 0.30, 0.20, 0.147  # m, inside
_RELEASED, RELEASED_STD = 0.5, 0.02  # s


class ActionScene(NamedTuple):
    """A scene whose first body something is done to.

    Attributes
    ----------
    asked : str
        What is decided.
    happened : callable
        Whether it came so, of states (n, 13) of the first body at the horizon.
    scene : Scene
    belief : Belief
    horizon : float
        [s]
    """

    asked: str
    happened: Callable[[np.ndarray], np.ndarray]
    scene: Scene
    belief: Belief
    horizon: float


def push() -> ActionScene:
    """A ball pushes a salt box that lies on a table by 8 cm, 1 cm beside its middle, so that it turns."""
    box = RigidBody("salt_box", load_model("salt_box").prefix(_SPHERES), 0.52, at_rest=True)
    (start, aside), radius, way = _FINGER, _FINGER_RADIUS, _WAY
    path = PosePath(times=[0.2, 2.2], positions=[[start, aside, 0.024], [start + way, aside, 0.024]])
    finger = RigidBody("finger", ball("finger", radius), trajectory=path)
    scene = Scene.everyday([box, finger], environment=[Plane()], friction=_FRICTION)
    half = math.sqrt(0.5)
    lying = BodyBelief(
        position=(0.0, 0.0, 0.024),
        orientation=(half, 0.0, 0.0, half),
        position_std=(0.004, 0.004, 0.0),
        orientation_std=(0.0, 0.03, 0.0),
    )
    belief = Belief.of(scene, {"salt_box": lying})
    return ActionScene("turns by more than 20 degrees", lambda x: _turned(x) > _TURNED, scene, belief, 2.5)


def turn_of_push(even: bool) -> float:
    """By how much a limit surface turns the box of `push` from its mean place, clockwise from above [rad].

    With an even load, or with one at the corners: which it is, statics does not say.
    """
    model, way = load_model("salt_box"), np.array([_WAY / _STEPS, 0.0])
    x, y = model.bounds[1][0], model.bounds[1][2]  # half sides of the face it lies on
    share = (np.arange(_STEPS) + 0.5) / _STEPS
    points = np.stack(np.meshgrid(x * share, y * share), axis=-1)
    reach = float(np.linalg.norm(points, axis=-1).mean()) if even else math.hypot(x, y)
    place, tip = np.zeros(3), np.array(_FINGER)
    for _ in range(_STEPS):
        normal = np.array([math.cos(place[2]), math.sin(place[2])])
        gap = float((place[:2] - tip) @ normal) - x - _FINGER_RADIUS
        contact = Contact(gap, normal, tip + _FINGER_RADIUS * normal - place[:2])
        place, tip = place + step([contact], way[None], reach, _FRICTION), tip + way
    return -float(place[2])


def belt() -> ActionScene:
    """A belt carries a can against a fence that is askew, along which it slides."""
    can = RigidBody("can", load_model("can").prefix(_SPHERES), 0.455, at_rest=True)
    turned = (0.0, 0.0, -math.sin(0.5 * _FENCE), math.cos(0.5 * _FENCE))
    solids = [
        Box((3.0, 0.6, 0.1), (0.5, 0.0, -0.05), surface_velocity=(_BELT, 0.0, 0.0)),
        Box((0.6, 0.02, 0.1), (0.45, 0.12, 0.05), turned),
    ]
    scene = Scene.everyday([can], environment=solids, friction=_FRICTION)
    standing = BodyBelief(
        position=(0.0, 0.1, 0.0552), position_std=(0.01, 0.02, 0.0), orientation_std=(0.0, 0.0, 0.1)
    )
    belief = Belief.of(scene, {"can": standing})
    return ActionScene("comes past 0.59 m", lambda x: x[:, 0] > 0.59, scene, belief, 2.5)


def release() -> ActionScene:
    """A hand that moves past a bin lets go of a salt box above it, at a time known to 20 ms."""
    held = {"attached_to": "hand", "released_at": _RELEASED, "released_at_std": RELEASED_STD}
    box = RigidBody("salt_box", load_model("salt_box").prefix(_SPHERES), 0.52, **held)
    path = PosePath(times=[0.0, 1.0], positions=[[-0.30, 0.0, 0.45], [0.10, 0.0, 0.45]])
    hand = RigidBody("hand", ball("hand", 0.02), trajectory=path)
    scene = Scene.everyday([box, hand], environment=open_bin(*_BIN), restitution=0.2)
    grasped = BodyBelief(position=(-0.32, 0.0, 0.30), position_std=0.003, orientation_std=0.03)
    belief = Belief.of(scene, {"salt_box": grasped})
    return ActionScene("stands in the bin", _stands_in_bin, scene, belief, 1.5)


def _stands_in_bin(x):
    inside = np.abs(x[:, :2]) < 0.5 * np.array(_BIN[:2])
    up = Rotation.from_quat(x[:, QUATERNION]).apply([0.0, 0.0, 1.0])[:, 2]
    return inside.all(axis=1) & (x[:, 2] < _BIN[2]) & (up > math.cos(math.radians(45.0)))


def _turned(x):
    """Angles (n,) by which boxes that lay along x have turned on the table [rad]."""
    ways = Rotation.from_quat(x[:, QUATERNION]).apply([1.0, 0.0, 0.0])
    return np.abs(np.arctan2(ways[:, 1], ways[:, 0]))


#: What makes each scene.
ACTION_SCENES = {"push": push, "belt": belt, "release": release}
