"""Covariances of bodies that rest, slide, bounce, roll, or that a robot moves: methods against samples."""

from __future__ import annotations

import math

import numpy as np

from unc_physics import make_propagator, predict
from unc_physics.prediction.body_status import Status
from unc_physics.prediction.status import assess
from unc_physics.propagators.registry import PROPAGATORS
from unc_physics.spatial.layout import ERR_POSITION, ERR_ROTATION

from ..everyday_cases import ACTION_CASES, CASES, case
from ..jobs import Job, Outcome, Row, Settings
from ..methods import MONTE_CARLO, label
from ..results import Results
from ..tables import number, table

TITLE = "Covariances at rest, sliding, bouncing and rolling, and where a robot acts"
SAMPLES, QUICK = 10_000, 2000
TRUTH, FLAGGED, TIGHT = "truth", "flagged", "tight"
SPREADS = {"position": (ERR_POSITION, "m"), "rotation": (ERR_ROTATION, "rad")}
METHODS = [name for name in PROPAGATORS if name != MONTE_CARLO]
#: Those that take what a robot does.
ACTING = [name for name in METHODS if "implicit" in PROPAGATORS[name].supports.actions]


def jobs(settings: Settings) -> list[Job]:
    """Return a job for each case."""
    samples = QUICK if settings.quick else SAMPLES
    return [
        Job("covariances", settings.parameters(case=name, belief=TIGHT, truth=samples), cost=samples * 2e-3)
        for name in (*CASES, *ACTION_CASES)
    ]


def run(job: Job) -> Outcome:
    """Return standard deviations of position and rotation: of the truth, and of the methods with flags."""
    p = job.parameters
    scene, belief, horizon = case(p["case"], p["belief"])
    seed = job.seed(TRUTH)
    truth = make_propagator(MONTE_CARLO, samples=p["truth"], seed=seed)
    rows = _rows(TRUTH, predict(scene, belief, truth, horizon).belief, p["truth"], seed)
    for name in ACTING if p["case"] in ACTION_CASES else METHODS:
        prediction = predict(scene, belief, name, horizon)
        rows += _rows(name, prediction.belief, None, prediction.seed)
        flags = assess(prediction)[0].flags & ~Status.INITIAL_OVERLAP
        rows.append(Row(name, FLAGGED, "1", float(bool(flags))))
    return Outcome(rows)


def _rows(method, belief, samples, seed):
    return [
        Row(method, name, unit, math.sqrt(np.trace(belief.blocks[0][part, part])), samples, 0, seed)
        for name, (part, unit) in SPREADS.items()
    ]


def report(results: Results) -> str:
    """Return the table of spreads over those of the samples."""
    rows, lines = results.rows("covariances"), []
    for name in rows.unique("case"):
        here = rows.where(case=name)
        for method in (method for method in here.unique("method") if method != TRUTH):
            own, true = here.where(method=method), here.where(method=TRUTH)
            shares = [own.where(quantity=q).mean() / true.where(quantity=q).mean() for q in SPREADS]
            flagged = "yes" if own.where(quantity=FLAGGED).mean() else "no"
            lines.append([name, label(method, None), *map(number, shares), flagged])
    return table(
        ["motion", "method", *(f"spread of {name}, over the samples'" for name in SPREADS), "flagged"], lines
    )
