"""Particle filter with rollouts in MuJoCo as particles, for comparison with the tracker.

The engine has no errors of contacts, so each piece of a rollout ends with the contact noise of the tracker.
In flight there is none, and particles that were copied would stay equal. Resampling therefore draws from a
Gaussian kernel around each particle, shrunk so that mean and covariance stay (Liu and West 2001). A pose that
would leave fewer than half of the particles effective counts in parts, with resampling between them.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from unc_physics.scene.belief import Belief
from unc_physics.scene.scene import Scene
from unc_physics.spatial.layout import ANGULAR_VELOCITY, ERR_ROTATION, ERROR, POSITION, QUATERNION, VELOCITY
from unc_physics.spatial.moments import spread_states, symmetric_root
from unc_physics.tracking.measurements import PoseMeasurement
from unc_physics.tracking.noise import ContactNoise, disturb_contacts
from unc_physics.tracking.symmetry import NONE

from .engines import MuJoCoRollouts
from .tracked_tosses import SHAPE, FilterFollower, Frames

_NOISE = ContactNoise()
#: Longest time without contact noise [s].
_PIECE = 1.0 / 30.0
#: Speed below which a particle rests [m/s].
_AT_REST = 0.02
#: Effective share of the particles below which they are resampled.
_EFFECTIVE = 0.5
#: Of the search for a part of a likelihood; and the least part, so that there are no more than fifty.
_HALVINGS, _LEAST_PART = 12, 0.02
_MOVING = np.zeros(1, np.int64)


class Particles(NamedTuple):
    """States (N, 13) of one body after a number of steps, and their weights (N,), which sum to one."""

    states: np.ndarray
    weights: np.ndarray
    step: int

    @property
    def effective(self) -> float:
        """Effective sample size over the number of particles."""
        return 1.0 / (len(self.weights) * float(np.sum(self.weights**2)))

    def weighed(self, logarithms: np.ndarray) -> Particles:
        """Return the particles with weights multiplied by factors (N,)."""
        weights = self.weights * np.exp(logarithms - logarithms.max())
        return self._replace(weights=weights / weights.sum())

    def part(self, logarithms: np.ndarray, left: float) -> float:
        """Return the largest factor of logarithms (N,), up to ``left``, that leaves half effective."""
        low, high, middle = 0.0, left, left
        for _ in range(_HALVINGS):
            if self.weighed(middle * logarithms).effective >= _EFFECTIVE:
                low = middle
            else:
                high = middle
            middle = 0.5 * (low + high)
        return max(low, min(left, _LEAST_PART))

    def moments(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Weighted mean (13,), and each particle's error (N, 12) from it, and their covariance (12, 12)."""
        mean = self.weights @ self.states
        turns = Rotation.from_quat(self.states[:, QUATERNION])
        middle = turns.mean(self.weights)
        mean[QUATERNION] = middle.as_quat()
        errors = np.empty((len(self.states), ERROR))
        errors[:, :6] = self.states[:, :6] - mean[:6]
        errors[:, ERR_ROTATION] = (middle.inv() * turns).as_rotvec()
        errors[:, 9:] = self.states[:, ANGULAR_VELOCITY] - mean[ANGULAR_VELOCITY]
        return mean, errors, (errors * self.weights[:, None]).T @ errors


class ParticleFilter:
    """A particle filter for one body above a table.

    It draws ``count`` particles from the ``belief`` at a ``time`` [s].
    """

    def __init__(self, scene: Scene, belief: Belief, time: float, count: int, seed: int):
        self._scene, self._origin, self._seed = scene, time, seed
        self._piece = max(1, math.floor(_PIECE / scene.dt + 1e-6))
        self._engine = MuJoCoRollouts(scene)
        self._engine.set_restitution(scene.restitution or 0.0)
        states = belief.sample(count, np.random.default_rng((seed, count)))[:, 0]
        self._now = Particles(states, np.full(count, 1.0 / count), 0)

    def correct(self, time: float, measurement: PoseMeasurement) -> None:
        """Weight the particles by the likelihood of a pose, in parts with resampling between them."""
        particles, left = self._at(time), 1.0
        seen = measurement.observation(self._scene.bodies[0])
        information = np.linalg.inv(seen.noise + np.diag(np.repeat(SHAPE, 3) ** 2))
        while left > 0.0:
            states = particles.states
            turned = Rotation.from_quat(states[:, QUATERNION]).inv() * Rotation.from_quat(seen.value[3:])
            errors = np.concatenate([seen.value[:3] - states[:, POSITION], turned.as_rotvec()], axis=1)
            likelihood = -0.5 * np.sum(errors @ information * errors, axis=1)
            part = particles.part(likelihood, left)
            particles = particles.weighed(part * likelihood)
            if part < left:
                particles = self._resampled(particles, left)
            left -= part
        self._now = particles

    def belief(self, time: float) -> Belief:
        """Return the moments at a time, with shape errors added."""
        mean, _, P = self._at(time).moments()
        P = P + np.diag(np.repeat([SHAPE[0] ** 2, 0.0, SHAPE[1] ** 2, 0.0], 3))
        return Belief(mean[None], P[None])

    def _at(self, time):
        """Return the particles at a time."""
        states, weights, step = self._now
        last = round((time - self._origin) / self._scene.dt)
        while step < last:
            steps = min(last, (step // self._piece + 1) * self._piece) - step
            before, states = states, self._engine.run_all(states[:, None], steps)
            step += steps
            # nothing sleeps in the engine
            resting = np.linalg.norm(states[:, :, VELOCITY], axis=2) < _AT_REST
            # the same draws whether it is predicted before or not
            rng = np.random.default_rng((self._seed, step))
            disturb_contacts(before[:, None], states, resting, self._scene, steps, _NOISE, rng)
            states = states[:, 0]
        return Particles(states, weights, step)

    def _resampled(self, particles, left):
        """Resample systematically, and add noise from a kernel of the optimal width for a Gaussian."""
        rng = np.random.default_rng((self._seed, particles.step, int(1e6 * left)))
        count = len(particles.weights)
        mean, errors, P = particles.moments()
        edges = np.cumsum(particles.weights)
        places = (np.arange(count) + rng.random()) / count
        chosen = np.minimum(np.searchsorted(edges, places), count - 1)
        width = (4.0 / (count * (ERROR + 2.0))) ** (1.0 / (ERROR + 4.0))
        kernel = rng.standard_normal((count, ERROR)) @ symmetric_root(P)
        errors = math.sqrt(1.0 - width**2) * errors[chosen] + width * kernel
        states = spread_states(mean[None].copy(), _MOVING, errors)[:, 0]
        return Particles(states, np.full(count, 1.0 / count), particles.step)


class ParticleFollower:
    """A particle filter that starts when a constant-velocity filter has estimated the velocities."""

    def __init__(self, scene: Scene, frames: Frames, seed: int, count: int):
        self._scene, self._seed, self._count = scene, seed, count
        self._start: FilterFollower | None = FilterFollower(scene, frames, seed)
        self._time = float(frames.times[0])

    def correct(self, time, measurement):
        self._time = time
        if self._start is None:
            self._particles.correct(time, measurement)
        else:
            self._start.correct(time, measurement)
            if self._start.filter.knows_velocities(NONE):
                belief = self._start.belief(time)
                self._particles = ParticleFilter(self._scene, belief, time, self._count, self._seed)
                self._start = None

    def belief(self, time):
        return (self._start or self._particles).belief(time)

    def ahead(self, duration):
        return self.belief(self._time + duration)

    @property
    def is_carried(self):
        return False
