"""Real tosses of a cube onto a table, as recorded by others, and the scene that stands for them."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from unc_physics.geometry.packing_file import SpherePacking
from unc_physics.physics.layout import (
    ERR_ANGULAR_VELOCITY,
    ERR_POSITION,
    ERR_ROTATION,
    ERR_VELOCITY,
    ERROR,
    QUATERNION,
)
from unc_physics.scene.belief import Belief
from unc_physics.scene.body import RigidBody
from unc_physics.scene.environment import Plane
from unc_physics.scene.scene import Scene
from unc_physics.scene.stiffness import with_stiffness

FOLDER = Path(__file__).parent / "data" / "tosses"
FRICTION, RESTITUTION = 0.18, 0.125  # as the authors of the recordings give them
FLOOR = -0.0018  # m, where the lowest corners rest
GRAVITY = 9.81  # m/s^2
DT = 1.0 / 240.0  # s
FACES = 6
CORNER_RADIUS = 1e-4  # m, of the spheres at the corners: the cube's own corners reach out 0.073 mm farther

_FIRST_FRAME = (  # standard deviations: m, rad, m/s, rad/s
    (ERR_POSITION, 1e-3),
    (ERR_ROTATION, 0.01),
    (ERR_VELOCITY, 0.02),
    (ERR_ANGULAR_VELOCITY, 0.15),
)


class Tosses(NamedTuple):
    """Recorded motions.

    Attributes
    ----------
    states : tuple of (n, 13) float64 arrays
        Frames of each toss, in the layout of a body's state.
    dt : float
        Between frames [s].
    half_width : float
        Of the cube [m].
    mass : float
        [kg]
    """

    states: tuple[np.ndarray, ...]
    dt: float
    half_width: float
    mass: float

    def duration(self, k: int) -> float:
        """Time from the first frame of toss k to its last [s]."""
        return (len(self.states[k]) - 1) * self.dt


@cache
def recorded_tosses() -> Tosses:
    """The tosses of the package's data; ``README.md`` beside them says where they come from."""
    with np.load(FOLDER / "tosses.npz") as file:
        states = np.split(file["states"].astype(float), file["offsets"][1:-1])
        return Tosses(tuple(states), float(file["dt"]), float(file["half_width"]), float(file["mass"]))


def cube_packing(half_width: float) -> SpherePacking:
    """A solid cube by what can touch a plane: a small sphere in each corner, against its three faces."""
    corners = np.stack(np.meshgrid(*[(-1.0, 1.0)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    return SpherePacking(
        "cube",
        (half_width - CORNER_RADIUS) * corners,
        np.full(8, CORNER_RADIUS),
        inertia=2.0 / 3.0 * half_width**2 * np.eye(3),
        volume=(2.0 * half_width) ** 3,
        origin=np.zeros(3),
        bounding_radius=np.sqrt(3.0) * half_width,
        bounds=corners[[0, -1]] * half_width,
    )


def toss_scene(tosses: Tosses) -> Scene:
    """The cube above the table."""
    scene = Scene(
        [RigidBody("cube", cube_packing(tosses.half_width), tosses.mass)],
        dt=DT,
        gravity=(0.0, 0.0, -GRAVITY),
        environment=[Plane(offset=FLOOR, name="table")],
        friction=FRICTION,
        restitution=RESTITUTION,
        gyroscopic=True,
        integrator="implicit",
    )
    return with_stiffness(scene, tosses.states[0][:1])


def first_belief(tosses: Tosses, k: int) -> Belief:
    """What the first frame of toss k tells."""
    std = np.empty(ERROR)
    for part, value in _FIRST_FRAME:
        std[part] = value
    return Belief(tosses.states[k][:1], np.diag(std**2)[None])


def top_face(states: np.ndarray) -> np.ndarray:
    """Face on top, of states (..., 13): 0 to 2 where the body's axis x, y, z points up, 3 to 5 where down."""
    x, y, z, w = np.moveaxis(np.asarray(states)[..., QUATERNION], -1, 0)
    up = np.stack([2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)], axis=-1)
    return np.argmax(np.concatenate([up, -up], axis=-1), axis=-1)
