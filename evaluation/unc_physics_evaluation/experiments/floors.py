"""Floors: what W1 reads between two samples of one truth, and what the best single Gaussian can reach."""

from __future__ import annotations

import numpy as np

from ..comparison import POSITION_ERROR, ROTATION_ERROR, distance_cost, error_rows, rollout_cost, two_truths
from ..jobs import Job, Outcome, Settings
from ..methods import FLOOR, GAUSSIAN
from ..results import Results
from ..scenarios import MODELS, collision
from ..tables import number, table

TITLE = "Floors"
SIGMAS = (0.01, 0.05, 0.1)  # m
SIZES = (50, 100, 200, 500, 1000)
SUBSETS = 8  # of each size, at most
HEAD = "|floor, position [m]|best Gaussian [m]|ratio|floor, rotation [deg]|best Gaussian [deg]|ratio"


def jobs(settings: Settings) -> list[Job]:
    """Every model and three sigmas; two truths each."""
    truth, sizes = (400, SIZES[:3]) if settings.quick else (8000, SIZES)
    cost = 2 * truth * rollout_cost(1000) + sum(
        2 * min(truth // n, SUBSETS) * distance_cost(n, settings.distance) for n in sizes
    )
    return [
        Job(
            "floors",
            settings.parameters(model=model, spheres=1000, sigma=sigma, truth=truth, largest=sizes[-1]),
            cost=cost,
        )
        for model in MODELS
        for sigma in SIGMAS
    ]


def run(job: Job) -> Outcome:
    """W1 between subsets of two truths, and of a truth's Gaussian, by the size of the subsets."""
    p = job.parameters
    scene, belief, horizon = collision(p["model"], p["spheres"], p["sigma"])
    truth, second = two_truths(scene, belief, horizon, job)
    rows = []
    for size in SIZES[: SIZES.index(p["largest"]) + 1]:
        some = slice(0, SUBSETS * size)
        parts = (samples._replace(states=samples.states[some]) for samples in (truth, second))
        rows += [row._replace(samples=size) for row in error_rows(job, *parts, {}, (), size)]
    return Outcome(rows)


def report(results: Results) -> str:
    """A figure over the number of samples, and a table at the largest."""
    from ..plots import draw_floors

    rows = results.rows("floors")
    figure = results.figure("floors")
    draw_floors(figure, rows)
    size = 1000 if 1000 in rows.unique("samples") else max(rows.unique("samples"))
    lines = []
    for model in rows.unique("model"):
        for sigma in rows.unique("sigma"):
            cells = [f"{model}, {sigma} m"]
            for quantity in (POSITION_ERROR, ROTATION_ERROR):
                found = rows.where(model=model, sigma=sigma, quantity=quantity, samples=size)
                floor, gaussian = found.where(method=FLOOR), found.where(method=GAUSSIAN)
                cells += [f"{number(floor.mean())} ± {number(floor.std())}", number(gaussian.mean())]
                cells.append(f"{np.divide(gaussian.mean(), floor.mean()):.2f}")
            lines.append(cells)
    return (
        "W1 between two finite samples of one distribution is not zero: that is the floor below which no"
        " method can be told from the truth. A single Gaussian has a floor of its own, W1 between the truth"
        " and the Gaussian with the truth's moments; no Gaussian method can do better but by"
        f" chance.\n\n![Floors over the number of samples](figures/{figure.name})\n\nWith {size} samples (±"
        " standard deviation over subsets):\n\n" + table(HEAD.split("|"), lines)
    )
