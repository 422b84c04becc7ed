"""Quasi-random rollouts, and samples of a surface through their outcomes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ..physics import contact_history as histories
from ..scene.kinematic_states import start_states
from ..scene.parameters import center_offsets, moved_along
from ..scene.physics_keys import INTEGRATORS
from ..scene.scene import UNCERTAIN_PARAMETERS
from ..spatial.moments import spread_states
from .base import SAMPLES_LIMIT, Rollouts, Samples, Supports, Traits
from .emission import SHARED, CloudCarry, belief_of, emitted, emitted_points, labelled, rollout_points
from .options import option
from .reduction import reduction, symmetric
from .rollouts import SimulatedRollouts
from .share_errors import FEWEST, MOST, effective_counts, residual_maps
from .standard_errors import standard_errors, wrapped_errors
from .start import resolve_initial_overlap

FEWEST_RUNS = 12
RUNS_LIMIT = 100_000


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
        points = rollout_points(last, size + extra, self.seed)[:, columns]
        z = np.where(simulated, points, 0.0)[first:]
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
            self.seed,
        )

    def belief(self, carry, scene):
        return belief_of(carry, scene)

    def share_caches(self, carries):
        """Let the times of a prediction share numbers and surfaces; those of the last are fitted first."""
        for carry in carries[:-1]:
            vars(carry).update({name: getattr(carries[-1], name) for name in SHARED})

    @property
    def own_sample_count(self):
        return self.samples

    def own_samples(self, carry, scene):
        """Return states (samples, B, 13) of the models' centres of mass, emitted from the rollouts."""
        if self.samples not in carry.kept:
            z = emitted_points(self.samples, len(carry.columns), self.seed)[:, carry.columns]
            carry.kept[self.samples] = emitted(carry, scene, z)
        return carry.kept[self.samples]

    def rollout_states(self, carry, scene):
        return labelled(carry, scene)

    def measures(self, carry, scene):
        return {"spread_error": self.standard_errors(carry, scene).spread}

    def effective_counts(self, carry, happened):
        count = happened.shape[1]
        if count < FEWEST or not len(carry.columns):
            return super().effective_counts(carry, happened)
        columns, count = carry.columns.tobytes(), min(count, MOST)
        return effective_counts(_residual_maps(count, len(carry.columns), self.seed, columns), happened)

    def standard_errors(self, carry, scene):
        if "errors" not in carry.kept:  # of a new batch, the answer and its status
            carry.kept["errors"] = wrapped_errors(carry, scene, self._straight_errors(carry, scene))
        return carry.kept["errors"]

    def _straight_errors(self, carry, scene):
        """Return `standard_errors` as if rotations did not wrap around."""
        if "straight errors" not in carry.kept:
            carry.kept["straight errors"] = standard_errors(carry, scene)
        return carry.kept["straight errors"]


@lru_cache(maxsize=4)
def _residual_maps(count: int, dimensions: int, seed: int, columns: bytes) -> list[np.ndarray]:
    """Return `residual_maps` of the first points."""
    return residual_maps(rollout_points(count, dimensions, seed)[:, np.frombuffer(columns, np.int64)])
