"""What tosses do on the whole, as a prediction: the outcomes of others, from where a toss begins."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from unc_physics.calibration.objective import Recorded
from unc_physics.spatial.layout import POSITION, QUATERNION, VELOCITY


def marginal_predictions(tests: Sequence[Recorded], others: Sequence[Recorded]) -> list[list[np.ndarray]]:
    """For each toss states (n, 13) at its times: how others moved and turned, in the axes of its heading."""
    moves = [_moves(one) for one in others]
    found = []
    for one in tests:
        heading, first = _heading(one), one.start.state
        own = []
        for k in range(len(one.times)):
            last = k == len(one.times) - 1
            used = (
                [(m[0][-1], m[1][-1]) for m in moves]
                if last
                else [(m[0][k], m[1][k]) for m in moves if len(m[0]) > k + 1]
            )
            states = np.zeros((len(used), 13))
            for state, (move, turn) in zip(states, used, strict=True):
                state[POSITION] = first[POSITION] + heading.apply(move)
                turned = heading * turn * heading.inv() * Rotation.from_quat(first[QUATERNION])
                state[QUATERNION] = turned.as_quat()
            own.append(states)
        found.append(own)
    return found


def _heading(one):
    """Rotation about the vertical that takes x to where a toss flies."""
    x, y, _ = one.start.state[VELOCITY]
    return Rotation.from_euler("z", np.arctan2(y, x))


def _moves(one):
    """How far a toss moved (3,), and how it turned, at each of its times, in the axes of its heading."""
    back, first = _heading(one).inv(), Rotation.from_quat(one.start.state[QUATERNION])
    moved = [back.apply(pose[:3] - one.start.state[POSITION]) for pose in one.poses]
    turned = [back * Rotation.from_quat(pose[3:]) * first.inv() * back.inv() for pose in one.poses]
    return moved, turned
