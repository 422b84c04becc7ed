"""How well a model predicts recorded motions: proper scores with the same random numbers for every model."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple, Protocol

import numpy as np

from ..checks.errors import DivergedError, InvalidRequestError
from ..prediction.executors import Workers, in_order
from ..prediction.predict import predict
from ..propagators.names import REFERENCE
from ..propagators.registry import make_propagator
from ..scene.belief import Belief
from ..scene.scene import Scene
from ..spatial.layout import POSITION, QUATERNION
from ..spatial.quaternions import product
from ..spatial.rotation import exp_vectors
from . import scores
from .adjustable import Model
from .flight import fit_start
from .motions import Motion

TIMES = (0.1, 0.2, 0.4)  # after the start at which predictions are scored, beside the end [s]
DRAWS = 480  # samples of all motions together
WEIGHTS = 0.3, 1.0  # of the logarithmic scores of poses, and of how a body lies at the end
_WIDE = 0.2, 1.5  # standard deviations of the wide part of densities (`scores.gaussian_scores`) [m], [rad]
_LOST = 1e3  # distance from the origin at which a sample counts as diverged [m]

#: Function of a scene, a belief, ascending times [s], a number of samples and a seed: states (n, 13) at each.
Simulator = Callable[[Scene, Belief, Sequence[float], int, int], Sequence[np.ndarray]]


def simulated(
    scene: Scene, belief: Belief, times: Sequence[float], samples: int, seed: int
) -> list[np.ndarray]:
    """Return states (n, 13) of the only body at each of the times, by Monte Carlo."""
    propagator = make_propagator(REFERENCE, samples=samples, seed=seed)
    prediction = predict(scene, belief, propagator, times=times)
    return [prediction.samples(time=time)[:, 0] for time in prediction.times]


class MotionStart(Protocol):
    """The state that a motion begins with, and its errors; `flight.FlightStart` is one."""

    @property
    def state(self) -> np.ndarray:
        """(13,), as in `Belief`."""
        ...

    def belief(self, position_noise: float, rotation_noise: float) -> Belief:
        """Return the belief at time 0 for pose errors of these standard deviations [m], [rad]."""
        ...


class Recorded(NamedTuple):
    """A motion as it is scored."""

    motion: Motion
    start: MotionStart
    times: tuple[float, ...]  # at which predictions are compared with it [s]; the last is its end
    poses: tuple[np.ndarray, ...]  # (7,) each, at these times


def recorded(
    motions: Sequence[Motion],
    scene: Scene,
    times: Sequence[float] = TIMES,
    starts: Sequence[MotionStart] | None = None,
) -> list[Recorded]:
    """Return motions with their starts, which are by default fitted to the first poses.

    Motions without enough poses before their first contact are then left out. Raises `InvalidRequestError`
    if none is left.
    """
    found = []
    for k, motion in enumerate(motions):
        start = fit_start(motion, scene) if starts is None else starts[k]
        if start is None:
            continue
        own = {motion.nearest(time) for time in times if time < motion.duration} | {motion.duration}
        own = tuple(sorted(own - {0.0}))
        found.append(Recorded(motion, start, own, tuple(motion.pose(time) for time in own)))
    if not found:
        raise InvalidRequestError(
            "touch something within their first three poses, all of them; let recordings begin in flight, and"
            " check the height of the surroundings",
            field="motions",
        )
    return found


def as_recorded(states: Sequence[np.ndarray], model: Model, seed: int) -> list[np.ndarray]:
    """Return states (n, 13) with the errors of recorded poses added to position and rotation."""
    rng, found = np.random.default_rng([seed, 1]), []
    for x in states:
        noise, shown = rng.standard_normal((len(x), 6)), x.copy()
        shown[:, POSITION] += model.position_noise * noise[:, :3]
        shown[:, QUATERNION] = product(x[:, QUATERNION], exp_vectors(model.rotation_noise * noise[:, 3:]))
        found.append(shown)
    return found


class Scores(NamedTuple):
    """Scores of one motion."""

    #: position, rotation: (T,): energy scores at its times [m], [rad]
    position: np.ndarray
    rotation: np.ndarray
    #: mean logarithmic score of positions and rotations at all times (`scores.gaussian_scores`)
    density: float
    lies: float  # Brier score of whether the same side is up at the end
    #: position_rank, rotation_rank: (T,): Mahalanobis ranks (`scores.gaussian_scores`)
    position_rank: np.ndarray
    rotation_rank: np.ndarray


def scored(states: Sequence[np.ndarray], poses: Sequence[np.ndarray]) -> Scores:
    """Return the scores of predicted states (n, 13) at each time for the recorded poses (7,)."""
    errors = scores.pose_errors(np.array(states), np.array(poses))
    pairs = (errors.position, errors.seen_position), (errors.rotation, errors.seen_rotation)
    (of_position, position_rank), (of_rotation, rotation_rank) = (
        scores.gaussian_scores(*pair, wide) for pair, wide in zip(pairs, _WIDE, strict=True)
    )
    position, rotation = np.array(
        [
            (
                scores.energy_score(x[:, POSITION], pose[:3], fair=True),
                scores.rotation_energy_score(x[:, QUATERNION], pose[3:], fair=True),
            )
            for x, pose in zip(states, poses, strict=True)
        ]
    ).T
    density = 0.5 * (of_position + of_rotation)
    lies = scores.fair_brier_score(scores.lies_alike(states[-1][:, QUATERNION], poses[-1][3:]))
    return Scores(position, rotation, float(density.mean()), lies, position_rank, rotation_rank)


@dataclass
class Objective:
    """Score of a model for recorded motions; the lower the better."""

    recorded: Sequence[Recorded]
    samples: int  # of each motion
    seed: int = 0  # motion k has the same draws, whatever the model
    simulate: Simulator = simulated  # makes the predictions
    workers: Workers = field(default_factory=Workers)  # by default this process
    #: (float, float): weights of `Scores.density` and of `Scores.lies`, beside the energy scores. The latter
    #: are divided by their means under the first model that is evaluated.
    weights: tuple[float, float] = WEIGHTS
    _unit: list[np.ndarray] = field(default_factory=list)

    def scores(self, model: Model) -> list[Scores]:
        """Return the scores of each motion under a model."""
        work = partial(_scores_of_motion, model, self.simulate, self.samples)
        seeds = [seed_of(self.seed, k) for k in range(len(self.recorded))]
        return list(in_order(self.workers.results(work, zip(self.recorded, seeds, strict=True))))

    def per_motion(self, model: Model) -> np.ndarray:
        """Return the weighted sum of the scores of each motion (M,)."""
        found = self.scores(model)
        if not self._unit:
            self._unit = [np.maximum(_means(found, name), 1e-9) for name in ("position", "rotation")]
        return np.array(
            [
                np.mean([_over(one.position, self._unit[0]), _over(one.rotation, self._unit[1])])
                + self.weights[0] * one.density
                + self.weights[1] * one.lies
                for one in found
            ]
        )


def _scores_of_motion(model, simulate, samples, motion_and_seed):
    """Return the scores of a motion under a model."""
    one, seed = motion_and_seed
    belief = one.start.belief(model.position_noise, model.rotation_noise)
    states = simulate(model.scene, belief, one.times, samples, seed)
    if not all(np.abs(x).max() < _LOST for x in states):
        raise DivergedError("threw a sample away", field=f"motion '{one.motion.name}'")
    return scored(as_recorded(states, model, seed), one.poses)


def seed_of(seed: int, k: int) -> int:
    """Return the seed of motion k's draws."""
    return int(np.random.SeedSequence([seed, k]).generate_state(1)[0])


def _means(found, name):
    """Return the means over motions at each time (T,); shorter motions lack the first times."""
    own = [getattr(one, name) for one in found]
    length = max(map(len, own))
    rows = [np.concatenate([np.full(length - len(values), np.nan), values]) for values in own]
    return np.nanmean(rows, axis=0)


def _over(values, unit):
    return float(np.mean(values / unit[-len(values) :]))
