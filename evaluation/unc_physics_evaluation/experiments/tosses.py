"""Reality: recorded tosses of a cube, predicted by every method and engine, tuned on other tosses."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import numpy as np

from unc_physics.calibration.adjustable import Model, with_values
from unc_physics.calibration.flight import flight_gravity
from unc_physics.calibration.objective import (
    Objective,
    Recorded,
    Simulator,
    as_recorded,
    recorded,
    seed_of,
    simulated,
)
from unc_physics.calibration.scores import (
    angle,
    energy_score,
    log_score,
    mahalanobis_rank,
    pose_errors,
    rotation_energy_score,
)
from unc_physics.calibration.search import Search
from unc_physics.scene.stiffness import with_stiffness
from unc_physics.spatial.layout import POSITION, QUATERNION

from ..jobs import Job, Outcome, Row, Settings
from ..methods import MARGINAL, MONTE_CARLO, OURS
from ..recorded_tosses import FACES, recorded_tosses, top_face
from ..results import Results
from ..rollouts import available, missing_engines
from ..scores import brier_score
from ..toss_engines import TossEngine
from ..toss_marginal import marginal_predictions
from ..toss_methods import toss_methods
from ..toss_models import FIRST, PLAIN, TUNED, tuned_parameters, untuned

TITLE = "Tosses"
LABELS = ("0.1 s", "0.2 s", "0.4 s", "rest")
FOLDS = 5
#: Tosses, folds, and what tuning may cost: tosses, samples of each, and models tried.
FULL = {"tosses": 285, "folds": FOLDS, "tuning_tosses": 40, "tuning_samples": 8, "evaluations": 56}
QUICK = {"tosses": 24, "folds": 2, "tuning_tosses": 10, "tuning_samples": 8, "evaluations": 28}
SAMPLES, TRUTH = 100, 1000
#: What a scene is given: nothing tuned; tuned but for the errors of the model; all.
AS_GIVEN, NO_ERRORS, ERRORS = "as given", "no model errors", "model errors"
BRIER, LOG = "brier_score", "log_score"
POSITION_SCORE, ROTATION_SCORE = "energy_score_position", "energy_score_rotation"
POSITION_RANK, ROTATION_RANK = "rank_position", "rank_rotation"
SHARE, FACE, COST, TUNED_VALUE = "share_of_face", "face", "cpu_time", "tuned"

_AXES = "ahead", "to the left", "upwards"


def jobs(settings: Settings) -> list[Job]:
    """Each fold in every engine that is there; ours also as it is given, and without errors of the model."""
    size = QUICK if settings.quick else FULL
    found = []
    for engine in available():
        for given in (ERRORS, NO_ERRORS, AS_GIVEN) if engine == OURS else (ERRORS,):
            for fold in range(size["folds"]):
                parameters = settings.parameters(
                    engine=engine, given=given, fold=fold, **size, samples_each=SAMPLES
                )
                found.append(Job("tosses", parameters, cost=_cost(parameters)))
    return found


def _cost(p):
    a_sample = {OURS: 4e-4, "pybullet": 3e-3, "mujoco": 6e-3}[p["engine"]]
    tuning = 0 if p["given"] == AS_GIVEN else p["evaluations"] * p["tuning_tosses"] * p["tuning_samples"]
    scoring = p["tosses"] / p["folds"] * (1500 if p["engine"] == OURS else p["samples_each"])
    return a_sample * (tuning + scoring)


def missing(settings: Settings) -> list[str]:
    """Engines that are not installed."""
    return missing_engines("tosses")


def run(job: Job) -> Outcome:
    """Tune on the tosses of other folds, and score those of this one."""
    p, tosses = job.parameters, recorded_tosses()
    # the same folds and draws in every engine
    seed = Job("tosses", {"base_seed": p["base_seed"]}).seed("folds")
    order = np.random.default_rng(seed).permutation(len(tosses.states))[: p["tosses"]]
    scored_here = order[p["fold"] :: p["folds"]]
    others = np.setdiff1d(order, scored_here, assume_unique=True)
    level = tosses.level(others)
    motions = {int(k): tosses.motion(k, level) for k in order}
    model = untuned(tosses)
    rows, engine = [], None
    simulate: Simulator = simulated
    if p["engine"] != OURS:
        simulate = engine = TossEngine(p["engine"])
    if p["given"] != AS_GIVEN:
        model = untuned(tosses, flight_gravity([motions[int(k)] for k in others], model.scene))
        names = TUNED if p["given"] == ERRORS else PLAIN
        adjusted = [one for one in tuned_parameters(tosses, others) if one.name in names]
        some = recorded([motions[int(k)] for k in others[: p["tuning_tosses"]]], model.scene)
        begin = {one.name: FIRST.get(one.name, one.begin(model)) for one in adjusted}
        first = with_values(model, adjusted, begin)
        objective = Objective(some, p["tuning_samples"], seed, simulate)
        search = Search(objective, first, adjusted, lambda score: None)
        search.run(p["evaluations"])
        values = search.values
        model = with_values(first, adjusted, values)
        found = [(one.name, one.unit or "1", values[one.name]) for one in adjusted]
        found += [
            (f"gravity {axis}", "m/s^2", float(value))
            for axis, value in zip(_AXES, model.scene.gravity, strict=True)
        ]
        rows += [
            Row(MONTE_CARLO, f"{TUNED_VALUE} {name}", unit, value, replicate=p["fold"])
            for name, unit, value in found
        ]
    model = model._replace(scene=with_stiffness(model.scene, tosses.states[0][:1]))
    tests = recorded([motions[int(k)] for k in scored_here], model.scene)
    if engine is None and p["given"] == ERRORS:
        methods = toss_methods(model.scene, p["samples_each"], TRUTH)
    elif engine is None:
        methods = toss_methods(model.scene, p["samples_each"], names=(MONTE_CARLO,))
    else:
        methods = {(MONTE_CARLO, p["samples_each"]): engine}
    for (method, samples), predict in methods.items():
        rows += _scores(tests, model, predict, method, samples, p["samples_each"], seed)
    if engine is not None:
        engine.close()
    elif p["given"] == AS_GIVEN:
        predictions = marginal_predictions(tests, recorded([motions[int(k)] for k in others], model.scene))
        for one, states in zip(tests, predictions, strict=True):
            rows += _rows_of(one, states, MARGINAL, None, None)
    return Outcome(rows)


def _scores(
    tests: Sequence[Recorded],
    model: Model,
    predict: Simulator | Callable,
    method: str,
    samples: int | None,
    drawn: int,
    seed: int,
) -> list[Row]:
    """Rows of every toss by one method."""
    rows = []
    for one in tests:
        own = seed_of(seed, _number(one))
        belief = one.start.belief(model.position_noise, model.rotation_noise)
        started = time.process_time()
        states = predict(model.scene, belief, one.times, samples or drawn, own)
        spent = time.process_time() - started
        rows += _rows_of(one, as_recorded(states, model, own), method, samples, own)
        rows.append(Row(method, COST, "s", spent, samples, _number(one), own))
    return rows


def _number(one):
    return int(one.motion.name.split()[-1])


def _rows_of(one, states, method, samples, seed):
    """Rows of one toss from states (n, 13) at its times; a short toss has no longer times than its end."""
    k, rows = _number(one), []
    labels = (*LABELS[: len(one.times) - 1], LABELS[-1])

    def add(quantity, unit, value):
        rows.append(Row(method, quantity, unit, float(value), samples, k, seed))

    for label, x, pose in zip(labels, states, one.poses, strict=True):
        errors = pose_errors(x, pose)
        add(f"{POSITION_SCORE} {label}", "m", energy_score(x[:, POSITION], pose[:3]))
        add(f"{ROTATION_SCORE} {label}", "rad", rotation_energy_score(x[:, QUATERNION], pose[3:], angle))
        add(f"{POSITION_RANK} {label}", "1", mahalanobis_rank(errors.position, errors.seen_position))
        add(f"{ROTATION_RANK} {label}", "1", mahalanobis_rank(errors.rotation, errors.seen_rotation))
    last = np.zeros(13)
    last[QUATERNION] = one.poses[-1][3:]
    faces, face = top_face(states[-1]), int(top_face(last))
    add(BRIER, "1", brier_score(faces, face, FACES))
    add(LOG, "1", log_score(faces == face))
    add(FACE, "1", face)
    for f in range(FACES):
        add(f"{SHARE} {f}", "1", np.mean(faces == f))
    return rows


def report(results: Results) -> str:
    """Scores, coverage, differences, tuned values and reliability."""
    from ..toss_report import toss_report

    return toss_report(results)


def verdict(results: Results) -> str:
    """How many of the goals are met."""
    from ..toss_report import goals

    return goals(results)
