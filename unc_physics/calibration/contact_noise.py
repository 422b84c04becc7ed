"""Contact noise of a tracker, fitted to recorded motions."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..checks.errors import InvalidRequestError
from ..checks.validation import array, integer, positive
from ..prediction.executors import ROUND_CHUNK_TIME, AnyExecutor, Workers, in_order
from ..scene.belief import Belief
from ..scene.scene import Scene
from ..spatial.layout import (
    ERR_ANGULAR_VELOCITY,
    ERR_POSITION,
    ERR_ROTATION,
    ERR_VELOCITY,
    ERROR,
    POSITION,
    QUATERNION,
    STATE,
)
from ..spatial.quaternions import inverse, product, rotation_vectors
from ..spatial.rotation import exp_vectors
from ..tracking.measurements import POSE_ERRORS, PoseMeasurement
from ..tracking.noise import ContactNoise
from ..tracking.tracker import Tracker
from .flight import fit_start, flight_frames, moving_body, pose_noise
from .motions import Motion

#: Fields of `ContactNoise` that are fitted; the other fields keep their values.
FITTED = ("velocity", "rotation", "lasting", "shape_position", "shape_rotation")
LEAST_EVALUATIONS = 2 * len(FITTED)
AHEAD = 0.2  # how far ahead predictions are scored, beside the present [s]
_PRIOR_STD = 0.7  # of the logarithms of the values
_WIDEST = 3.0  # bounds of the search, in standard deviations of the prior
_AHEAD_EVERY = 2  # frames
_LEAST_SCORE = -20.0  # of a pose, so that one motion that ends on another side does not dominate
_UNKNOWN = 2.0, 15.0  # initial standard deviations of velocities [m/s], [rad/s]


class NoiseCalibration(NamedTuple):
    """Result of `calibrate_contact_noise`.

    Attributes
    ----------
    noise : ContactNoise
    scores : (float, float)
        Mean logarithmic density of the recorded poses before and after; the higher the better.
    motions, evaluations : int
        Number of motions that were used, and of sets of values that were tried.
    """

    noise: ContactNoise
    scores: tuple[float, float]
    motions: int
    evaluations: int


def calibrate_contact_noise(
    motions: Sequence[Motion],
    scene: Scene,
    std: ArrayLike,
    *,
    rate: float = 30.0,
    noise: ContactNoise = ContactNoise(),  # noqa: B008 - it is frozen
    members: int = 64,
    evaluations: int = 40,
    seed: int = 0,
    executor: AnyExecutor = None,
    progress: Callable[[int, int, float], object] | None = None,
) -> NoiseCalibration:
    """Fit the contact noise of a tracker to recorded motions.

    A tracker follows each motion as a camera would show it: at a rate, with random errors added to the poses.
    After the first contact, the recorded poses are compared with the tracker's belief about them, and with
    its predictions 0.2 s ahead. The fit maximises the mean logarithmic density of these poses, with the same
    random numbers for all values. Where motions say little, the given noise is the prior.

    Parameters
    ----------
    motions : sequence of Motion
        As for `calibrate`.
    scene : Scene
        One body and its surroundings. Calibrate it first: errors of its parameters become contact noise.
    std : (6,) array_like
        Standard deviations of poses that the tracker will be given: position [m], rotation [rad]. They should
        exceed the errors of the recordings.
    rate : float, optional
        Of these poses [Hz].
    noise : ContactNoise, optional
        Where the search begins.
    members : int, optional
        Of the tracker.
    evaluations : int, optional
        Sets of values that are tried.
    seed : int, optional
    executor : concurrent.futures.Executor, callable or str, optional
        Follows the motions, as in `predict_many`; by default this process. The result does not depend on it.
    progress : callable, optional
        Called with the number of sets that were tried, of how many, and the best score so far.

    Raises
    ------
    InvalidRequestError
        If no motion begins in flight and goes on after its first contact.
    """
    from scipy.optimize import minimize

    std = array(std, (6,), "std")
    if not std.min() > 0.0:
        raise InvalidRequestError("must be positive", field="std", value=std.tolist())
    evaluations = integer(evaluations, "evaluations", low=LEAST_EVALUATIONS)
    every = [_shown(motion, scene, std, positive(rate, "rate"), seed, k) for k, motion in enumerate(motions)]
    shown = [one for one in every if one is not None]
    if not shown:
        raise InvalidRequestError(
            "need three poses in flight, and poses after the first contact; check the height of the"
            " surroundings",
            field="motions",
        )
    starts = [start for motion in motions if (start := fit_start(motion, scene)) is not None]
    recorded = np.repeat(pose_noise(starts), 3) ** 2
    found: list[tuple[float, ContactNoise]] = []

    def loss(x: np.ndarray) -> float:
        factors = np.exp(_PRIOR_STD * x)
        changes = {name: getattr(noise, name) * f for name, f in zip(FITTED, factors.tolist(), strict=True)}
        tried = replace(noise, **changes)
        work = partial(_score, scene, std, recorded, tried, members, seed)
        if not found:
            work(shown[0])  # this process compiles, and workers load
        score = float(np.mean(np.concatenate([*in_order(workers.results(work, shown))])))
        found.append((score - 0.5 * float(x @ x) / len(shown), tried))
        if progress is not None:
            progress(len(found), evaluations, max(found, key=lambda one: one[0])[0])
        return -found[-1][0]

    with closing(Workers(executor, ROUND_CHUNK_TIME)) as workers:
        minimize(
            loss,
            np.zeros(len(FITTED)),
            method="COBYQA",
            bounds=[(-_WIDEST, _WIDEST)] * len(FITTED),
            options={"maxfev": evaluations, "initial_tr_radius": 0.7, "final_tr_radius": 0.05},
        )
    best = max(found, key=lambda one: one[0])
    return NoiseCalibration(best[1], (found[0][0], best[0]), len(shown), len(found))


class _Recording(NamedTuple):
    """A motion as a camera shows it: times (n,), poses (n, 7), and the number of the first in contact."""

    times: np.ndarray
    recorded: np.ndarray
    measured: np.ndarray
    contact: int


def _shown(motion, scene, std, rate, seed, k):
    """Return a motion at a rate, with errors; None if it does not begin in flight or has no contact."""
    steps = np.arange(0.0, motion.duration + 1e-9, 1.0 / rate)
    frames = np.unique([int(np.abs(motion.times - time).argmin()) for time in steps])
    contact = int(np.searchsorted(frames, flight_frames(motion, scene)))
    if fit_start(motion, scene) is None or contact >= len(frames) - 1:
        return None
    poses = motion.poses[frames]
    errors = std * np.random.default_rng((seed, k)).standard_normal((len(frames), 6))
    turned = product(poses[:, 3:], exp_vectors(errors[:, 3:]))
    measured = np.concatenate([poses[:, :3] + errors[:, :3], turned], axis=1)
    return _Recording(motion.times[frames], poses, measured, max(contact, 2))


def _score(scene, std, recorded, noise, members, seed, one):
    """Return the logarithmic densities (n,) of a motion's poses, each at least `_LEAST_SCORE`."""
    name, found = moving_body(scene).name, []
    tracker = _started(one, scene, noise, members, seed)
    for n, (time, pose) in enumerate(zip(one.times.tolist(), one.measured, strict=True)):
        tracker.correct(time, {name: PoseMeasurement(pose, std)})
        if n < one.contact:
            continue
        found.append(_density(tracker.belief(time), one.recorded[n], recorded))
        later = int(np.abs(one.times - time - AHEAD).argmin())
        if (n - one.contact) % _AHEAD_EVERY == 0 and time + AHEAD <= one.times[-1]:
            there = tracker.ahead([float(one.times[later]) - time]).belief
            found.append(_density(there, one.recorded[later], recorded))
    return np.maximum(found, _LEAST_SCORE)


