"""Predicted distributions of recorded motions: by unc_physics, by other engines, and without physics."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from unc_physics.calibration.adjustable import FITTABLE, Model
from unc_physics.calibration.calibrate import fit_model
from unc_physics.calibration.objective import Simulator, as_recorded, seed_of, simulated
from unc_physics.calibration.scores import (
    angle,
    energy_score,
    gaussian_scores,
    pose_errors,
    rotation_energy_score,
)
from unc_physics.scene.presets import EXACT_PRESETS
from unc_physics.scene.scene import IMPACT_STDS, Scene
from unc_physics.spatial.layout import POSITION, QUATERNION

from ..jobs import Job, Outcome, Row, Settings
from ..marginal import marginal_prediction, still_prediction
from ..methods import MARGINAL, OURS, STILL
from ..polyhedron import face_normals, lowest_face
from ..push_predictions import push_outcomes, push_predictions
from ..recorded_engines import RecordedEngine
from ..recorded_sets import PushSet, RecordedSet, read_sets
from ..results import Results
from ..rollouts import available, missing_engines
from ..scores import brier_score

TITLE = "Reality"
TIMES = ("0.1 s", "0.2 s", "0.4 s", "rest")
DEFAULTS, EXACT, CALIBRATED = "default", "exact", "calibrated"
#: Most motions of a set, samples of each prediction; motions, samples of all motions, and models of a fit.
FULL = {"motions": 60, "samples_each": 100, "fit_motions": 20, "fit_draws": 240, "evaluations": 60}
QUICK = {"motions": 12, "samples_each": 50, "fit_motions": 8, "fit_draws": 64, "evaluations": 60}
_PUSHES = 20  # of a job
_LEAVE_ONE_OUT = 12  # motions, up to which ours leaves out one at a time
_FOLDS = {OURS: 5, "mujoco": 2, "pybullet": 2}
_SAMPLE = {OURS: 6e-4, "mujoco": 6e-3, "pybullet": 3e-3}  # s, about
POSITION_SCORE, ROTATION_SCORE, BRIER = "position score", "rotation score", "brier score"
POSITION_RANK, ROTATION_RANK, ERROR = "position rank", "rotation rank", "position error"
TIME = "cpu time"
#: Friction and restitution of engines that nobody has set: MuJoCo's, and PyBullet's.
_UNSET = {"mujoco": (1.0, 0.0), "pybullet": (0.5, 0.0)}
_WIDE = 1.0


def jobs(settings: Settings) -> list[Job]:
    """Return a job for each fold of each set and each prediction."""
    size = QUICK if settings.quick else FULL
    found = []
    for name, own in read_sets(settings.data).items():
        count = min(len(own.motions), size["motions"])
        for by in (*available(), MARGINAL):
            for given in _givens(own, by):
                folds = _folds(own, by, given, count)
                for fold in range(folds):
                    parameters = settings.parameters(
                        data=settings.data or "", set=name, by=by, given=given, fold=fold, folds=folds, **size
                    )
                    found.append(Job("reality", parameters, cost=_cost(own, parameters, count)))
    return found


def _givens(own, by):
    """With what a method predicts a set."""
    if by == MARGINAL:
        return (DEFAULTS,)
    if by != OURS or isinstance(own, PushSet):
        return DEFAULTS, CALIBRATED
    return DEFAULTS, EXACT, CALIBRATED


def _folds(own, by, given, count):
    if isinstance(own, PushSet):
        return -(-count // _PUSHES)
    if given != CALIBRATED:
        return 1
    return count if count <= (_LEAVE_ONE_OUT if by == OURS else _FOLDS[by]) else _FOLDS[by]


def _cost(own, p, count):
    if p["by"] == MARGINAL:
        return 1.0
    scored = count / p["folds"]
    if isinstance(own, PushSet):
        return scored * {OURS: 2.5}.get(p["by"], 0.6 if p["given"] == DEFAULTS else 3.0)
    fitted = 0.0
    if p["given"] == CALIBRATED:
        fitted = p["fit_draws"] * (p["evaluations"] + 75)
    return _SAMPLE[p["by"]] * (fitted + p["samples_each"] * scored)


def missing(settings: Settings) -> list[str]:
    """Return missing engines."""
    return missing_engines("reality")


def run(job: Job) -> Outcome:
    """Predict the motions of a fold, calibrated on the others if asked, and score the predictions."""
    p: Mapping[str, Any] = job.parameters
    own = read_sets(p["data"] or None)[p["set"]]
    seed = Job("reality", {"set": p["set"], "base_seed": p["base_seed"]}).seed("folds")
    order = np.random.default_rng(seed).permutation(len(own.motions))[: p["motions"]]
    tests = order[p["fold"] :: p["folds"]]
    others = np.setdiff1d(order, tests, assume_unique=True)
    if isinstance(own, PushSet):
        tests = [own.pushes[k] for k in tests]
        every = [own.pushes[k] for k in order]
        made = push_predictions(own.folder, tests, every, p["by"], p["given"] == CALIBRATED, seed)
        poses = push_outcomes(own.folder, tests)
        rows = [
            row
            for k, prediction, pose in zip(tests, made, poses, strict=True)
            for method, states in prediction.items()
            for row in _rows([states], [pose], None, method, k, seed)
        ]
        return Outcome(rows)
    if p["by"] == MARGINAL:
        return Outcome(_without_physics(own, order, seed))
    return Outcome(_by_physics(own, tests, others if len(others) else order, p, seed))


def _without_physics(own: RecordedSet, order, seed: int) -> list[Row]:
    normals, rows = face_normals(own.scene.bodies[0].model), []
    every = own.recorded(own.scene, order)
    for k, one in zip(order, every, strict=True):
        others = [other for other in every if other is not one]
        for method, states in ((MARGINAL, marginal_prediction(one, others)), (STILL, still_prediction(one))):
            rows += _rows(states, one.poses, normals, method, int(k), seed)
    return rows


def _by_physics(own: RecordedSet, tests, others, p, seed: int) -> list[Row]:
    simulate: Simulator = simulated if p["by"] == OURS else RecordedEngine(p["by"])
    rows: list[Row] = []
    if p["given"] == CALIBRATED:
        model, values = _calibrated(own, others[: p["fit_motions"]], p, simulate, seed)
        flies = model.scene
        rows += [Row(p["by"], f"fitted {name}", "1", value, replicate=p["fold"]) for name, value in values]
    else:
        flies = own.measured_scene(others)
        model = own.model(others, _given(own, flies, p["by"], p["given"]))
    normals = face_normals(own.scene.bodies[0].model)
    tested = own.recorded(flies, tests)  # with all corners: flights end with the first contact
    for k, one in zip(tests, tested, strict=True):
        own_seed = seed_of(seed, int(k))
        belief = one.start.belief(model.position_noise, model.rotation_noise)
        begun = time.process_time()
        states = simulate(model.scene, belief, one.times, p["samples_each"], own_seed)
        rows.append(Row(p["by"], TIME, "s", time.process_time() - begun, p["samples_each"], int(k)))
        states = as_recorded(states, model, own_seed)
        rows += _rows(states, one.poses, normals, p["by"], int(k), own_seed)
    if isinstance(simulate, RecordedEngine):
        simulate.close()
    return rows


def _given(own: RecordedSet, scene: Scene, by: str, given: str) -> Scene:
    """Return the scene of a set without calibration: default, exact, or an engine's."""
    if by == OURS and given != EXACT:
        return scene
    if by == OURS:  # what the scene file gives is exact already
        preset = EXACT_PRESETS["everyday"]
        friction = preset["friction"] if scene.friction_std else scene.friction
        restitution = preset["restitution"] if scene.restitution_std else scene.restitution
    else:
        friction, restitution = _UNSET[by]
    known = dict.fromkeys((*IMPACT_STDS, "friction_std", "restitution_std"), 0.0)
    return replace(scene, friction=friction, restitution=restitution, impact_friction_speed=None, **known)


