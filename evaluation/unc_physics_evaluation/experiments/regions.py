"""Share of outcomes of random everyday scenes in 90 % regions."""

from __future__ import annotations

import numpy as np

from unc_physics import make_propagator, predict
from unc_physics.propagators.base import Samples, rollout_count

from ..goals import Figure, goal_tables, goals_met_by
from ..jobs import Job, Outcome, Row, Settings
from ..methods import MONTE_CARLO
from ..random_scenes import KINDS, random_case
from ..regions import PARTS, held
from ..results import Results
from ..scores import bootstrap

TITLE = "Regions of 90 % in random everyday scenes"
SCENES, OUTCOMES, LEVEL, WITHIN = 200, 1000, 0.9, 0.03
#: What is asked, by what people read.
METHODS = {
    "cloud-16": ("cloud", {"runs": 16}),
    "cloud-32": ("cloud", {}),
    "cloud-64": ("cloud", {"runs": 64}),
    "auto": ("auto", {}),
    "MC-32": (MONTE_CARLO, {"samples": 32}),
    "MC-100": (MONTE_CARLO, {"samples": 100}),
    "sigma points": ("sigma_points", {}),
}
#: Those whose regions are to be right.
JUDGED = ("cloud-32", "auto")
ROLLOUTS = "rollouts"


def jobs(settings: Settings) -> list[Job]:
    """Return a job for each scene."""
    scenes, outcomes = (len(KINDS), 200) if settings.quick else (SCENES, OUTCOMES)
    return [
        Job("regions", settings.parameters(scene=k, truth=outcomes), cost=outcomes * 3e-3)
        for k in range(scenes)
    ]


def run(job: Job) -> Outcome:
    """Return the shares of outcomes in each method's regions."""
    scene, belief, horizon = random_case(job.parameters["scene"])
    count, seed = job.parameters["truth"], job.seed("truth")
    outcomes = predict(scene, belief, make_propagator(MONTE_CARLO, samples=count, seed=seed), horizon)
    truth = outcomes.samples()
    rows = []
    for name, (kind, options) in METHODS.items():
        propagator = make_propagator(kind, **options)
        if "seed" in propagator.options():
            propagator = make_propagator(kind, **options, seed=job.seed(name))
        prediction = predict(scene, belief, propagator, horizon)
        rollouts = rollout_count(prediction.carry)
        rows.append(Row(name, ROLLOUTS, "", float(rollouts), None, 0, prediction.seed))
        samples = prediction.samples(None if isinstance(propagator, Samples) else OUTCOMES)
        shares = [
            held(prediction[body.name].modes, samples[:, k], truth[:, k], LEVEL)
            for k, body in enumerate(scene.bodies)
        ]
        found = {part: float(np.mean([share[part] for share in shares])) for part in PARTS}
        rows += [Row(name, key, "1", value, rollouts, 0, prediction.seed) for key, value in found.items()]
    return Outcome(rows)


def sections(results: Results) -> dict[str, list[Figure]]:
    """Return the section on each method's share over all scenes."""
    rows = results.rows("regions")
    figures, others = [], []
    for name in METHODS:
        for part in PARTS:
            shares = 100.0 * rows.where(method=name, quantity=part).values()
            if not len(shares):
                continue
            low, high = bootstrap(shares, np.random.default_rng(0))
            rollouts = rows.where(method=name, quantity=ROLLOUTS).median()
            note = f"{len(shares)} scenes, 95 % interval {low:.1f} to {high:.1f} %; {rollouts:g} rollouts"
            value = float(shares.mean())
            if name in JUDGED:
                off = abs(value - 100.0 * LEVEL)
                figures.append(
                    Figure(f"{name}, {part}", f"{value:.1f} %", off, "% off", 100.0 * WITHIN, True, note)
                )
            else:
                others.append(Figure(f"{name}, {part}", "outcomes held", value, "%", note=note))
    return {"Regions that hold 90 % of the samples": figures, "Others": others}


verdict = goals_met_by(sections)


def report(results: Results) -> str:
    """Return tables of the shares of all methods, and of goals with intervals."""
    rows, lines = results.rows("regions"), []
    for name in METHODS:
        shares = {part: rows.where(method=name, quantity=part).values() for part in PARTS}
        rollouts = rows.where(method=name, quantity=ROLLOUTS).median()
        if all(len(values) for values in shares.values()):
            lines.append(
                [name, f"{rollouts:g}", *(f"{100.0 * values.mean():.0f}" for values in shares.values())]
            )
    head = ["method", "rollouts in the median", *(f"{part} [%]" for part in PARTS)]
    return results.table("regions", head, lines) + goal_tables(sections(results))