def _started(one, scene, noise, members, seed):
    """Return a tracker whose belief is the first pose, with unknown velocities."""
    mean, P = np.zeros((1, STATE)), np.zeros((1, ERROR, ERROR))
    mean[0, POSITION], mean[0, QUATERNION] = one.measured[0, :3], one.measured[0, 3:]
    spreads = zip(
        (ERR_POSITION, ERR_ROTATION, ERR_VELOCITY, ERR_ANGULAR_VELOCITY), (1.0, 1.0, *_UNKNOWN), strict=True
    )
    for block, spread in spreads:
        P[0, block, block] = spread**2 * np.eye(3)
    return Tracker(scene, Belief(mean, P), members, noise, time=float(one.times[0]), seed=seed)


def _density(belief, pose, variances):
    """Return the log density of a recorded pose (7,), with error variances (6,), under a belief."""
    mean = belief.mean[0]
    turn = rotation_vectors(product(inverse(mean[QUATERNION]), pose[3:]))
    e = np.concatenate([pose[:3] - mean[POSITION], turn])
    S = belief.marginal(0)[np.ix_(POSE_ERRORS, POSE_ERRORS)] + np.diag(variances)
    square = float(e @ np.linalg.solve(S, e))
    return -0.5 * (square + np.linalg.slogdet(S)[1] + len(e) * math.log(2.0 * math.pi))
