"""Two bodies collide (the paper's Figs. 6 and 7): time and error over the initial uncertainty."""

from __future__ import annotations

import numpy as np

from ..comparison import (
    CPU_TIME,
    POSITION_ERROR,
    ROTATION_ERROR,
    TIME_RATIO,
    distance_cost,
    error_rows,
    predicted,
    predictors,
    rollout_cost,
    time_rows,
    two_truths,
)
from ..jobs import Job, Outcome, Settings
from ..methods import FLOOR, GAUSSIAN, MONTE_CARLO, label
from ..results import Results
from ..scenarios import LARGE, MODELS, collision, has_packing, missing_packings
from ..tables import number, table

TITLE = "Collisions"
COUNTS = (5, 10, 50, 100)
TIMED = (10, 100)
SIGMAS = tuple(round(0.01 * k, 2) for k in range(1, 11))  # m
FEW_SIGMAS = (0.01, 0.05, 0.1)
SPHERES = (10, 100, 1000, 10_000)
TRUTH, CONVERGED = 1000, 8000


def jobs(settings: Settings) -> list[Job]:
    """Every model, size and sigma; some of 1000 spheres against a converged truth as well."""
    if settings.quick:
        cases = [
            (model, spheres, sigma, 200) for model in MODELS for spheres in (10, 1000) for sigma in FEW_SIGMAS
        ]
        return [_job(settings, *case, subset=200) for case in cases]
    cases = [(model, spheres, sigma, TRUTH) for model in MODELS for spheres in SPHERES for sigma in SIGMAS]
    cases += [
        (model, LARGE, sigma, TRUTH) for model in MODELS if has_packing(model, LARGE) for sigma in FEW_SIGMAS
    ]
    cases += [(model, 1000, sigma, CONVERGED) for model in MODELS for sigma in FEW_SIGMAS]
    return [_job(settings, *case, subset=TRUTH) for case in cases]


def missing(settings: Settings) -> list[str]:
    """What cannot run for want of a packing, and how to make it."""
    if settings.quick:
        return []
    return missing_packings()


def run(job: Job) -> Outcome:
    """W1 of every method after 5 s, and CPU times of whole predictions."""
    p = job.parameters
    scene, belief, horizon = collision(p["model"], p["spheres"], p["sigma"])
    truth, second = two_truths(scene, belief, horizon, job)
    answers = predicted(scene, belief, horizon, job)
    rows = error_rows(job, truth, second, answers, COUNTS, p["subset"])
    timed = [count for count in TIMED if count <= p["truth"]]
    return Outcome(rows + time_rows(predictors(scene, belief, horizon, job, timed), p["rounds"]))


def report(results: Results) -> str:
    """Figures over sigma for each model, one over all, and tables at the middle sigma."""
    from ..plots import draw_over_sigma

    rows = results.rows("collisions")
    ordinary = rows.where(truth=min(rows.unique("truth")))
    models = ordinary.unique("model")
    parts = ["### Error (as Fig. 7)\n"]
    for model in models:
        figure, here = results.figure(f"collisions_error_{model}"), ordinary.where(model=model)
        lines = (
            (POSITION_ERROR, "W1 of positions [m]", here),
            (ROTATION_ERROR, "W1 of rotations [deg]", here),
        )
        draw_over_sigma(figure, lines, model)
        parts.append(f"![Error over sigma, {model}](figures/{figure.name})\n")
    figure = results.figure("collisions_time")
    lines = [(CPU_TIME, f"{model}: CPU time [ms]", ordinary.where(model=model)) for model in models]
    draw_over_sigma(figure, lines, "A prediction of 5 s on one thread")
    parts.append(f"### Time (as Fig. 6)\n\n![Time over sigma](figures/{figure.name})\n")
    parts.append(_error_table(rows))
    parts.append(_time_table(ordinary))
    return "\n".join(parts)


def _job(settings, model, spheres, sigma, truth, subset):
    rounds = 1 if settings.quick else 3 if spheres > 1000 else 5
    rollouts = 2 * truth + (rounds + 1) * (190 if truth >= 100 else 90)
    distances = (truth // subset) * 7 + 3
    return Job(
        "collisions",
        settings.parameters(
            model=model, spheres=spheres, sigma=sigma, truth=truth, subset=subset, rounds=rounds
        ),
        cost=rollouts * rollout_cost(spheres) + distances * distance_cost(subset, settings.distance),
    )


def _shown(rows):
    """(method, samples) in the order of a table."""
    last = (MONTE_CARLO, GAUSSIAN, FLOOR)
    curves = rows.where(quantity=POSITION_ERROR).curves()
    return sorted(curves, key=lambda curve: last.index(curve[0]) if curve[0] in last else -1)


def _error_table(rows):
    """Against the best truth there is at 1000 spheres."""
    best = rows.where(truth=max(rows.unique("truth")), spheres=1000)
    cases = [(model, sigma) for model in best.unique("model") for sigma in best.unique("sigma")]
    head = ["", *(f"{model} {sigma}" for model, sigma in cases)]
    lines = []
    for method, samples in _shown(best):
        cells = [label(method, samples)]
        for model, sigma in cases:
            found = best.where(model=model, sigma=sigma, method=method, samples=samples)
            position, rotation = found.where(quantity=POSITION_ERROR), found.where(quantity=ROTATION_ERROR)
            cells.append(f"{number(position.mean())} / {number(rotation.mean())}")
        lines.append(cells)
    size, subset = best[0]["truth"], best[0]["subset"]
    return (
        f"W1 of positions [m] / rotations [deg] at 1000 spheres, by model and sigma [m]; truths of {size}"
        f" samples in subsets of {subset}, means over the subsets:\n\n" + table(head, lines)
    )


def _time_table(rows):
    cases = [
        (model, spheres)
        for model in rows.unique("model")
        for spheres in rows.where(model=model).unique("spheres")
    ]
    lines = []
    shown = [
        (method, samples) for method, samples in _shown(rows) if method not in (MONTE_CARLO, FLOOR, GAUSSIAN)
    ]
    for method, samples in [*shown, (MONTE_CARLO, 10)]:
        cells = [label(method, samples)]
        for model, spheres in cases:
            found = rows.where(model=model, spheres=spheres, method=method, samples=samples)
            times, ratios = found.where(quantity=CPU_TIME), found.where(quantity=TIME_RATIO)
            cells.append(
                f"{number(1e3 * times.median())} ({number(1.0 / np.median(ratios.values()))}x)"
                if times
                else ""
            )
        lines.append(cells)
    return (
        "CPU time of a prediction on one thread [ms], and how many times faster it is than MC-10 in the same"
        " round; medians over sigmas and rounds:\n\n"
        + table(["", *(f"{model} {spheres}" for model, spheres in cases)], lines)
    )
