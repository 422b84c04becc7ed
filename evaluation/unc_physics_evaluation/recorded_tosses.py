"""Real tosses of a cube onto a table, recorded by others, and their scene."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from unc_physics.calibration.motions import Motion
from unc_physics.scene.body import RigidBody
from unc_physics.scene.environment import Plane
from unc_physics.scene.scene import Scene
from unc_physics.shapes.rounded_box import rounded_box
from unc_physics.spatial.layout import POSITION, QUATERNION

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

FOLDER = Path(__file__).parent / "data" / "tosses"
FRICTION, RESTITUTION = 0.18, 0.125  # as the authors of the recordings give them
FLOOR = -0.0018  # m, where the lowest corners rest
GRAVITY = 9.81  # m/s^2
STEPS_A_FRAME = 2
_HEADING_FRAMES = 5
CORNER_RADIUS = 1e-4  # m, of a cube whose corners are sharp


class Tosses(NamedTuple):
    """Recorded motions.

    Attributes
    ----------
    states : tuple of (n, 13) float64 arrays
        Frames of each toss, as states of a body.
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
        """Return the time from the first to the last frame of toss k [s]."""
        return (len(self.states[k]) - 1) * self.dt

    def motion(self, k: int, level: Rotation | None = None) -> Motion:
        """Return the poses of toss k, turned by ``level``, in axes with x along its initial heading.

        The published recordings are turned about the vertical at random. Relative to their heading, all
        flights have the same tilt of gravity.
        """
        from scipy.spatial.transform import Rotation  # what only loads the data needs no SciPy

        states, flight = self.states[k], self.states[k][:_HEADING_FRAMES]
        x, y = np.polyfit(np.arange(len(flight)), flight[:, :2], 1)[0]
        turn = Rotation.from_euler("z", -np.arctan2(y, x))
        if level is not None:
            turn = level * turn
        turned = (turn * Rotation.from_quat(states[:, QUATERNION])).as_quat()
        poses = np.concatenate([turn.apply(states[:, POSITION]), turned], axis=1)
        return Motion(f"toss {k}", np.arange(len(states)) * self.dt, poses)

    def level(self, chosen: Sequence[int]) -> Rotation:
        """Return the rotation that levels the table of tosses, fitted to the heights of their ends."""
        from scipy.spatial.transform import Rotation

        ends = np.array([self.motion(k).poses[-1, :3] for k in chosen])
        design = np.column_stack([ends[:, :2], np.ones(len(ends))])
        slope = np.linalg.lstsq(design, ends[:, 2], rcond=None)[0][:2]
        return Rotation.from_rotvec([-slope[1], slope[0], 0.0])

    def rest_height(self, chosen: Sequence[int]) -> float:
        """Return the median final height of the centre above a level table [m]."""
        level = self.level(chosen)
        return float(np.median([self.motion(k, level).poses[-1, 2] for k in chosen]))


@cache
def recorded_tosses(folder: Path = FOLDER) -> Tosses:
    """Read the tosses of a folder; the ``README.md`` of the package's tosses names their source."""
    with np.load(folder / "tosses.npz") as file:
        states = np.split(file["states"].astype(float), file["offsets"][1:-1])
        return Tosses(tuple(states), float(file["dt"]), float(file["half_width"]), float(file["mass"]))


def cube(half_width: float, corner_radius: float, inertia: float = 1.0) -> RigidBody:
    """Return a cube of a size with rounded corners, and an inertia of a multiple of a solid cube's."""
    model = rounded_box(2.0 * half_width, corner_radius, "cube").prefix(8)
    solid = 2.0 / 3.0 * half_width**2
    return RigidBody("cube", model, recorded_tosses().mass, inertia=np.full(3, inertia * solid))


def toss_scene(tosses: Tosses, **changes) -> Scene:
    """Return the cube above the table, with the parameters of the recordings' authors and with changes."""
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
    return Scene(**(given | changes))
