"""Speed against error: which method to take for which budget."""

from __future__ import annotations

import itertools
import time

import numba
import numpy as np

from ..comparison import (
    CPU_TIME,
    POSITION_ERROR,
    ROTATION_ERROR,
    WALL_TIME,
    distance_cost,
    error_rows,
    predicted,
    predictors,
    rollout_cost,
    two_truths,
)
from ..jobs import Job, Outcome, Settings
from ..methods import FLOOR, GAUSSIAN, label, methods
from ..pareto import Choice
from ..results import Results
from ..scenarios import MODELS, collision
from ..tables import number
from ..timing import timed
from .peers import engine_choices

TITLE = "Speed against error"
COUNTS = (2, 5, 10, 16, 32, 64, 100, 200, 500, 1000)
#: Rollouts at which the anytime answer is stopped.
GROWN = (12, 16, 32, 64, 128, 256, 512, 1000)
SIGMAS = (0.01, 0.05, 0.1)
TIMED_SIGMA = 0.05
#: What makes a case.
CASE = ("model", "encounter", "sigma")
QUANTITIES = ((POSITION_ERROR, "positions"), (ROTATION_ERROR, "rotations"))
TIMES = ((CPU_TIME, "CPU time on one thread"), (WALL_TIME, "wall time as deployed, on all threads"))


def jobs(settings: Settings) -> list[Job]:
    """For each model, a job for the errors of each encounter and sigma, and one for the times, alone on the
    machine.
    """
    truth, encounters = (200, 3) if settings.quick else (1000, 12)
    cases = {model: {"model": model, "spheres": 1000, "truth": truth} for model in MODELS}
    errors = [
        Job(
            "speed_against_error",
            settings.parameters(measured="error", **case, sigma=sigma, encounter=k, encounters=1),
            cost=2 * truth * rollout_cost(1000) + 30 * distance_cost(truth),
        )
        for k in range(encounters)  # of every model and sigma, if it is interrupted
        for case in cases.values()
        for sigma in (SIGMAS[1:2] if settings.quick else SIGMAS)
    ]
    times = [
        Job(
            "speed_against_error",
            settings.parameters(
                measured="time", **case, sigma=TIMED_SIGMA, encounter=0, encounters=encounters
            ),
            cost=2 * (sum(_counts(truth)) + sum(GROWN)) * (encounters + 1) * rollout_cost(1000),
            alone=True,
        )
        for case in cases.values()
    ]
    return errors + times


def run(job: Job) -> Outcome:
    """Errors in one encounter, or times on one thread and on all, each round in another encounter."""
    p = job.parameters
    counts = _counts(p["truth"])
    cases = [
        collision(p["model"], p["spheres"], p["sigma"], p["encounter"] + k) for k in range(p["encounters"])
    ]
    if p["measured"] == "error":
        answers = predicted(*cases[0], methods(job, GROWN))
        return Outcome(error_rows(job, *two_truths(*cases[0], job), answers, counts))
    for scene, *_ in cases:
        _ = scene.world  # is built at its first use, which no method shall pay for
    each = [predictors(*case, job, counts, methods(job, GROWN)) for case in cases]
    functions = {key: lambda k, key=key: each[k][key](k) for key in each[0]}
    rows = []
    for threads, quantity, clock in (
        (1, CPU_TIME, time.process_time),
        (numba.config.NUMBA_NUM_THREADS, WALL_TIME, time.perf_counter),
    ):
        numba.set_num_threads(threads)
        named = {(*key, quantity): function for key, function in functions.items()}
        rows += timed(named, len(cases), clock)
    return Outcome(rows)


def report(results: Results) -> str:
    """The figures, and all numbers in a table."""
    from ..plots import draw_speed_against_error

    rows, peers = results.rows("speed_against_error"), results.rows("peers")
    engines = {
        (model, quantity): found
        for quantity, _ in QUANTITIES
        for model, found in engine_choices(peers, quantity).items()
    }
    parts = []
    for time_quantity, title in TIMES:
        choices = {
            (model, quantity): _choices(rows.where(model=model), quantity, time_quantity)
            for model in rows.unique("model")
            for quantity, _ in QUANTITIES
        }
        if not any(choices.values()):
            continue
        figure = results.figure(f"speed_against_error_{time_quantity}")
        draw_speed_against_error(
            figure, choices, _limits(rows), title, engines if time_quantity == CPU_TIME else {}
        )
        parts.append(f"![Error over {title}](figures/{figure.name})\n")
    parts.append(_table(results, rows))
    return "\n".join(parts)


def _counts(most):
    return [count for count in COUNTS if count <= most]


def _choices(rows, quantity, time_quantity) -> list[Choice]:
    """Time and error over the floor of every method: median over rounds, geometric mean over encounters."""
    made = []
    for method, samples in rows.curves():
        times = rows.where(method=method, samples=samples, quantity=time_quantity)
        errors = _over_floor(rows, method, samples, quantity)
        if times and len(errors):
            low, high = np.quantile(errors, [0.25, 0.75]).tolist()
            middle = float(np.exp(np.mean(np.log(errors))))
            made.append(Choice(method, samples, times.median(), middle, (low, high)))
    return made


def _over_floor(rows, method, samples, quantity):
    """Error over the floor in each encounter, with each sigma, of each model."""
    found = rows.where(method=method, samples=samples, quantity=quantity)
    floor = rows.where(method=FLOOR, quantity=quantity)
    ratios = []
    for case in itertools.product(*(found.unique(name) for name in CASE)):
        own = dict(zip(CASE, case, strict=True))
        if found.where(**own):  # an interrupted run lacks some
            ratios.append(found.where(**own).mean() / floor.where(**own).mean())
    return np.array(ratios)


def _limits(rows):
    """For each model and quantity, the best Gaussian's error over the floor."""
    return {
        (model, quantity): float(
            np.exp(np.mean(np.log(_over_floor(rows.where(model=model), GAUSSIAN, None, quantity))))
        )
        for model in rows.unique("model")
        for quantity, _ in QUANTITIES
    }


def _table(results, rows):
    models = rows.unique("model")
    choices = {
        model: {
            (c.method, c.samples): (c, d, w)
            for c, d, w in zip(
                _choices(rows.where(model=model), POSITION_ERROR, CPU_TIME),
                _choices(rows.where(model=model), ROTATION_ERROR, CPU_TIME),
                _choices(rows.where(model=model), POSITION_ERROR, WALL_TIME),
                strict=True,
            )
        }
        for model in models
    }
    lines = []
    for method, samples in dict.fromkeys(key for found in choices.values() for key in found):
        for model in models:
            c, d, w = choices[model][method, samples]
            times = number(1e3 * c.time), number(1e3 * w.time)
            lines.append([label(method, samples), model, *times, number(c.error), number(d.error)])
    head = ["method", "model", "CPU time, one thread [ms]", "wall time, two threads [ms]"]
    head += [f"W1 {quantity} over floor" for quantity in ("position", "rotation")]
    return results.table("speed_against_error", head, lines)
