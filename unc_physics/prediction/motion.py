"""What rollouts move with on average, of which a status tells whether they gained energy."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..physics.layout import ANGULAR_VELOCITY, POSITION, VELOCITY


class Motion(NamedTuple):
    """Means over the rollouts of a prediction, at one time.

    Attributes
    ----------
    position : (B, 3) array
        [m].
    speed_squares : (B,) array
        Of velocities [m^2/s^2].
    spin_squares : (B,) array
        Of angular velocities [rad^2/s^2].
    """

    position: np.ndarray
    speed_squares: np.ndarray
    spin_squares: np.ndarray


def motion_of(states: np.ndarray) -> Motion:
    """That of states (N, B, 13)."""
    speed, spin = (
        np.einsum("nbi,nbi->b", part, part) / len(states)
        for part in (states[..., VELOCITY], states[..., ANGULAR_VELOCITY])
    )
    return Motion(states[..., POSITION].mean(axis=0), speed, spin)
