"""Quasi-random rollouts, and samples of a surface through their outcomes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from ..physics import contact_history as histories
from ..physics.contact_history import ContactHistory
from ..scene.kinematic_states import start_states
from ..scene.parameters import center_offsets, moved_along
from ..scene.physics_keys import INTEGRATORS
from ..scene.scene import UNCERTAIN_PARAMETERS
from ..spatial.moments import spread_states
from .base import SAMPLES_LIMIT, Rollouts, Samples, StandardErrors, Supports, Traits
from .emission import Moments, Runs, Shared, belief_of, emitted, labelled, whitened
from .options import option
from .reduction import reduction, symmetric
from .rollouts import SimulatedRollouts
from .share_errors import FEWEST, MOST, effective_counts, residual_maps
from .sobol import normal_points
from .standard_errors import standard_errors, wrapped_errors
from .start import resolve_initial_overlap

FEWEST_RUNS = 12
RUNS_LIMIT = 100_000
_MOMENT_POINTS = 512  # for moments of surfaces and of flights


class _Carry(NamedTuple):
    """Persistent state: the states of N rollouts, and their uncertain directions."""

    states: np.ndarray  # (N, B, 13): of the bodies' centres of mass, wherever those are uncertain
    contact_history: ContactHistory
    step: int  # how many are done
    #: (N, K): the rollouts' K uncertain parameters, in standard deviations from their values
    parameters: np.ndarray
    mean: np.ndarray  # (B, 13): at time 0
    #: (12 M, r): errors at time 0 that each of r independent standard normal numbers makes
    root: np.ndarray
    moving: np.ndarray  # (M,) int
    #: (r + K,) int: which column of the points each of these numbers, and then each parameter, is
    columns: np.ndarray
    #: (r + K,) bool: whether the rollouts differ in it; the others are common motions (`reduction`)
    simulated: np.ndarray
    dimensions: int  # how many columns the points have


class CloudCarry(_Carry):
    """Persistent state with a cache of results, which a new carry does not have."""

    @cached_property
    def shared(self) -> list[Shared]:
        """Cache that the times of a prediction share, or one of this carry (`emission.Shared`)."""
        return [Shared({}, {})]

    @cached_property
    def moments(self) -> dict[bytes, Moments]:
        """`Moments` of each group of bodies, by its key."""
        return {}

    @cached_property
    def runs(self) -> dict[int, Runs]:
        """Rollouts with their random numbers, by the points' seed."""
        return {}

    @cached_property
    def errors(self) -> list[StandardErrors]:
        """Cached standard errors."""
        return []

    @cached_property
    def straight_errors(self) -> list[StandardErrors]:
        """Cached standard errors of rotations that do not wrap around."""
        return []

    @cached_property
    def samples(self) -> dict[tuple, np.ndarray]:
        """Cached samples of the answer, by their options."""
        return {}


