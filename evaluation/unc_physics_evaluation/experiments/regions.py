"""Regions of 90 %: how many outcomes of random everyday scenes they hold."""

from __future__ import annotations

import math

import numpy as np

from unc_physics import make_propagator, predict
from unc_physics.prediction.body_status import Status
from unc_physics.prediction.status import assess
from unc_physics.propagators.base import Samples, rollout_count
from unc_physics.spatial.layout import ERR_POSITION, ERR_ROTATION

from ..goals import Figure, goal_tables, goals_met_by
from ..jobs import Job, Outcome, Row, Settings
from ..judgement import Judged, any_of, judge, rates
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
IGNORED = Status.INITIAL_OVERLAP
ROLLOUTS, BAD, FLAGGED = "rollouts", "bad", "flagged"
#: Spreads below count as nothing [m], [rad]: a contact's own compliance, not the belief's.
NOTHING = (5e-5, 1e-3)


def jobs(settings: Settings) -> list[Job]:
    """One for each scene."""
    scenes, outcomes = (len(KINDS), 200) if settings.quick else (SCENES, OUTCOMES)
    return [
        Job("regions", settings.parameters(scene=k, truth=outcomes), cost=outcomes * 3e-3)
        for k in range(scenes)
    ]


def run(job: Job) -> Outcome:
    """Shares of the outcomes that each method's regions hold, and whether its flags are right."""
    scene, belief, horizon = random_case(job.parameters["scene"])
    count, seed = job.parameters["truth"], job.seed("truth")
    outcomes = predict(scene, belief, make_propagator(MONTE_CARLO, samples=count, seed=seed), horizon)
    truth, true = outcomes.samples(), outcomes.belief
    rows = []
    for name, (of, options) in METHODS.items():
        own = make_propagator(of, **options)
        if "seed" in own.options():
            own = make_propagator(of, **options, seed=job.seed(name))
        prediction = predict(scene, belief, own, horizon)
        rollouts = rollout_count(prediction.carry)
        rows.append(Row(name, ROLLOUTS, "", float(rollouts), None, 0, prediction.seed))
        sampled = isinstance(own, Samples)
        measures = own.measures(prediction.carry, prediction.scene) if sampled else {}
        for measure, values in measures.items():
            rows.append(Row(name, measure, "1", float(np.max(values)), rollouts, 0, prediction.seed))
        samples = prediction.samples(None if sampled else OUTCOMES)
        shares = [
            held(prediction[body.name].modes, samples[:, k], truth[:, k], LEVEL)
            for k, body in enumerate(scene.bodies)
        ]
        found = {part: float(np.mean([one[part] for one in shares])) for part in PARTS}
        judged = any_of(
            judge(
                _spread(own_moments),
                _spread(moments),
                body.model.bounding_radius,
                bool(status.flags & ~IGNORED),
            )
            for own_moments, moments, body, status in zip(
                prediction.belief.blocks, true.blocks, scene.bodies, assess(prediction), strict=True
            )
        )
        found |= {BAD: float(judged.bad), FLAGGED: float(judged.flagged)}
        rows += [Row(name, key, "1", value, rollouts, 0, prediction.seed) for key, value in found.items()]
    return Outcome(rows)


def _spread(P):
    """Standard deviations of position and rotation of a covariance (12, 12), over all axes together."""
    whole = (math.sqrt(max(np.trace(P[block, block]), 0.0)) for block in (ERR_POSITION, ERR_ROTATION))
    return [value if value > nothing else 0.0 for value, nothing in zip(whole, NOTHING, strict=True)]


def sections(results: Results) -> dict[str, list[Figure]]:
    """Each method's share over all scenes."""
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
    flags = []
    for name in METHODS:
        own = rows.where(method=name)
        bad, flagged = (own.where(quantity=quantity).values() > 0.5 for quantity in (BAD, FLAGGED))
        judged = rates(Judged(1.0, 1.0, *one) for one in zip(bad, flagged, strict=True))
        note = f"{judged.bad} bad, {judged.good} good"
        shares = ("bad ones flagged", judged.found_share), ("good ones flagged", judged.false_share)
        flags += [Figure(what, name, share, "", note=note) for what, share in shares if not math.isnan(share)]
    return {
        "Regions that hold 90 % of the samples": figures,
        "Others": others,
        "Flags where a spread is off by more than a factor of 2": flags,
    }


verdict = goals_met_by(sections)


def report(results: Results) -> str:
    """All tables."""
    return goal_tables(sections(results))
