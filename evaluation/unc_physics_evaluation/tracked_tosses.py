"""Recorded tosses, followed by a tracker and by what it is compared with.

``python -m unc_physics_evaluation.tracked_tosses`` fits the scene's parameters to 40 tosses that
`evaluate tracking` does not follow, and the contact noise to eight of them.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from functools import cache
from typing import NamedTuple, Protocol

import numpy as np
from scipy.spatial.transform import Rotation

from unc_physics.calibration.adjustable import FITTABLE, chosen
from unc_physics.calibration.calibrate import with_noise
from unc_physics.calibration.contact_noise import NoiseCalibration, calibrate_contact_noise
from unc_physics.calibration.flight import flight_frames
from unc_physics.calibration.objective import Objective, recorded
from unc_physics.calibration.posterior import Posterior
from unc_physics.calibration.search import ParameterSearch
from unc_physics.prediction.predict import predict
from unc_physics.propagators.registry import make_propagator
from unc_physics.scene.belief import Belief
from unc_physics.scene.environment import Plane
from unc_physics.scene.scene import Scene
from unc_physics.spatial.layout import (
    ANGULAR_VELOCITY,
    ERR_POSITION,
    ERR_ROTATION,
    POSITION,
    QUATERNION,
    VELOCITY,
)
from unc_physics.tracking.hypotheses import Filter
from unc_physics.tracking.measurements import PoseMeasurement
from unc_physics.tracking.noise import ContactNoise
from unc_physics.tracking.report import TrackStatus
from unc_physics.tracking.tracker import Tracker

from .recorded_tosses import Tosses, cube, recorded_tosses, toss_scene

#: Standard deviations of a measured pose [m], [rad].
NOISE = np.r_[np.full(3, 2e-3), np.full(3, np.radians(1.0))]
#: Of what is known of the velocities at first [m/s], [rad/s].
UNKNOWN = 2.0, 15.0
#: How far ahead predictions are scored [s].
AHEAD = 0.2
#: Outliers: their share, and how far off they are [m].
OUTLIERS, FAR_OFF = 0.1, 0.5
#: Errors of the shape that a prediction without a tracker is given [m], [rad].
SHAPE = ContactNoise().shape_position, ContactNoise().shape_rotation
#: The table, as `fit` found it.
TABLE = Plane(offset=-6.3e-4, name="table")
#: A gap in the measurements begins with the first contact, and lasts so long [s].
GAP = 0.2


def tracked_scene(tosses: Tosses) -> Scene:
    """The cube above the table, with the parameters of `fit`."""
    return toss_scene(
        tosses,
        bodies=[cube(0.0518, 5e-3, 1.55)],
        gravity=(0.0, 0.0, -9.61),
        environment=[TABLE],
        friction=0.229,
        restitution=0.232,
        impact_friction_speed=2.28,
        impact_direction_std=0.0225,
        impact_point_std=4.5e-3,
        impact_friction_std=0.08,
    )


class Frames(NamedTuple):
    """Measured poses of a motion, and the truth.

    Attributes
    ----------
    times : (n,) array
        [s]
    truth : (n, 13) array
        Recorded poses; velocities are central differences.
    measured : (n, 7) array
        Poses with noise.
    is_outlier, is_seen, in_contact : (n,) bool arrays
        Whether the pose is an outlier; is given to trackers; and comes after the first contact.
    """

    times: np.ndarray
    truth: np.ndarray
    measured: np.ndarray
    is_outlier: np.ndarray
    is_seen: np.ndarray
    in_contact: np.ndarray


class Follower(Protocol):
    """What follows a body."""

    def correct(self, time: float, measurement: PoseMeasurement) -> None:
        """Take a measurement."""
        ...

    def belief(self, time: float) -> Belief:
        """Return the belief of a time, from the measurements until now."""
        ...

    def ahead(self, duration: float) -> Belief:
        """Predict from the last measurement on."""
        ...

    @property
    def is_carried(self) -> bool:
        """Whether a hand is said to carry the body."""
        ...


@cache
def _level():
    """What turns the table of the tosses to the horizontal."""
    tosses = recorded_tosses()
    return tosses.level(range(len(tosses.states)))


def frames_of(tosses: Tosses, k: int, rate: float, condition: str, seed: int) -> Frames:
    """Return the frames of toss k at a rate [Hz], with noise; ``condition`` is plain, gap or outliers."""
    motion = tosses.motion(k, _level())
    poses, every = motion.poses, max(1, round(1.0 / (rate * tosses.dt)))
    contact = flight_frames(motion, tracked_scene(tosses))
    some = np.arange(0, len(poses), every)
    truth = np.zeros((len(some), 13))
    truth[:, POSITION], truth[:, QUATERNION] = poses[some, :3], poses[some, 3:]
    turn = Rotation.from_quat(poses[:, 3:])
    for n, at in enumerate(some):
        a, b = max(int(at) - 1, 0), min(int(at) + 1, len(poses) - 1)
        h = (b - a) * tosses.dt
        truth[n, VELOCITY] = (poses[b, :3] - poses[a, :3]) / h
        truth[n, ANGULAR_VELOCITY] = (turn[b] * turn[a].inv()).as_rotvec() / h
    rng = np.random.default_rng((seed, k))
    errors = NOISE * rng.standard_normal((len(some), 6))
    measured = np.concatenate(
        [
            truth[:, POSITION] + errors[:, :3],
            (Rotation.from_quat(truth[:, QUATERNION]) * Rotation.from_rotvec(errors[:, 3:])).as_quat(),
        ],
        axis=1,
    )
    is_outlier = np.zeros(len(some), bool)
    is_seen = np.ones(len(some), bool)
    if condition == "outliers":
        is_outlier = rng.random(len(some)) < OUTLIERS
        is_outlier[:3] = False
        measured[is_outlier, :3] += rng.uniform(-FAR_OFF, FAR_OFF, (int(is_outlier.sum()), 3))
        if is_outlier.any():
            measured[is_outlier, 3:] = Rotation.random(int(is_outlier.sum()), rng).as_quat()
    if condition == "gap":
        begin = contact * tosses.dt
        is_seen = ~((some * tosses.dt >= begin) & (some * tosses.dt < begin + GAP))
        is_seen[:3] = True
    return Frames(some * tosses.dt, truth, measured, is_outlier, is_seen, some >= contact)


def _first(frames):
    """Return mean (13,) and covariance (12, 12) of a body that is measured once."""
    mean = np.concatenate([frames.measured[0, :3], np.zeros(3), frames.measured[0, 3:], np.zeros(3)])
    return mean, np.diag(np.repeat([1.0, UNKNOWN[0], 1.0, UNKNOWN[1]], 3) ** 2)


class TrackerFollower:
    """The library's tracker, which begins without velocities."""

    def __init__(self, scene: Scene, frames: Frames, seed: int, **options):
        mean, P = _first(frames)
        belief = Belief(mean[None], P[None])
        self.tracker = Tracker(scene, belief, time=float(frames.times[0]), seed=seed, **options)
        self._name = scene.bodies[0].name

    def correct(self, time, measurement):
        self.tracker.correct(time, {self._name: measurement})

    def belief(self, time):
        return self.tracker.belief(time)

    def ahead(self, duration):
        return self.tracker.ahead([duration]).belief

    @property
    def is_carried(self):
        return self.tracker.status(self._name) is TrackStatus.CARRIED


