"""What a robot does: paths that bodies follow, and wrenches that act on them; validated and frozen."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from ..checks.array_field import Array, OptionalArray, array_field
from ..checks.errors import InvalidRequestError, LimitExceededError
from ..checks.validation import FARTHEST, array, flag, non_negative, number, numbers, positive, quaternion
from ..dynamics.actions import rotation_between
from ..spatial.layout import ANGULAR_VELOCITY, POSITION, QUATERNION, STATE, VELOCITY

#: Most poses of a path; the fastest that one may be, linear [m/s] and angular [rad/s], and how far it may
#: turn from one pose to the next [rad], beyond which nobody knows about which axis.
MOST_POSES = 100_000
FASTEST, FASTEST_TURN, _MOST_TURN = 100.0, 200.0, 3.0


@dataclass(frozen=True, eq=False, kw_only=True)
class PosePath:
    """Poses that a body goes through at given times, whatever it touches.

    Between them its centre of mass follows cubic Hermite polynomials, and its rotation those of the rotation
    vector from the last pose. Before the first pose and after the last one it stands still.

    Attributes
    ----------
    times : (K,) array
        From the start, ascending [s]; at least two.
    positions : (K, 3) array
        Of the centre of mass, world frame [m].
    orientations : (K, 4) array
        Quaternions (x, y, z, w) of ``R_world_body``; by default none is turned.
    linear_velocities, angular_velocities : (K, 3) array
        World frame [m/s], [rad/s]. Where they are not given, or NaN, they are estimated from the poses before
        and after; at the first and the last pose they are zero then.

    Raises
    ------
    InvalidRequestError, NotFiniteError, InvalidOrientationError, LimitExceededError
        For wrong shapes, too few times, times that do not ascend, and what is faster than `FASTEST` or
        `FASTEST_TURN`, or turns too far from one pose to the next.
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

    @property
    def states(self) -> np.ndarray:
        """(K, 13): the poses and velocities, as in `Belief`."""
        states = np.empty((len(self.times), STATE))
        states[:, POSITION], states[:, QUATERNION] = self.positions, self.orientations
        states[:, VELOCITY], states[:, ANGULAR_VELOCITY] = self.linear_velocities, self.angular_velocities
        return states

    @property
    def turns(self) -> np.ndarray:
        """(K, 6): rotation vectors from each pose to the next [rad], and their rates at its end [rad/s]."""
        result = np.zeros((len(self.times), 6))
        result[:-1, :3] = vars(self)["_turns"]
        for k in range(len(self.times) - 1):
            result[k, 3:] = _rate(result[k, :3], self.angular_velocities[k + 1])
        return result

    @property
    def paces(self) -> np.ndarray:
        """(K, 4): the most speed, angular speed, and accelerations until the next pose; zeros at the last."""
        steps, turns = np.diff(self.times)[:, None], self.turns
        result = np.zeros((len(self.times), 4))
        motions = (
            (self.linear_velocities[:-1], np.diff(self.positions, axis=0), self.linear_velocities[1:]),
            (self.angular_velocities[:-1], turns[:-1, :3], turns[:-1, 3:]),
        )
        for k, (first, way, last) in enumerate(motions):
            # a velocity is within its Bezier polygon, and so is its rate
            corners = first, 3.0 * way / steps - first - last, last
            result[:-1, k] = np.max([np.linalg.norm(corner, axis=1) for corner in corners], axis=0)
            rates = [2.0 * (b - a) / steps for a, b in itertools.pairwise(corners)]
            result[:-1, 2 + k] = np.max([np.linalg.norm(rate, axis=1) for rate in rates], axis=0)
        return result


def _velocities(given, slopes, steps, field):
    """Velocities (K, 3): those given, and otherwise parabolas through three poses, or zero at the ends."""
    count = len(slopes) + 1
    estimated = np.zeros((count, 3))
    estimated[1:-1] = (steps[1:] * slopes[:-1] + steps[:-1] * slopes[1:]) / (steps[1:] + steps[:-1])
    if given is None:
        return estimated
    found = numbers(given, field)
    if found.shape != (count, 3):
        raise InvalidRequestError(f"must have shape {(count, 3)}, not {found.shape}", field=field)
    absent = np.isnan(found).all(axis=1)
    found[absent] = estimated[absent]
    return array(found, (count, 3), field).copy()


def _rate(turn, omega):
    """Rate of a rotation vector whose rotation turns at ``omega``, world frame: ``J^-1 omega``."""
    angle = np.linalg.norm(turn)
    once = np.cross(turn, omega)
    if angle < 1e-3:
        share = 1.0 / 12.0 + angle**2 / 720.0
    else:
        share = (1.0 - 0.5 * angle / math.tan(0.5 * angle)) / angle**2
    return omega - 0.5 * once + share * np.cross(turn, once)


@dataclass(frozen=True, eq=False, kw_only=True)
class Wrench:
    """A force and a torque that act on a body for a while.

    Attributes
    ----------
    force : (3,) array
        [N]
    torque : (3,) array
        About the centre of mass [N m].
    body_axes : bool
        Whether they are along the body's axes, and turn with it; otherwise along the world's.
    start : float
        From when [s].
    duration : float, optional
        For how long [s]; None means to the end.

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
        """Until when it acts [s]."""
        return math.inf if self.duration is None else self.start + self.duration


def six_stds(value, field) -> np.ndarray:
    """Standard deviations (6,): of a translation [m], then of a rotation [rad]; one number 0 for none."""
    std = numbers(value, field)
    if std.ndim == 0 and std == 0.0:
        std = np.zeros(6)
    std = array(std, (6,), field)
    for k, entry in enumerate(std.tolist()):
        non_negative(entry, f"{field}[{k}]")
    return std
