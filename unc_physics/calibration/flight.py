"""Initial state of a recorded motion, fitted to the first poses, in which the body flies freely."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..checks.errors import InvalidRequestError
from ..scene.belief import Belief
from ..scene.body import RigidBody
from ..scene.scene import Scene
from ..shapes.distance import signed_distance
from ..spatial.layout import (
    ANGULAR_VELOCITY,
    ERR_ANGULAR_VELOCITY,
    ERR_POSITION,
    ERR_ROTATION,
    ERR_VELOCITY,
    ERROR,
    POSITION,
    QUATERNION,
    STATE,
    VELOCITY,
)
from ..spatial.quaternions import inverse as inverse_of
from ..spatial.quaternions import product, rotation_vectors
from ..spatial.rotation import exp_vectors, rotation_matrix
from .motions import Motion

FRAMES = 8  # of the first poses, at most, that the start is fitted to
MARGIN = 2e-3  # least distance of a flying body from the environment [m]
_FEWEST = 3
_LONG_FLIGHT = 10  # poses from which gravity is estimated
_UNUSUAL = 3.0  # residuals of a flight, relative to the median of all flights
_OF_MEDIAN = 1.25  # standard deviation of the median of many normal numbers, relative to that of their mean
_ROUNDS = 20  # at most, of the fit, which is linear but for the turning
_ROUND = 1e-9  # relative difference of principal moments that count as equal
_SETTLED = 1e-9  # rad, rad/s
_STEP = 5e-3  # of free turning [s]


class FlightStart(NamedTuple):
    """State of a motion at time 0, fitted to its first poses."""

    state: np.ndarray  # (13,): as in `Belief`
    #: position_factor, rotation_factor: (12, 12): covariance of the error state for positions that err
    #: by 1 m, and for rotations by 1 rad, each pose independently
    position_factor: np.ndarray
    rotation_factor: np.ndarray
    frames: int  # number of the poses
    #: position_squares, rotation_squares: sums of the squared residuals [m^2], [rad^2]
    position_squares: float
    rotation_squares: float
    freedom: int  # their degrees of freedom

    def belief(self, position_noise: float, rotation_noise: float) -> Belief:
        """Return the belief at time 0 for pose errors of these standard deviations [m], [rad]."""
        P = position_noise**2 * self.position_factor + rotation_noise**2 * self.rotation_factor
        return Belief(self.state[None], P[None])


class FlightGravity(NamedTuple):
    """Acceleration of free flights."""

    acceleration: np.ndarray  # (3,): world axes [m/s^2]
    std: np.ndarray  # (3,): of its error [m/s^2]


def moving_body(scene: Scene) -> RigidBody:
    """Return the only body of a scene; raise `InvalidRequestError` if there are several, or it is fixed."""
    if len(scene.bodies) != 1 or not len(scene.moving):
        names = [body.name for body in scene.bodies]
        raise InvalidRequestError(
            "must be one that moves, as the motions are of one body", field="bodies", value=names
        )
    return scene.bodies[0]


def flight_frames(motion: Motion, scene: Scene) -> int:
    """Return how many of a motion's first poses precede its first contact with the environment.

    Such a pose keeps the `MARGIN` to all elements, and so does its prediction by free flight from the two
    poses before. The recorded pose alone may follow a bounce between two frames.
    """
    model = moving_body(scene).model
    for k, pose in enumerate(motion.poses):
        poses = [pose] if k < 2 else [pose, _pose_ahead(motion, k, scene.gravity)]
        for own in poses:
            pose = own[:3], own[3:]
            if any(signed_distance(model, pose, one, None)[0] < MARGIN for one in scene.environment):
                return k
    return len(motion.poses)


def _pose_ahead(motion, k, gravity):
    """Return the pose (7,) to which free flight at constant spin leads from the two poses before pose k."""
    (first, second), (before, step) = motion.poses[k - 2 : k], np.diff(motion.times[k - 2 : k + 1])
    position = second[:3] + step / before * (second[:3] - first[:3]) + 0.5 * step * (step + before) * gravity
    turn = rotation_vectors(product(second[3:], inverse_of(first[3:])))
    return np.concatenate([position, product(exp_vectors(step / before * turn), second[3:])])


def fit_start(motion: Motion, scene: Scene, frames: int = FRAMES) -> FlightStart | None:
    """Fit a free flight to at most ``frames`` of the first poses; return None with fewer than three of them.

    Only poses before the first contact count. Gravity, inertia and environment are those of the scene.
    """
    count = min(flight_frames(motion, scene), frames)
    if count < _FEWEST:
        return None
    t = motion.times[:count]
    design = np.stack([np.ones(count), t], axis=1)
    inverse = np.linalg.inv(design.T @ design)
    falls = motion.poses[:count, :3] - 0.5 * t[:, None] ** 2 * scene.gravity
    line = inverse @ design.T @ falls
    seen, first, spin = motion.poses[:count, 3:], motion.poses[0, 3:], np.zeros(3)
    inertia = moving_body(scene).unit_inertia if scene.gyroscopic else np.eye(3)
    for _ in range(_ROUNDS):
        free = _free_turning(first, spin, t, inertia)
        turns = rotation_vectors(product(seen, inverse_of(free)))
        change = inverse @ design.T @ turns
        first, spin = product(exp_vectors(change[0]), first), spin + change[1]
        if np.abs(change).max() < _SETTLED:
            break
    turns = turns - design @ change
    state = np.zeros(STATE)
    state[POSITION], state[VELOCITY] = line
    state[QUATERNION] = first / np.linalg.norm(first)
    state[ANGULAR_VELOCITY] = spin
    position, rotation = np.zeros((ERROR, ERROR)), np.zeros((ERROR, ERROR))
    own = rotation_matrix(state[QUATERNION]).T  # errors of rotation are on the body's side
    position[ERR_POSITION, ERR_POSITION] = inverse[0, 0] * np.eye(3)
    position[ERR_VELOCITY, ERR_VELOCITY] = inverse[1, 1] * np.eye(3)
    position[ERR_POSITION, ERR_VELOCITY] = position[ERR_VELOCITY, ERR_POSITION] = inverse[0, 1] * np.eye(3)
    rotation[ERR_ROTATION, ERR_ROTATION] = inverse[0, 0] * np.eye(3)
    rotation[ERR_ANGULAR_VELOCITY, ERR_ANGULAR_VELOCITY] = inverse[1, 1] * np.eye(3)
    rotation[ERR_ROTATION, ERR_ANGULAR_VELOCITY] = inverse[0, 1] * own
    rotation[ERR_ANGULAR_VELOCITY, ERR_ROTATION] = inverse[0, 1] * own.T
    return FlightStart(
        state,
        position,
        rotation,
        count,
        float(np.sum((falls - design @ line) ** 2)),
        float(np.sum(turns**2)),
        3 * (count - 2),
    )


def _free_turning(quaternion, spin, times, inertia):
    """Return orientations (n, 4) at times from 0 on, without torque; ``inertia`` (3, 3) is in body axes."""
    if np.ptp(np.linalg.eigvalsh(inertia)) < _ROUND * inertia[0, 0]:
        return product(exp_vectors(times[:, None] * spin), quaternion)
    R = rotation_matrix(quaternion)
    momentum, inverse = R @ inertia @ R.T @ spin, np.linalg.inv(inertia)

    def rate(q):
        R = rotation_matrix(q)
        return R @ (inverse @ (R.T @ momentum))

    found, now = [], quaternion
    for wait in np.diff(times, prepend=times[0]):
        steps = math.ceil(wait / _STEP)
        for _ in range(steps):
            half = product(exp_vectors(0.5 * wait / steps * rate(now)), now)
            now = product(exp_vectors(wait / steps * rate(half)), now)
        found.append(now)
    return np.array(found)


def pose_noise(starts: Sequence[FlightStart]) -> tuple[float, float]:
    """Return the standard deviations, along each axis, of poses about free flights [m], [rad].

    Trackers filter. Their errors are correlated over time, and the residuals show only a part of them.
    """
    freedom = sum(start.freedom for start in starts)
    position = sum(start.position_squares for start in starts) / max(freedom, 1)
    rotation = sum(start.rotation_squares for start in starts) / max(freedom, 1)
    return float(np.sqrt(position)), float(np.sqrt(rotation))


def flight_gravity(motions: Sequence[Motion], scene: Scene) -> FlightGravity | None:
    """Return the median acceleration of the flights.

    None if all flights are short, or the scene has no gravity. Its direction may differ from the scene's
    gravity: tables, and the vertical axes of trackers, are tilted by milliradians.
    """
    if not np.any(scene.gravity):
        return None
    fits = [
        _acceleration(motion.times[:count], motion.poses[:count, :3])
        for motion in motions
        if (count := flight_frames(motion, scene)) >= _LONG_FLIGHT
    ]
    if not fits:
        return None
    found, variances, residuals = (np.array(column) for column in zip(*fits, strict=True))
    usual = residuals <= _UNUSUAL * np.median(residuals)  # other flights contain a contact
    found, median = found[usual], np.median(found[usual], axis=0)
    spread = np.maximum(np.mean((found - median) ** 2, axis=0), np.mean(variances[usual]))
    return FlightGravity(median, _OF_MEDIAN * np.sqrt(spread / len(found)))


def _acceleration(times, positions):
    """Return the acceleration (3,) of a flight, its variance along each axis, and the residual's std."""
    design = np.vander(times, 3)
    solution = np.linalg.lstsq(design, positions, rcond=None)[0]
    square = np.sum((positions - design @ solution) ** 2) / (3 * (len(times) - 3))
    return 2.0 * solution[0], 4.0 * square * np.linalg.inv(design.T @ design)[0, 0], np.sqrt(square)