class FilterFollower:
    """A constant-velocity filter; predictions ahead are its own, or `predict`'s from its belief."""

    def __init__(self, scene: Scene, frames: Frames, seed: int, physics: bool = False):
        self._scene, self._seed, self._physics = scene, seed, physics
        self.filter = Filter(*_first(frames), float(frames.times[0]))

    def correct(self, time, measurement):
        seen = measurement.observation(self._scene.bodies[0])
        self.filter = self.filter.at(time).corrected(seen, self.filter.mean, 100.0)[0]

    def belief(self, time):
        now = self.filter.at(time)
        return Belief(now.mean[None], now.covariance[None])

    def ahead(self, duration):
        if not self._physics:
            return self.belief(self.filter.time + duration)
        propagator = make_propagator("monte_carlo", seed=self._seed, samples=64)
        found = predict(self._scene, self.belief(self.filter.time), propagator, duration).belief
        # a body at rest has no variance across the table without it
        P = found.marginal(0) + np.diag(np.repeat([SHAPE[0] ** 2, 0.0, SHAPE[1] ** 2, 0.0], 3))
        return Belief(found.mean, P[None])

    @property
    def is_carried(self):
        return False


class Score(NamedTuple):
    """Figures of one frame; NaN where there is none. ``seconds`` is the CPU time of the correction."""

    in_contact: bool
    carried: bool
    nees_position: float = math.nan
    nees_rotation: float = math.nan
    position: float = math.nan
    rotation: float = math.nan
    velocity: float = math.nan
    next_log: float = math.nan
    next_inside: float = math.nan
    ahead_position: float = math.nan
    ahead_log: float = math.nan
    ahead_inside_position: float = math.nan
    ahead_inside_rotation: float = math.nan
    seconds: float = math.nan


