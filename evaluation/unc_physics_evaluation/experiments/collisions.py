"""Two bodies collide (the paper's Figs. 6 and 7): error over initial uncertainty, time over spheres."""

from __future__ import annotations

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
from ..methods import label
from ..results import Results
from ..scenarios import LARGE, MODELS, collision, has_packing, missing_packings
from ..tables import number

TITLE = "Collisions: error over uncertainty, time over detail"
SPHERES, COUNTS, TIMED = 1000, (5, 10, 50, 100), (10, 100)
SIGMAS, FEW_SIGMAS = tuple(round(0.01 * k, 2) for k in range(1, 11)), (0.01, 0.05, 0.1)  # m
SIZES, MIDDLE = (10, 100, 1000, 10_000, LARGE), 0.05


def jobs(settings: Settings) -> list[Job]:
    """Return jobs for errors at each uncertainty, and for times at each number of spheres, of each model."""
    truth, sigmas, sizes = (200, FEW_SIGMAS, SIZES[:3]) if settings.quick else (1000, SIGMAS, SIZES)
    rounds = 1 if settings.quick else 5

    def job(model, spheres, sigma, truth, rounds):
        rollouts = 2 * truth + 300 * rounds
        cost = rollouts * rollout_cost(spheres) + 10 * distance_cost(truth)
        parameters = settings.parameters(
            model=model, spheres=spheres, sigma=sigma, truth=truth, rounds=rounds
        )
        return Job("collisions", parameters, cost=cost, alone=rounds > 0)

    errors = [job(model, SPHERES, sigma, truth, 0) for model in MODELS for sigma in sigmas]
    sized = [(model, spheres) for model in MODELS for spheres in sizes if has_packing(model, spheres)]
    return errors + [job(model, spheres, MIDDLE, 0, rounds) for model, spheres in sized]


def missing(settings: Settings) -> list[str]:
    """Return missing packings."""
    return [] if settings.quick else missing_packings()


def run(job: Job) -> Outcome:
    """Return W1 of every method after 5 s, or CPU times of predictions."""
    p = job.parameters
    scene, belief, horizon = collision(p["model"], p["spheres"], p["sigma"])
    if p["rounds"]:
        return Outcome(time_rows(predictors(scene, belief, horizon, job, TIMED), p["rounds"]))
    truth, second = two_truths(scene, belief, horizon, job)
    return Outcome(error_rows(job, truth, second, predicted(scene, belief, horizon, job), COUNTS))


def report(results: Results) -> str:
    """Return the two tables of which the results page has figures."""
    rows = results.rows("collisions")
    return _errors(results, rows.where(rounds=0)) + "\n" + _times(results, rows.where(truth=0))


def _errors(results, rows):
    lines = []
    for method, samples in rows.curves():
        found = rows.where(method=method, samples=samples)
        for model in found.unique("model"):
            for sigma in found.unique("sigma"):
                here = found.where(model=model, sigma=sigma)
                errors = (
                    here.where(quantity=quantity).mean() for quantity in (POSITION_ERROR, ROTATION_ERROR)
                )
                lines.append([label(method, samples), model, str(sigma), *map(number, errors)])
    return results.table(
        "collisions", ["method", "model", "sigma [m]", "W1 position [m]", "W1 rotation [deg]"], lines
    )


def _times(results, rows):
    lines = []
    for method, samples in rows.curves():
        found = rows.where(method=method, samples=samples)
        for model in found.unique("model"):
            for spheres in found.unique("spheres"):
                here = found.where(model=model, spheres=spheres)
                time = 1e3 * here.where(quantity=CPU_TIME).median()
                faster = 1.0 / here.where(quantity=TIME_RATIO).median()
                lines.append([label(method, samples), model, str(spheres), number(time), number(faster)])
    head = ["method", "model", "spheres", "CPU time [ms]", "times faster than MC-10"]
    return results.table("collisions_time", head, lines)
