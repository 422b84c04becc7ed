"""Choosing one of ten release poses over a bin: by a race, and by 1 000 samples of each.

A carton of salt is let go over a bin at ten places along it, or in ten turns, and is to end inside, or inside
and upright. The race (`unc_physics.rank`) draws other rollouts than the samples that it is judged by, which
are 1 000 of each pose with common draws.
"""

from __future__ import annotations

import math
import time

import numpy as np

from unc_physics import (
    Belief,
    BodyBelief,
    BoxRegion,
    Inside,
    RigidBody,
    Scene,
    Upright,
    load_model,
    make_propagator,
    predict,
    rank,
)
from unc_physics.prediction.probability import sample_outcomes
from unc_physics.prediction.racing import difference
from unc_physics.scene.stiffness import with_stiffness

from ..comparison import CPU_TIME
from ..goals import Figure, goal_tables, goals_met_by
from ..jobs import Job, Outcome, Row, Settings
from ..methods import MONTE_CARLO
from ..results import Results
from ..scenarios import open_bin

TITLE = "Choosing among ten release poses"
POSES, SAMPLES, HORIZON = 10, 1000, 0.8  # s
SHORTFALL, BEHIND, ROLLOUTS, CALLED = "shortfall", "standard_errors_behind", "rollouts", "best_called_worse"
RACE = "race"
_BIN = 0.30, 0.20, 0.147  # m, inside
_INSIDE = BoxRegion("inside", (0.30, 0.20, 0.15), (0.0, 0.0, 0.075))
_ENDS_INSIDE = Inside("salt_box", _INSIDE)
#: By name: places along the bin [m], turns about the axis across it [rad], and what is wanted.
CASES = {
    "places": (np.linspace(0.0, 0.2, POSES), np.zeros(POSES), _ENDS_INSIDE),
    "close places": (np.linspace(0.11, 0.155, POSES), np.zeros(POSES), _ENDS_INSIDE),
    "upright": (np.linspace(-0.09, 0.09, POSES), np.zeros(POSES), _ENDS_INSIDE & Upright("salt_box")),
    "turns": (np.zeros(POSES), np.linspace(-0.5, 0.4, POSES), _ENDS_INSIDE & Upright("salt_box", (0, 0, 1))),
}
_WITHIN = 2.0  # standard errors
_SHARE = 0.2  # of the time


def jobs(settings: Settings) -> list[Job]:
    """Several rankings of each case, which differ in their seeds."""
    count = 1 if settings.quick else 12
    samples = 200 if settings.quick else SAMPLES
    return [
        Job("choosing", settings.parameters(case=case, samples_each=samples, round=k), cost=0.01 * samples)
        for case in CASES
        for k in range(count)
    ]


def poses(case: str) -> tuple[Scene, dict[str, Belief], object]:
    """The scene, the belief by each pose, and the score."""
    places, turns, score = CASES[case]
    model = load_model("salt_box").prefix(100)
    scene = Scene.everyday([RigidBody("salt_box", model)], environment=open_bin(*_BIN), restitution=0.2)
    actions = {}
    for place, turn in zip(places.tolist(), turns.tolist(), strict=True):
        held = BodyBelief(
            position=(place, 0.0, 0.17) - model.origin,
            orientation=(0.0, math.sin(0.5 * turn), 0.0, math.cos(0.5 * turn)),
            position_std=0.01,
            orientation_std=0.05,
            linear_velocity_std=1e-3,
            angular_velocity_std=1e-3,
        )
        actions[f"{place:.3f} m, {turn:.2f} rad"] = Belief.of(scene, {"salt_box": held})
    return with_stiffness(scene, next(iter(actions.values())).mean), actions, score


def run(job: Job) -> Outcome:
    """How far behind the best pose the chosen one is by many samples of each, and what both cost."""
    p = job.parameters
    scene, actions, score = poses(p["case"])
    first = next(iter(actions.values()))
    seed, other, samples = job.seed("race"), job.seed("truth"), p["samples_each"]
    rank(scene, first, actions, score, 2 * scene.dt, rollouts=16)  # compiles, or loads what is compiled
    begun = time.process_time()
    ranking = rank(scene, first, actions, score, HORIZON, rollouts=samples, seed=seed)
    race = time.process_time() - begun
    begun = time.process_time()
    outcomes = {}
    for name, belief in actions.items():
        every = make_propagator(MONTE_CARLO, samples=samples, seed=other)
        prediction = predict(scene, belief, every, HORIZON)
        outcomes[name] = score.happened(sample_outcomes(scene, belief, prediction.at()))
    full = time.process_time() - begun
    best = max(outcomes, key=lambda name: outcomes[name].mean())
    behind = difference(outcomes[best], outcomes[ranking.best.name])
    return Outcome(
        [
            Row(RACE, SHORTFALL, "1", behind.value, samples, p["round"], seed),
            Row(RACE, BEHIND, "1", behind.value / behind.std, samples, p["round"], seed),
            Row(RACE, ROLLOUTS, "1", ranking.rollouts, samples, p["round"], seed),
            Row(RACE, CALLED, "1", float(ranking[best].clearly_worse), samples, p["round"], seed),
            Row(RACE, CPU_TIME, "s", race, samples, p["round"], seed),
            Row(MONTE_CARLO, CPU_TIME, "s", full, samples, p["round"], other),
        ]
    )


def sections(results: Results) -> dict[str, list[Figure]]:
    """All figures, by the goals that they belong to."""
    rows = results.rows("choosing")
    figures = []
    for case in rows.unique("case"):
        here = rows.where(case=case)
        behind = here.where(quantity=BEHIND).values()
        samples, short = here[0]["samples"], here.where(quantity=SHORTFALL).values()
        called = here.where(quantity=CALLED).values().sum()
        figures.append(
            Figure(
                f"races whose choice is within two standard errors of the best by {samples} samples each",
                case,
                100.0 * float(np.mean(behind <= _WITHIN)),
                "%",
                95.0,
                note=f"{len(behind)} races; the choice is worse by {np.mean(short):.4f} in the mean, by"
                f" {np.max(short):.4f} at most; the best one was called clearly worse in {called:.0f}",
            )
        )
        race = here.where(method=RACE, quantity=CPU_TIME).values()
        full = here.where(method=MONTE_CARLO, quantity=CPU_TIME).values()
        figures.append(
            Figure(
                "CPU time, a share of that of these samples",
                case,
                float(np.median(race / full)),
                "",
                _SHARE,
                at_most=True,
                note=f"{here.where(quantity=ROLLOUTS).mean():.0f} rollouts of {POSES * samples}; median"
                f" {np.median(race):.2f} s against {np.median(full):.2f} s",
            )
        )
    return {"A carton of salt over a bin, ten release poses": figures}


def report(results: Results) -> str:
    """The figures beside their goals."""
    return goal_tables(sections(results))


verdict = goals_met_by(sections)
