"""Checks of recordings before a fit: the unit of positions, and the order of quaternions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..checks.errors import InvalidRequestError
from ..scene.scene import Scene
from ..shapes.distance import signed_distance
from .flight import moving_body
from .motions import Motion

_MILLIMETRES = 300.0, 3000.0  # how many times gravity flights accelerate; 1000, and errors of short flights
_FIRST_POSES = 10  # in which the acceleration is seen; later ones may have contacts
_RESTS = 3e-3  # m, most distance between a body at its end and what it lies on
_CLEARLY = 5.0  # times that distances with the other order are smaller
_FIRST = [1, 2, 3, 0]  # columns of x, y, z, w in quaternions that begin with w


def check_recording(motions: Sequence[Motion], scene: Scene) -> None:
    """Raise an error for positions in millimetres, and for quaternions whose first number is w.

    Recordings begin in flight, whose acceleration shows the unit. Bodies that lie on something at the end
    show the order: with the wrong one they hover or penetrate.

    Raises
    ------
    InvalidRequestError
        That says what to change in the file.
    """
    fall, own = np.median([_first_acceleration(motion) for motion in motions]), np.linalg.norm(scene.gravity)
    if own and _MILLIMETRES[0] < fall / own < _MILLIMETRES[1]:
        raise InvalidRequestError(
            f"are in millimetres, it seems: they begin with an acceleration of {fall:.3g} m/s^2, where the"
            f" scene's gravity is {own:.3g}; divide them by 1000",
            field="positions of the motions",
        )
    given = np.median([_gap(motion.poses[-1], scene) for motion in motions])
    swapped = [np.concatenate([motion.poses[-1, :3], motion.poses[-1, 3:][_FIRST]]) for motion in motions]
    other = np.median([_gap(pose, scene) for pose in swapped])
    if given > _RESTS and given > _CLEARLY * other:
        raise InvalidRequestError(
            f"are in the order w, x, y, z, it seems: at their ends bodies are {1e3 * given:.2g} mm off what"
            f" they lie on, and {1e3 * other:.2g} mm with that order; write them as x, y, z, w",
            field="quaternions of the motions",
        )


def _first_acceleration(motion):
    """Return the size of the acceleration over the first poses [m/s^2]."""
    times, positions = motion.times[:_FIRST_POSES], motion.poses[:_FIRST_POSES, :3]
    return float(np.linalg.norm(2.0 * np.polyfit(times - times[0], positions, 2)[0]))


def _gap(pose, scene):
    """Return the distance or depth between the body and its surroundings [m]."""
    model = moving_body(scene).model
    gaps = [signed_distance(model, (pose[:3], pose[3:]), one, None)[0] for one in scene.environment]
    return abs(min(gaps, default=0.0))
