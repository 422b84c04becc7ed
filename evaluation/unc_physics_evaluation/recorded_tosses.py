"""Real tosses of a cube onto a table, as recorded by others, and the scene that stands for them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from unc_physics.calibration.motions import Motion
from unc_physics.geometry.rounded_box import rounded_box
from unc_physics.physics.layout import POSITION, QUATERNION
from unc_physics.scene.body import RigidBody
from unc_physics.scene.environment import Plane
from unc_physics.scene.scene import Scene
from unc_physics.scene.stiffness import with_stiffness

FOLDER = Path(__file__).parent / "data" / "tosses"
FRICTION, RESTITUTION = 0.18, 0.125  # as the authors of the recordings give them
FLOOR = -0.0018  # m, where the lowest corners rest
GRAVITY = 9.81  # m/s^2
STEPS_A_FRAME = 2
FACES = 6
CORNER_RADIUS = 1e-4  # m, of a cube whose corners are sharp


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

    def motion(self, k: int) -> Motion:
        """Poses of toss k."""
        states = self.states[k]
        poses = np.concatenate([states[:, POSITION], states[:, QUATERNION]], axis=1)
        return Motion(f"toss {k}", np.arange(len(states)) * self.dt, poses)

    def rest_height(self, chosen: Sequence[int]) -> float:
        """Median height of the centre at the end of some tosses [m]."""
        return float(np.median([self.states[k][-1, 2] for k in chosen]))


@cache
def recorded_tosses() -> Tosses:
    """The tosses of the package's data; ``README.md`` beside them says where they come from."""
    with np.load(FOLDER / "tosses.npz") as file:
        states = np.split(file["states"].astype(float), file["offsets"][1:-1])
        return Tosses(tuple(states), float(file["dt"]), float(file["half_width"]), float(file["mass"]))


def cube(half_width: float, corner_radius: float, inertia: float = 1.0) -> RigidBody:
    """The cube of such a size, with rounded corners, whose inertia is so many times a solid cube's."""
    model = rounded_box(2.0 * half_width, corner_radius, "cube")
    solid = 2.0 / 3.0 * half_width**2
    return RigidBody("cube", model, recorded_tosses().mass, inertia=np.full(3, inertia * solid))


def toss_scene(tosses: Tosses, **changes) -> Scene:
    """The cube above the table, with the numbers that the authors of the recordings give; some changed."""
    given = {
        "bodies": [cube(tosses.half_width, CORNER_RADIUS)],
        "dt": tosses.dt / STEPS_A_FRAME,
        "gravity": (0.0, 0.0, -GRAVITY),
        "environment": [Plane(offset=FLOOR, name="table")],
        "friction": FRICTION,
        "restitution": RESTITUTION,
        "gyroscopic": True,
        "integrator": "implicit",
    }
    return with_stiffness(Scene(**(given | changes)), tosses.states[0][:1])


def top_face(states: np.ndarray) -> np.ndarray:
    """Face on top, of states (..., 13): 0 to 2 where the body's axis x, y, z points up, 3 to 5 where down."""
    x, y, z, w = np.moveaxis(np.asarray(states)[..., QUATERNION], -1, 0)
    up = np.stack([2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)], axis=-1)
    return np.argmax(np.concatenate([up, -up], axis=-1), axis=-1)
