"""Engines: in turns, and each compared with itself, from the same draws."""

import numpy as np

from unc_physics_evaluation import work_precision
from unc_physics_evaluation.experiments import engines as experiment
from unc_physics_evaluation.jobs import Settings
from unc_physics_evaluation.results import Results
from unc_physics_evaluation.rollouts import OURS, available


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
    assert "| salt box into bin | unc_physics | 240 |" in report and "| unc_physics | yes |" in report