@dataclass(frozen=True)
class Cloud(SimulatedRollouts, Samples, Rollouts):
    """Quasi-random rollouts with a response surface.

    Notes
    -----
    Rollouts begin at scrambled Sobol points of the belief. A Gaussian process interpolates their outcomes. A
    sample is the nearest rollout's outcome, moved by the change of the interpolation. Bodies that meet
    nothing fly in closed form; bodies that meet only each other move together in closed form. There is no
    surface if it predicts a left-out rollout worse than the mean of the others does. The answer then consists
    of the rollouts, as in Monte Carlo.
    """

    name = "cloud"
    traits = Traits("estimated", "rollouts and surface", True, False, "simulated")
    integrators = INTEGRATORS
    supports = Supports(UNCERTAIN_PARAMETERS, INTEGRATORS, impact_errors=True)
    resamples = True

    #: fewer runs are the first ones of more runs
    runs: int = option(32, "number of rollouts", low=FEWEST_RUNS, high=RUNS_LIMIT)
    samples: int = option(1000, "number of samples that the answer consists of", low=1, high=SAMPLES_LIMIT)
    seed: int = option(0, "seed of the points", low=0)  # of their scrambling

    def init(self, scene, belief):
        return self.init_rollouts(scene, belief, 0, self.runs)

    def init_rollouts(self, scene, belief, first, last):
        root, extra = belief.root(), len(scene.uncertain)
        size = root.shape[1]
        common = 0
        if symmetric(scene):
            reduced = reduction(root)
            common = reduced.common.shape[1]
            root = np.concatenate([root @ reduced.relative, root @ reduced.common], axis=1)
        simulated = np.ones(size + extra, bool)
        simulated[size - common : size] = False
        # simulated directions take the first columns of the Sobol points, which are the most uniform
        columns = np.empty(size + extra, np.int64)
        columns[simulated] = np.arange(size + extra - common)
        columns[~simulated] = np.arange(size + extra - common, size + extra)
        z = self._points(last, size + extra, columns, simulated)[first:]
        # einsum, not BLAS: each row in one order of summation, whatever the count and the number of threads
        errors = np.einsum("nr,kr->nk", z[:, :size], root)
        states = spread_states(belief.mean.copy(), scene.moving.copy(), errors)
        states, history = resolve_initial_overlap(scene, belief, states)
        if scene.draws_impacts:
            history = histories.with_keys(history, self.seed, first)
        parameters = np.ascontiguousarray(z[:, size:])
        states = moved_along(start_states(scene, states, parameters), center_offsets(scene, parameters))
        return CloudCarry(
            states,
            history,
            0,
            parameters,
            belief.mean.copy(),
            root,
            scene.moving.copy(),
            columns,
            simulated,
            size + extra,
        )

    def belief(self, carry, scene):
        return belief_of(self._runs(carry), scene)

    def share_caches(self, carries):
        """Let the times of a prediction share their surfaces; the surfaces of the last are fitted first."""
        for carry in carries[:-1]:
            carry.shared[:] = carries[-1].shared
            carry.runs.clear()

    @property
    def own_sample_count(self):
        return self.samples

    def own_samples(self, carry, scene):
        """Return states (samples, B, 13) of the models' centres of mass, emitted from the rollouts."""
        options = self.samples, self.seed
        if options not in carry.samples:
            z = _emitted_points(self.samples, carry.dimensions, self.seed)[:, carry.columns]
            carry.samples[options] = emitted(self._runs(carry), scene, z)
        return carry.samples[options]

    def rollout_states(self, carry, scene):
        return labelled(self._runs(carry), scene)

    def measures(self, carry, scene):
        return {"spread_error": self.standard_errors(carry, scene).spread}

    def effective_counts(self, carry, happened):
        count = happened.shape[1]
        if count < FEWEST or not carry.dimensions:
            return super().effective_counts(carry, happened)
        columns, count = carry.columns.tobytes(), min(count, MOST)
        return effective_counts(_residual_maps(count, carry.dimensions, self.seed, columns), happened)

    def standard_errors(self, carry, scene):
        if not carry.errors:  # of a new batch, the answer and its status
            straight = self._straight_errors(carry, scene)
            carry.errors.append(wrapped_errors(self._runs(carry), scene, straight))
        return carry.errors[0]

    def _straight_errors(self, carry, scene):
        """Return `standard_errors` as if rotations did not wrap around."""
        if not carry.straight_errors:
            carry.straight_errors.append(standard_errors(self._runs(carry), scene))
        return carry.straight_errors[0]

    def _points(self, count, dimensions, columns, simulated):
        """Return the numbers (count, r + K) that spread the rollouts."""
        return np.where(simulated, _rollout_points(count, dimensions, self.seed)[:, columns], 0.0)

    def _runs(self, carry):
        if self.seed not in carry.runs:
            carry.runs[self.seed] = self._new_runs(carry)
        return carry.runs[self.seed]

    def _new_runs(self, carry):
        count, columns, simulated = len(carry.states), carry.columns.tobytes(), carry.simulated.tobytes()
        labels, z, points = _numbers(count, carry.dimensions, self.seed, columns, simulated)
        return Runs(
            carry.states,
            carry.contact_history,
            carry.step,
            carry.mean,
            carry.root,
            carry.moving,
            carry.parameters,
            z,
            carry.simulated,
            labels,
            points,
            carry.shared[0],
            carry.moments,
        )


def _key(seed, stream):
    """Return a seed of 63 bits for one of the two sets of points."""
    return (2 * seed + stream) % 2**63


@lru_cache(maxsize=16)
def _rollout_points(count: int, dimensions: int, seed: int) -> np.ndarray:
    """Return the normal numbers (count, dimensions) of the rollouts."""
    return normal_points(count, dimensions, _key(seed, 0))


@lru_cache(maxsize=16)
def _numbers(
    count: int, dimensions: int, seed: int, columns: bytes, simulated: bytes
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return `Runs.labels`, `Runs.z` and `Runs.points` of a carry's columns."""
    some = np.frombuffer(columns, np.int64)
    labels = _rollout_points(count, dimensions, seed)[:, some]
    z = np.where(np.frombuffer(simulated, bool), labels, 0.0)
    return labels, z, _emitted_points(_MOMENT_POINTS, dimensions, seed)[:, some]


@lru_cache(maxsize=4)
def _residual_maps(count: int, dimensions: int, seed: int, columns: bytes) -> list[np.ndarray]:
    """Return `residual_maps` of the first points."""
    return residual_maps(_rollout_points(count, dimensions, seed)[:, np.frombuffer(columns, np.int64)])


@lru_cache(maxsize=16)
def _emitted_points(count: int, dimensions: int, seed: int) -> np.ndarray:
    """Return the samples' normal numbers (count, dimensions), with mean 0 and covariance 1 to round-off.

    Means and covariances that a smooth surface preserves are therefore exact.
    """
    return whitened(normal_points(count, dimensions, _key(seed, 1)))
