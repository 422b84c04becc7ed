"""Real pushes: their data, the scene of one, and the experiment."""

import math

import numpy as np
import pytest

from unc_physics_evaluation.experiments import pushes as experiment
from unc_physics_evaluation.jobs import Job, Settings
from unc_physics_evaluation.recorded_pushes import (
    PATCH,
    block,
    feet_of,
    planar,
    push_scene,
    recorded_pushes,
    seen,
)
from unc_physics_evaluation.results import Results


def test_the_data_are_pushes():
    pushes = recorded_pushes()
    assert len(pushes.kind) == len(pushes.paths) == len(pushes.before) == 573
    moved = np.linalg.norm((pushes.after - pushes.before)[:, :2], axis=1)
    assert 1e-3 < np.median(moved) < 0.05
    for path in pushes.paths:
        assert (np.diff(path[:, 0]) > 0).all()
        speed = np.linalg.norm(path[-1, 1:3] - path[0, 1:3]) / (path[-1, 0] - path[0, 0])
        assert speed < 0.05  # m/s


def test_the_block_is_the_documented_one():
    pushes, model = recorded_pushes(), block(0)
    radii = model.radii[:, None]
    low, high = (model.centers - radii).min(axis=0), (model.centers + radii).max(axis=0)
    np.testing.assert_allclose(low[:2], -pushes.com, atol=1e-9)
    assert (high[:2] < pushes.polygon[[1, 2], [0, 1]] - pushes.com).all()  # sharp corners are left out
    assert low[2] == pytest.approx(-0.5 * pushes.height, abs=1e-12)
    np.testing.assert_allclose(feet_of(PATCH).mean(axis=0), pushes.com, atol=1e-6)


def test_an_experiment_predicts_pushes(tmp_path):
    results = Results(tmp_path)
    for by in ("ours", experiment.LIMIT_SURFACE):
        parameters = {"by": by, "kind": "point", "first": 0, "last": 2, "of": 2, "samples_each": 8}
        job = Job("pushes", Settings().parameters(**parameters))
        results.add(job, experiment.run(job), {"versions": "", "machine": ""})
    rows = results.rows("pushes")
    errors = rows.where(method=experiment.NOMINAL, quantity=experiment.POSITION).values()
    stays = rows.where(method=experiment.STAYS, quantity=experiment.POSITION).values()
    assert (errors < 0.5 * stays).all() and (errors < 5e-3).all()
    report = experiment.report(results)
    for title in ("one rollout", "ellipsoidal limit surface"):
        assert f"| point, 2 | {title} |" in report
    assert len(experiment.jobs(Settings())) > len(experiment.jobs(Settings(quick=True)))


def test_a_pusher_ends_at_the_edge():
    """The tip is where the block is, when the push ends: at its edge, to the calibration's errors."""
    k = int(np.flatnonzero(recorded_pushes().kind == 0)[0])
    push = push_scene(k, uncertain=False)
    path = push.scene.bodies[1].trajectory
    x, y, theta = seen(k)
    c, s = math.cos(theta), math.sin(theta)
    tip = np.array([[c, s], [-s, c]]) @ (path.positions[-1, :2] - [x, y]) + recorded_pushes().com
    gaps = [tip[0], tip[1], (0.15 - tip[0] - tip[1]) / math.sqrt(2.0)]
    assert min(abs(gap) for gap in gaps) < 2e-3
    assert planar(push.belief.mean[0]).shape == (3,)
