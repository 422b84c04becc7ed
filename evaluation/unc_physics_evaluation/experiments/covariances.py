"""Covariances of bodies that rest, slide, bounce, roll, or that a robot moves: methods against samples."""

from __future__ import annotations

import math

import numpy as np

from unc_physics import make_propagator, predict
from unc_physics.prediction.body_status import Status
from unc_physics.prediction.status import assess
from unc_physics.propagators.registry import PROPAGATORS
from unc_physics.spatial.layout import ERR_POSITION, ERR_ROTATION, QUATERNION
from unc_physics.spatial.rotation import rotation_matrix

from ..everyday_cases import ACTION_CASES, CASES, case
from ..goals import Figure, goal_tables, goals_met_by
from ..jobs import Job, Outcome, Row, Settings
from ..methods import MONTE_CARLO, label
from ..results import Results

TITLE = "Covariances at rest, sliding, bouncing and rolling, and where a robot acts"
SAMPLES, QUICK = 10_000, 2000
TRUTH, HALVES, FLAGGED, TIGHT = "truth", ("first half", "second half"), "flagged", "tight"
AXES = ("x", "y", "z", "rot x", "rot y", "rot z")
WITHIN = 0.05
#: Spreads below count as nothing [m], [rad]: a contact's own compliance, not the belief's.
NOTHING = (5e-5, 1e-3)
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
    """Return standard deviations of the pose along world axes: of the truth, its halves, and the methods."""
    p = job.parameters
    given, seed = case(p["case"], p["belief"]), job.seed(TRUTH)
    truth = make_propagator(MONTE_CARLO, samples=p["truth"], seed=seed)
    carry = predict(given.scene, given.belief, truth, given.horizon).carry
    half = p["truth"] // 2
    rows = []
    for name, part in zip((TRUTH, *HALVES), (slice(None), slice(half), slice(half, None)), strict=True):
        own = carry._replace(states=carry.states[part], parameters=carry.parameters[part])
        rows += _rows(name, truth.belief(own, given.scene), p["truth"], seed)
    for name in _methods(p["case"]):
        prediction = predict(given.scene, given.belief, name, given.horizon)
        rows += _rows(name, prediction.belief, None, prediction.seed)
        flags = assess(prediction)[0].flags & ~Status.INITIAL_OVERLAP
        rows.append(Row(name, FLAGGED, "1", float(bool(flags))))
    return Outcome(rows)


def _methods(name):
    """Return the compared methods of a case."""
    return ACTING if name in ACTION_CASES else METHODS


def _rows(method, belief, samples, seed):
    """Return rows of the standard deviations along and about x, y and z."""
    R, P = rotation_matrix(belief.mean[0, QUATERNION]), belief.blocks[0]
    variances = np.concatenate(
        [np.diag(P[ERR_POSITION, ERR_POSITION]), np.diag(R @ P[ERR_ROTATION, ERR_ROTATION] @ R.T)]
    )
    return [
        Row(method, axis, "m" if k < 3 else "rad", math.sqrt(max(variances[k], 0.0)), samples, 0, seed)
        for k, axis in enumerate(AXES)
    ]


def sections(results: Results) -> dict[str, list[Figure]]:
    """Return the section on linearization's worst errors, and whether the status flags them."""
    rows = results.rows("covariances")
    tight, acting = [], []
    for name in rows.unique("case"):
        some, methods = rows.where(case=name), _methods(name)
        here = _stds(some, name)
        far, axis = max((_off(here["linearization"], here[TRUTH], k), AXES[k]) for k in range(6))
        floor = max(_off(here[HALVES[0]], here[HALVES[1]], k) for k in range(6)) / 2.0
        others = ", ".join(
            f"{label(m, None)} {100.0 * max(_off(here[m], here[TRUTH], k) for k in range(6)):.1f} %"
            for m in methods
            if m != "linearization"
        )
        flagged = some.where(method="linearization", quantity=FLAGGED)[0]["value"]
        note = f"{axis}; {'' if flagged else 'not '}flagged; sampling floor {100.0 * floor:.1f} %; {others}"
        figure = Figure("linearization, worst axis", name, 100.0 * far, "% off", 100.0 * WITHIN, True, note)
        (acting if name in ACTION_CASES else tight).append(figure)
    return {"Tight beliefs": tight, "Tight beliefs, where a robot acts": acting}


def _stds(rows, name):
    """Return standard deviations (6,) by method."""
    return {
        method: np.array([rows.where(method=method, quantity=axis)[0]["value"] for axis in AXES])
        for method in (TRUTH, *HALVES, *_methods(name))
    }


def _off(found, truth, k):
    """Return the relative error of a standard deviation; 0 if both are 0."""
    nothing = NOTHING[k // 3]
    if found[k] < nothing and truth[k] < nothing:
        return 0.0
    return abs(found[k] / max(truth[k], 1e-12) - 1.0)


verdict = goals_met_by(sections)


def report(results: Results) -> str:
    """Return the tables."""
    return goal_tables(sections(results))
