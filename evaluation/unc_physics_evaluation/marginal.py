"""Predictions without physics: the other motions' outcomes, and an object that does not move."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from unc_physics.calibration.objective import Recorded
from unc_physics.spatial.layout import POSITION, QUATERNION, VELOCITY

_HEADS = 0.2  # m/s, from which a throw has a direction


def marginal_prediction(test: Recorded, others: Sequence[Recorded]) -> list[np.ndarray]:
    """Return states (n, 13) at a motion's times: other motions' displacements along their headings."""
    heading, first, found = _heading(test), test.start.state, []
    moves = [_moves(one) for one in others]
    for k in range(len(test.times)):
        is_end = k == len(test.times) - 1
        # a motion that has ended by then lies where it ended
        used = [own[-1 if is_end else min(k, len(own) - 1)] for own in moves]
        states = np.zeros((len(used), 13))
        for state, (move, turn) in zip(states, used, strict=True):
            state[POSITION] = first[POSITION] + heading.apply(move)
            turned = heading * turn * heading.inv() * Rotation.from_quat(first[QUATERNION])
            state[QUATERNION] = turned.as_quat()
        found.append(states)
    return found


def still_prediction(test: Recorded) -> list[np.ndarray]:
    """Return the motion's initial state (1, 13) for each of its times."""
    return [test.start.state[None] for _ in test.times]


def _heading(one):
    """Return the rotation about the vertical from x to a motion's heading."""
    x, y, _ = one.start.state[VELOCITY]
    return Rotation.from_euler("z", np.arctan2(y, x) if np.hypot(x, y) > _HEADS else 0.0)


def _moves(one):
    """Return a motion's displacement (3,) and rotation at each of its times, in the axes of its heading."""
    back, first = _heading(one).inv(), Rotation.from_quat(one.start.state[QUATERNION])
    return [
        (
            back.apply(pose[:3] - one.start.state[POSITION]),
            back * Rotation.from_quat(pose[3:]) * first.inv() * back.inv(),
        )
        for pose in one.poses
    ]