def _calibrated(own: RecordedSet, others, p, simulate: Simulator, seed: int) -> tuple[Model, list]:
    """Return the model fitted to other motions, and its values."""
    scene = own.measured_scene(others)
    names = FITTABLE if p["by"] == OURS else [name for name in FITTABLE if name != "impact_friction_speed"]
    if own.starts is not None:
        names = [name for name in names if not name.endswith("_noise")]
    before = own.model(others, scene)
    found = fit_model(
        own.recorded(scene, others),
        before,
        own.adjusted(names),
        max(4, p["fit_draws"] // len(others)),
        p["evaluations"],
        seed,
        simulate=simulate,
    )
    return found.model, [(one.name, one.value) for one in found.fitted]


def _rows(
    states: Sequence[np.ndarray],
    poses: Sequence[np.ndarray],
    normals: np.ndarray | None,
    method: str,
    k: int,
    seed: int,
) -> Iterator[Row]:
    """Return scores of states (n, 13) against poses (7,), for times within the motion."""
    for when, x, pose in zip((*TIMES[: len(poses) - 1], TIMES[-1]), states, poses, strict=True):
        errors = pose_errors(x, pose)
        found = {
            POSITION_SCORE: ("m", energy_score(x[:, POSITION], pose[:3])),
            ROTATION_SCORE: ("rad", rotation_energy_score(x[:, QUATERNION], pose[3:], angle)),
            POSITION_RANK: ("1", gaussian_scores(errors.position, errors.seen_position, _WIDE)[1]),
            ROTATION_RANK: ("1", gaussian_scores(errors.rotation, errors.seen_rotation, _WIDE)[1]),
            ERROR: ("m", float(np.linalg.norm(errors.seen_position))),
        }
        for quantity, (unit, value) in found.items():
            yield Row(method, f"{quantity} {when}", unit, float(value), len(x), k, seed)
    if normals is not None:
        last = np.zeros((1, 13))
        last[0, QUATERNION] = poses[-1][3:]
        face = int(lowest_face(last, normals)[0])
        score = brier_score(lowest_face(states[-1], normals), face, len(normals))
        yield Row(method, BRIER, "1", score, len(states[-1]), k, seed)


def report(results: Results) -> str:
    """Return the tables, and write them as CSV files."""
    from ..reality_report import reality_report

    return reality_report(results)
