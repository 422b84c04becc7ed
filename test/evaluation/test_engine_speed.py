"""Engines: in turns, and each compared with itself, from the same draws."""

import numpy as np
import pytest

from unc_physics.spatial.layout import POSITION, QUATERNION
from unc_physics_evaluation import work_precision
from unc_physics_evaluation.experiments import engines as experiment
from unc_physics_evaluation.jobs import Settings
from unc_physics_evaluation.results import Results
from unc_physics_evaluation.rollouts import OURS, available
from unc_physics_evaluation.scenarios import PILES, five_into_bin, in_bin, is_upright


def test_rows_and_report(tmp_path, monkeypatch):
    monkeypatch.setattr(work_precision, "QUICK_SIZES", {"salt_box_into_bin": (4, 0.002)})
    box = experiment.SCENES["salt_box_into_bin"][0]
    monkeypatch.setattr(experiment, "SCENES", {"salt_box_into_bin": (box, 2, 0.002)})
    results, jobs = Results(tmp_path), experiment.jobs(Settings(quick=True))
    assert len(jobs) == 1 + 3 * len(available())
    for job in jobs:
        outcome = experiment.run(job)
        assert all(row.value > 0.0 for row in outcome.rows)
        results.add(job, outcome, {"versions": "", "machine": ""})
        if job.parameters["section"] == experiment.SPEED:
            assert len(outcome.rows) == 2 * 2 * 3 * len(available())
            continue
        assert ("second" in outcome.arrays) == (job.parameters["rate"] == job.parameters["converged"])
        if job.parameters["engine"] == OURS:
            np.testing.assert_array_equal(outcome.arrays["states"], experiment.run(job).arrays["states"])
    report = experiment.report(results)
    assert "| unc_physics | 240 |" in report and "| unc_physics | yes |" in report
    assert (tmp_path / "figures" / "work_precision.png").stat().st_size > 10_000


def test_a_full_run_has_every_scene_and_rate():
    jobs = [job.parameters for job in experiment.jobs(Settings())]
    assert {p["scene"] for p in jobs if p["section"] == experiment.SPEED} == set(experiment.GOALS)
    ours = [p for p in jobs if p["engine"] == OURS]
    assert {p["scene"] for p in ours} == set(work_precision.SCENES)
    assert {p["rate"] for p in ours} == {*work_precision.RATES, work_precision.CONVERGED[OURS]}


def test_bodies_in_place_and_upright():
    states = np.zeros((2, 5, 13))
    states[..., QUATERNION] = 0.0, 0.0, 0.0, 1.0
    states[..., POSITION] = 0.0, 0.0, 0.1
    states[1, 3, POSITION] = 0.2, 0.0, 0.1
    states[1, 4, QUATERNION] = np.sin(0.2), 0.0, 0.0, np.cos(0.2)
    assert in_bin(states).sum() == 9 and not in_bin(states)[1, 3]
    assert is_upright(states).sum() == 9 and not is_upright(states)[1, 4]


@pytest.mark.parametrize("name", PILES)
def test_bodies_of_a_pile_begin_apart(name):
    scene, belief, _ = PILES[name][0]()
    radii = [body.model.bounding_radius for body in scene.bodies]
    heights = belief.mean[:, POSITION][:, 2]
    assert np.all(np.diff(heights) > 0.1)
    # the lowest one clears the bottom, however it is turned
    assert heights[0] > radii[0] + 0.02
    assert five_into_bin()[0].integrator == "implicit"
