"""Everyday scenes beside other engines: time of a rollout, and error over time against a converged run."""

from __future__ import annotations

import itertools
from dataclasses import replace
from functools import partial

import numpy as np

from .. import work_precision
from ..jobs import Job, Outcome, Row, Settings
from ..methods import OURS
from ..results import Results
from ..rollouts import ENGINES, available, missing_engines, rollouts
from ..scenarios import (
    boxes_and_cans,
    can_off_shelf,
    carton_off_shelf,
    five_into_bin,
    salt_box_into_bin,
    tableware_into_box,
)
from ..tables import number

TITLE = "Engines"
SPEED, PRECISION = "speed", "precision"
ALL = "all"  # engines, in one job
#: For each scene its maker, rollouts of a round, and about the cost of one [s].
SCENES = {
    "salt_box_into_bin": (salt_box_into_bin, 20, 0.002),
    "can_off_shelf": (can_off_shelf, 20, 0.002),
    "carton_off_shelf": (carton_off_shelf, 20, 0.002),
    "five_into_bin": (five_into_bin, 8, 0.015),
    "ten_into_bin": (partial(boxes_and_cans, 10), 4, 0.03),
    "tableware_into_box": (tableware_into_box, 4, 0.07),
    "64_into_bin": (partial(boxes_and_cans, 64), 1, 0.5),
    "300_into_bin": (partial(boxes_and_cans, 300, 300), 1, 7.0),
}
_QUICK_COST = 1.0  # s, of a rollout; scenes that take longer are no part of a quick run
RATE = 240  # steps in a second
TIME, RATIO = "rollout_time", "rollout_time_over_ours"
_SLEEP = {False: "", True: " with sleep"}


def jobs(settings: Settings) -> list[Job]:
    """Each scene's times, all engines in turns, then what `work_precision` needs."""
    rounds, found = 3 if settings.quick else 11, []
    for scene, (_, count, cost) in SCENES.items():
        if settings.quick and cost > _QUICK_COST:
            continue
        parameters = work_precision.parameters(settings, SPEED, scene, ALL, RATE, 0, rounds * count)
        found.append(Job("engines", parameters, 20.0 + 8 * rounds * count * cost))
    return found + work_precision.jobs(settings, "engines", PRECISION)


def missing(settings: Settings) -> list[str]:
    """Engines that are not installed."""
    return missing_engines("engines")


def run(job: Job) -> Outcome:
    """Times of one scene, or an engine's final states at one rate."""
    return work_precision.run(job) if job.parameters["section"] == PRECISION else _times(job)


def _times(job):
    """CPU times of a rollout in each engine, without and with sleep, in turns."""
    p = job.parameters
    make, count, _ = SCENES[p["scene"]]
    scene, belief, horizon = make()
    scene, steps = replace(scene, dt=1.0 / p["rate"]), round(horizon * p["rate"])
    rounds = p["samples_each"] // count
    starts = belief.sample(rounds * count, np.random.default_rng(job.seed("starts")))
    starts = starts.reshape(rounds, count, *belief.mean.shape)
    opened, times = {}, {}
    for engine in available():
        for sleep in (False, True):
            opened[engine, sleep] = rollouts(engine, replace(scene, sleep=sleep))
            times[engine, sleep] = np.empty(rounds)
    runs = {key: context.__enter__() for key, context in opened.items()}
    try:
        for run_all in runs.values():
            run_all(starts[0, :1], 1)  # compiles, or loads what is compiled
        for k in range(rounds):
            for key, run_all in runs.items():
                times[key][k] = run_all(starts[k], steps)[1] / count
    finally:
        for context in opened.values():
            context.__exit__(None, None, None)
    rows = []
    for (engine, sleep), taken in times.items():
        name = engine + _SLEEP[sleep]
        for k, seconds in enumerate(taken):
            rows.append(Row(name, TIME, "s", float(seconds), None, k))
            # like against like: with sleep both, or neither
            rows.append(Row(name, RATIO, "1", float(seconds / times[OURS, sleep][k]), None, k))
    return Outcome(rows)


def report(results: Results) -> str:
    """Return times, then errors over time."""
    rows = results.rows("engines").where(section=SPEED)
    head = ["scene", "engine", "sleep", "CPU time [ms]", "median of paired ratios to unc_physics"]
    lines = []
    for scene, engine, sleeps in itertools.product(rows.unique("scene"), ENGINES, _SLEEP):
        found = rows.where(scene=scene, method=engine + _SLEEP[sleeps])
        if found:
            taken, share = found.where(quantity=TIME), found.where(quantity=RATIO)
            figures = number(1e3 * taken.median()), "1" if engine == OURS else number(share.median())
            lines.append([scene.replace("_", " "), ENGINES[engine], "yes" if sleeps else "no", *figures])
    times = results.table("engine_times", head, lines)
    parts = ["### CPU time of a rollout\n", times]
    precision = results.rows("engines").where(section=PRECISION)
    if precision:
        parts += ["## Error over time\n", work_precision.report(results, precision)]
    return "\n".join(parts)
