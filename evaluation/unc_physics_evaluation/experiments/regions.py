"""Share of outcomes of random everyday scenes in 90 % regions."""

from __future__ import annotations

import numpy as np

from unc_physics import make_propagator, predict
from unc_physics.propagators.base import Samples, rollout_count

from ..jobs import Job, Outcome, Row, Settings
from ..methods import MONTE_CARLO
from ..random_scenes import KINDS, random_case
from ..regions import PARTS, held
from ..results import Results

TITLE = "Regions of 90 % in random everyday scenes"
SCENES, OUTCOMES, LEVEL = 200, 1000, 0.9
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


def report(results: Results) -> str:
    """Return a table of the shares of all methods."""
    rows, lines = results.rows("regions"), []
    for name in METHODS:
        shares = {part: rows.where(method=name, quantity=part).values() for part in PARTS}
        rollouts = rows.where(method=name, quantity=ROLLOUTS).median()
        if all(len(values) for values in shares.values()):
            lines.append(
                [name, f"{rollouts:g}", *(f"{100.0 * values.mean():.0f}" for values in shares.values())]
            )
    head = ["method", "rollouts in the median", *(f"{part} [%]" for part in PARTS)]
    return results.table("regions", head, lines)
