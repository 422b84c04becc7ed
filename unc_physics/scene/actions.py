"""Robot actions: paths that bodies follow and wrenches on bodies; validated and frozen."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from ..checks.array_field import Array, OptionalArray, array_field
from ..checks.errors import InvalidRequestError, LimitExceededError
from ..checks.validation import FARTHEST, array, flag, non_negative, number, numbers, positive, quaternion
from ..physics.actions import rotation_between
from ..spatial.layout import ANGULAR_VELOCITY, POSITION, QUATERNION, STATE, VELOCITY

#: Limits of a path: number of poses, linear [m/s] and angular speed [rad/s], and turn between poses [rad]. A
#: larger turn has an ambiguous axis.
MOST_POSES = 100_000
FASTEST, FASTEST_TURN, _MOST_TURN = 100.0, 200.0, 3.0
_MONOTONE = 3.0  # largest ratio of a velocity at a pose to the mean one beside it


@dataclass(frozen=True, eq=False, kw_only=True)
class PosePath:
    """Poses that a body follows at given times, unaffected by contacts.

    Between poses, the centre of mass follows cubic Hermite polynomials. The rotation vector from the last
    pose does the same. Before the first and after the last pose the body stands still.

    Attributes
    ----------
    times : (K,) array
        Ascending times from the start [s]; at least two.
    positions : (K, 3) array
        Positions of the centre of mass, world frame [m].
    orientations : (K, 4) array
        Quaternions (x, y, z, w) of ``R_world_body``; the identity by default.
    linear_velocities, angular_velocities : (K, 3) array
        World frame [m/s], [rad/s]. Missing or NaN values are estimated by parabolas through the neighbouring
        poses, of at most three times the slower of the mean velocities before and after the pose. So they are
        zero where neighbouring poses are equal, and a hold is held. They are also zero where the direction
        reverses, and at the first and the last pose.

    Raises
    ------
    InvalidRequestError, NotFiniteError, InvalidOrientationError, LimitExceededError
        For wrong shapes, too few times, or times that do not ascend. Also for speeds above `FASTEST` or
        `FASTEST_TURN`, or too large a turn between two poses.
    """

    times: Array = array_field()
    positions: Array = array_field()
    orientations: OptionalArray = array_field(None)
    linear_velocities: OptionalArray = array_field(None)
    angular_velocities: OptionalArray = array_field(None)

    def __post_init__(self):
        times = numbers(self.times, "times")
        count = len(times) if times.ndim == 1 else 0
        if count < 2:
            raise InvalidRequestError(
                "must be at least two; what stands still is fixed", field="times", value=times.tolist()
            )
        if count > MOST_POSES:
            raise LimitExceededError(f"must be at most {MOST_POSES}", field="times", value=count)
        times = array(times, (count,), "times")
        for k in range(1, count):
            if times[k] <= times[k - 1]:
                raise InvalidRequestError(
                    f"must be later than the time before it, {times[k - 1]:.6g} s",
                    field=f"times[{k}]",
                    value=float(times[k]),
                )
        positions = array(self.positions, (count, 3), "positions")
        if np.abs(positions).max() > FARTHEST:
            raise LimitExceededError(f"must be within {FARTHEST:g} m of the origin", field="positions")
        given = np.tile([0.0, 0.0, 0.0, 1.0], (count, 1)) if self.orientations is None else self.orientations
        given = array(given, (count, 4), "orientations")
        orientations = np.array([quaternion(q, f"orientations[{k}]") for k, q in enumerate(given)])
        steps = np.diff(times)[:, None]
        turns = np.array([rotation_between(*orientations[k : k + 2].copy()) for k in range(count - 1)])
        self._check_turns(turns)
        ways = np.diff(positions, axis=0)
        linear = _velocities(self.linear_velocities, ways / steps, steps, "linear_velocities")
        angular = _velocities(self.angular_velocities, turns / steps, steps, "angular_velocities")
        checked = {
            "times": times,
            "positions": positions,
            "orientations": orientations,
            "linear_velocities": linear,
            "angular_velocities": angular,
            "_turns": turns,
        }
        for name, value in checked.items():
            value.flags.writeable = False
            object.__setattr__(self, name, value)
        self._check_pace()

    def _check_turns(self, turns):
        for k, turn in enumerate(turns):
            if (angle := float(np.linalg.norm(turn))) > _MOST_TURN:
                raise InvalidRequestError(
                    f"turns by {angle:.4g} rad from the pose before it, so that it is not known which way;"
                    " add poses between them",
                    field=f"orientations[{k + 1}]",
                )

    def _check_pace(self):
        for column, limit, unit in ((0, FASTEST, "m/s"), (1, FASTEST_TURN, "rad/s")):
            speed = self.paces[:, column]
            if (k := int(speed.argmax())) >= 0 and speed[k] > limit:
                raise LimitExceededError(
                    f"jumps: from {self.times[k]:.6g} s to {self.times[k + 1]:.6g} s it moves at"
                    f" {speed[k]:.4g} {unit}, faster than {limit:g} {unit}",
                    field=f"times[{k + 1}]",
                )

    @classmethod
    def of_states(cls, times: np.ndarray, states: np.ndarray) -> PosePath:
        """Return the path through poses and velocities (K, 13) at times (K,) [s]."""
        return cls(
            times=times,
            positions=states[:, POSITION],
            orientations=states[:, QUATERNION],
            linear_velocities=states[:, VELOCITY],
            angular_velocities=states[:, ANGULAR_VELOCITY],
        )

    @property
    def states(self) -> np.ndarray:
        """Poses and velocities (K, 13), as in `Belief`."""
        states = np.empty((len(self.times), STATE))
        states[:, POSITION], states[:, QUATERNION] = self.positions, self.orientations
        states[:, VELOCITY], states[:, ANGULAR_VELOCITY] = self.linear_velocities, self.angular_velocities
        return states

    @property
    def turns(self) -> np.ndarray:
        """Rotation vectors to the next pose [rad] and their rates at its end [rad/s], (K, 6)."""
        result = np.zeros((len(self.times), 6))
        result[:-1, :3] = vars(self)["_turns"]
        for k in range(len(self.times) - 1):
            result[k, 3:] = _rate(result[k, :3], self.angular_velocities[k + 1])
        return result

    @property
    def paces(self) -> np.ndarray:
        """Bounds (K, 4) of both speeds and both accelerations until the next pose; zeros at the last."""
        steps, turns = np.diff(self.times)[:, None], self.turns
        result = np.zeros((len(self.times), 4))
        motions = (
            (self.linear_velocities[:-1], np.diff(self.positions, axis=0), self.linear_velocities[1:]),
            (self.angular_velocities[:-1], turns[:-1, :3], turns[:-1, 3:]),
        )
        for k, (first, way, last) in enumerate(motions):
            # a Bezier curve and its rate lie within the hulls of their control points
            corners = first, 3.0 * way / steps - first - last, last
            result[:-1, k] = np.max([np.linalg.norm(corner, axis=1) for corner in corners], axis=0)
            rates = [2.0 * (b - a) / steps for a, b in itertools.pairwise(corners)]
            result[:-1, 2 + k] = np.max([np.linalg.norm(rate, axis=1) for rate in rates], axis=0)
        return result


def _velocities(given, slopes, steps, field):
    """Return velocities (K, 3): given ones, else parabolas through three poses, or zero at the ends.

    A cubic whose velocity at an end is at most three times its mean one does not overshoot (Fritsch and
    Carlson 1980): estimates are limited to that, and are zero where the direction reverses.
    """
    count = len(slopes) + 1
    estimated = np.zeros((count, 3))
    before, after = slopes[:-1], slopes[1:]
    parabola = (steps[1:] * before + steps[:-1] * after) / (steps[1:] + steps[:-1])
    speed = np.linalg.norm(parabola, axis=1)
    most = _MONOTONE * np.minimum(np.linalg.norm(before, axis=1), np.linalg.norm(after, axis=1))
    most[np.einsum("kd,kd->k", before, after) < 0.0] = 0.0
    estimated[1:-1] = parabola * np.minimum(1.0, most / np.where(speed > 0.0, speed, 1.0))[:, None]
    if given is None:
        return estimated
    found = numbers(given, field)
    if found.shape != (count, 3):
        raise InvalidRequestError(f"must have shape {(count, 3)}, not {found.shape}", field=field)
    absent = np.isnan(found).all(axis=1)
    found[absent] = estimated[absent]
    return array(found, (count, 3), field).copy()


def _rate(turn, omega):
    """Return the rate of a rotation vector at angular velocity ``omega``, world frame: ``J^-1 omega``."""
    angle = np.linalg.norm(turn)
    once = np.cross(turn, omega)
    if angle < 1e-3:
        share = 1.0 / 12.0 + angle**2 / 720.0
    else:
        share = (1.0 - 0.5 * angle / math.tan(0.5 * angle)) / angle**2
    return omega - 0.5 * once + share * np.cross(turn, once)


@dataclass(frozen=True, eq=False, kw_only=True)
class Wrench:
    """A force and a torque that act on a body for a limited time.

    Attributes
    ----------
    force : (3,) array
        [N]
    torque : (3,) array
        About the centre of mass [N m].
    body_axes : bool
        Whether force and torque are in the body frame and turn with it; otherwise they are in the world
        frame.
    start : float
        Time at which it begins [s].
    duration : float, optional
        [s]; None means until the end.

    Raises
    ------
    InvalidRequestError, NotFiniteError
    """

    force: Array = array_field((0.0, 0.0, 0.0))
    torque: Array = array_field((0.0, 0.0, 0.0))
    body_axes: bool = False
    start: float = 0.0
    duration: float | None = None

    def __post_init__(self):
        checked = {
            "force": array(self.force, (3,), "force"),
            "torque": array(self.torque, (3,), "torque"),
            "body_axes": flag(self.body_axes, "body_axes"),
            "start": number(self.start, "start"),
        }
        if self.duration is not None:
            checked["duration"] = positive(self.duration, "duration")
        for name, value in checked.items():
            object.__setattr__(self, name, value)

    @property
    def end(self) -> float:
        """Time at which it ends [s]."""
        return math.inf if self.duration is None else self.start + self.duration


def six_stds(value, field) -> np.ndarray:
    """Return standard deviations (6,) of a translation [m] and a rotation [rad]; the number 0 means none."""
    std = numbers(value, field)
    if std.ndim == 0 and std == 0.0:
        std = np.zeros(6)
    std = array(std, (6,), field)
    for k, entry in enumerate(std.tolist()):
        non_negative(entry, f"{field}[{k}]")
    return std