#: 90 % quantiles of chi squared with 3 and 6 degrees of freedom.
_INSIDE_3, _INSIDE_6 = 6.251, 10.645


def scores(follower: Follower, frames: Frames, ahead_every: int = 1) -> Iterator[Score]:
    """Follow a motion, and score every frame.

    Recordings end at rest: a prediction for a time after the end is compared with the last pose.
    """
    last = float(frames.times[-1])
    for n, when in enumerate(frames.times.tolist()):
        found: dict[str, float] = {}
        truth, seen = frames.truth[n], bool(frames.is_seen[n])
        if n > 2 and not frames.is_outlier[n]:
            density, square = _density(follower.belief(when), frames.measured[n], np.diag(NOISE**2))
            found |= {"next_log": density, "next_inside": float(square < _INSIDE_6)}
        if seen:
            started = time.process_time()
            follower.correct(when, PoseMeasurement(frames.measured[n], NOISE))
            found["seconds"] = time.process_time() - started
        belief = follower.belief(when)
        for name, size, square in _parts(belief, truth):
            found |= {name: size, f"nees_{name}": square / 3.0}
        found["velocity"] = float(np.linalg.norm(belief.mean[0, VELOCITY] - truth[VELOCITY]))
        target = int(np.argmin(np.abs(frames.times - when - AHEAD)))
        if seen and n % ahead_every == 0 and n > 2:
            duration = float(frames.times[target] - when) if when + AHEAD <= last else AHEAD
            there, later = follower.ahead(duration), frames.truth[target]
            found["ahead_log"], _ = _density(there, _pose(later), np.zeros((6, 6)))
            parts = {name: one for name, *one in _parts(there, later)}
            found |= {
                f"ahead_inside_{name}": float(square < _INSIDE_3) for name, (_, square) in parts.items()
            }
            found["ahead_position"] = parts["position"][0]
        yield Score(bool(frames.in_contact[n]), follower.is_carried, **found)


def _parts(belief, truth):
    """Yield the errors of position [m] and rotation [rad]: name, size and squared Mahalanobis distance."""
    P, blocks = belief.marginal(0), {"position": ERR_POSITION, "rotation": ERR_ROTATION}
    for (name, block), e in zip(blocks.items(), _errors(belief, truth), strict=True):
        yield name, float(np.linalg.norm(e)), float(e @ np.linalg.solve(P[block, block], e))


def _pose(state):
    return np.concatenate([state[POSITION], state[QUATERNION]])


def _errors(belief, truth):
    """Position (3,) [m] and rotation (3,) on the body's side [rad] of the truth, from the belief's mean."""
    mean = belief.mean[0]
    turn = Rotation.from_quat(mean[QUATERNION]).inv() * Rotation.from_quat(truth[QUATERNION])
    return truth[POSITION] - mean[POSITION], turn.as_rotvec()


def _density(belief, pose, noise):
    """Logarithm of the density of a pose, and its squared distance."""
    state = np.zeros(13)
    state[POSITION], state[QUATERNION] = pose[:3], pose[3:]
    e = np.concatenate(_errors(belief, state))
    places = np.r_[ERR_POSITION, ERR_ROTATION]
    S = belief.marginal(0)[np.ix_(places, places)] + noise
    square = float(e @ np.linalg.solve(S, e))
    return -0.5 * (square + np.linalg.slogdet(2.0 * np.pi * S)[1]), square


#: Number of the first parameters of `FITTABLE` that are fitted: those of means and of errors of impacts.
_FITTED = FITTABLE.index("friction_std")
#: The tosses to which they are fitted, in the order of `evaluate tracking`.
_OTHERS = slice(80, 120)


def fit(samples: int = 8, models: int = 110) -> tuple[dict[str, float], NoiseCalibration]:
    """Return values that predict other tosses best, with the scene's as prior, and their contact noise."""
    tosses = recorded_tosses()
    order = np.random.default_rng(0).permutation(len(tosses.states))
    motions = [tosses.motion(k, _level()) for k in order[_OTHERS]]
    scene = tracked_scene(tosses)
    found = recorded(motions, scene)
    before, adjusted = with_noise(scene, found), chosen(scene, FITTABLE[:_FITTED])
    posterior = Posterior(Objective(found, samples, 0), before, adjusted, lambda score: None, len(found))
    search = ParameterSearch(posterior)
    search.approach()
    search.run(models - search.tried)
    noise = calibrate_contact_noise(
        motions[:8], posterior.with_values(search.best).scene, NOISE, evaluations=14
    )
    return posterior.values(search.best), noise


if __name__ == "__main__":
    print(*fit(), sep="\n")
