"""Comparisons that experiments share: predictions of all methods, their W1 errors, and times."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from unc_physics.prediction.predict import predict
from unc_physics.propagators.base import Propagator
from unc_physics.propagators.base import Samples as HasSamples
from unc_physics.propagators.registry import make_propagator
from unc_physics.scene.belief import Belief

from .jobs import Job, Row
from .methods import FLOOR, GAUSSIAN, MONTE_CARLO
from .wasserstein import RegularisedDistance, state_distance

REPLICATES = 10  # of Monte Carlo with few samples

POSITION_ERROR, ROTATION_ERROR = ERRORS = "w1_position", "w1_rotation"
#: The paper's metric (`wasserstein.RegularisedDistance`).
REGULARISED = tuple(f"{error}_regularised" for error in ERRORS)
CPU_TIME, WALL_TIME = "cpu_time", "wall_time"


def rollout_cost(spheres: int) -> float:
    """Estimate the time of a rollout of a collision [s]."""
    return 1e-4 + 1.2e-5 * spheres**0.62


def distance_cost(size: int) -> float:
    """Estimate the time of computing W1 of two bodies' poses between sets of ``size`` samples [s]."""
    return 0.65 * (size / 1000) ** 2.3


class Samples(NamedTuple):
    """Monte Carlo's prediction.

    Attributes
    ----------
    states : (N, B, 13) array
    belief : Belief
        Gaussian with the moments of the samples.
    seed : int
    """

    states: np.ndarray
    belief: Belief
    seed: int


def monte_carlo(scene, belief, horizon, samples, seed) -> Samples:
    """Return Monte Carlo's prediction."""
    prediction = predict(scene, belief, make_propagator(MONTE_CARLO, samples=samples, seed=seed), horizon)
    return Samples(prediction.samples(), prediction.belief, seed)


def two_truths(scene, belief, horizon, job: Job) -> tuple[Samples, Samples]:
    """Return two independent reference predictions by Monte Carlo."""
    first, second = (
        monte_carlo(scene, belief, horizon, job.parameters["truth"], job.seed(name))
        for name in ("truth", "second")
    )
    return first, second


def error_rows(
    job: Job,
    truth: Samples,
    second: Samples,
    predictions: Mapping[tuple[str, int | None], Belief | np.ndarray],
    counts: Sequence[int],
    regularised: bool = False,
) -> list[Row]:
    """Return W1 from a reference to predictions, Monte Carlo, the best Gaussian, and another reference.

    Parameters
    ----------
    job : Job
        Gives the seeds.
    truth, second : Samples
        Two independent references of N samples each.
    predictions : mapping of (str, int or None) to Belief or (n, B, 13) array
        By the method's name and number of rollouts: N samples are drawn from a belief; samples are taken as
        they are.
    counts : sequence of int
        Numbers of samples of Monte Carlo; they are taken from ``second``.
    regularised : bool
        Whether to add the paper's metric.

    Notes
    -----
    Monte Carlo with n samples is n independent rollouts, so any n samples of ``second`` are such a run.
    """
    rows = []
    metrics = {ERRORS: lambda states: state_distance(states, truth.states)}
    if regularised:
        metrics[REGULARISED] = RegularisedDistance(truth.states).to

    def compare(method, states, samples=None, replicate=0, seed=None):
        for names, metric in metrics.items():
            for quantity, unit, values in zip(names, ("m", "deg"), metric(states), strict=True):
                rows.append(Row(method, quantity, unit, float(np.mean(values)), samples, replicate, seed))

    compare(FLOOR, second.states, seed=second.seed)
    for (method, runs), predicted in {(GAUSSIAN, None): truth.belief, **predictions}.items():
        seed = job.seed(f"draws {method} 0")
        states = predicted
        if isinstance(predicted, Belief):
            states = predicted.sample(len(truth.states), np.random.default_rng(seed))
        compare(method, states, runs, seed=seed)
    for count in counts:
        for k in range(min(REPLICATES, len(second.states) // count)):
            compare(MONTE_CARLO, second.states[count * k : count * (k + 1)], count, k, second.seed)
    return rows


def predicted(
    scene, belief, horizon, propagators: Mapping[tuple[str, int | None], Propagator]
) -> dict[tuple[str, int | None], Belief | np.ndarray]:
    """Return the prediction of every propagator: its samples if it has any, otherwise its belief."""
    answers = {}
    for key, propagator in propagators.items():
        prediction = predict(scene, belief, propagator, horizon)
        answers[key] = prediction.samples() if isinstance(propagator, HasSamples) else prediction.belief
    return answers


def time_rows(
    scene,
    belief,
    horizon,
    job: Job,
    counts: Sequence[int],
    propagators: Mapping[tuple[str, int | None], Propagator],
    rounds: int,
) -> list[Row]:
    """Return CPU times of Monte Carlo with each count and of every propagator.

    The predictions run in turns, A B C, A B C, ..., so that other load slows all of them equally. A first
    round is not measured.
    """
    rows = []
    for k in range(-1, rounds):
        samples = {
            (MONTE_CARLO, count): make_propagator(
                MONTE_CARLO, samples=count, seed=job.seed(f"round {max(k, 0)}")
            )
            for count in counts
        }
        for (method, runs), propagator in {**samples, **propagators}.items():
            started = time.process_time()
            predict(scene, belief, propagator, horizon)
            rows.append(Row(method, CPU_TIME, "s", time.process_time() - started, runs, k))
    return [row for row in rows if row.replicate >= 0]
