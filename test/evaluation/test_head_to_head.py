"""Errors over CPU time beside a loop around MuJoCo: known errors, and ratios that follow from rows."""

import pytest

from unc_physics_evaluation.experiments import head_to_head as experiment
from unc_physics_evaluation.experiments.head_to_head import LOOP, MEAN, PLAIN, PROBABILITY, SPREAD, TIME
from unc_physics_evaluation.jobs import Job, Row, Settings
from unc_physics_evaluation.results import Results, Rows


def test_errors_are_those_of_monte_carlo_in_both_engines(tmp_path, monkeypatch):
    """A mean of n draws is off by 1 / sqrt(n) of the spread; here also the engines agree on a push."""
    pytest.importorskip("mujoco")
    monkeypatch.setattr(experiment, "METHODS", ("monte_carlo samples=100", "auto"))
    monkeypatch.setattr(experiment, "SIZES", (100,))
    parameters = Settings().parameters(scene="push", truth_samples=400, replicates=4)
    job = Job("head_to_head", parameters)
    outcome = experiment.run(job)
    results = Results(tmp_path)
    results.add(job, outcome, {"versions": "", "machine": ""})
    rows = results.rows("head_to_head")
    found = experiment.curves(rows)
    for method in ("monte_carlo", LOOP):
        assert 0.04 < found[method][MEAN][0] < 0.22  # 0.11 with the truth's own error, four replicates
        assert found[method][SPREAD][0] < 0.2 and found[method][PROBABILITY][0] < 0.15
    assert found["auto"][MEAN][0] < 0.15 and PLAIN in found
    ours, other = (one["value"] for one in rows.where(quantity=experiment.TRUTH))
    assert ours == pytest.approx(other, abs=0.12)  # 3.3 standard errors of a difference
    report = experiment.report(results)
    assert "| push | MuJoCo loop |" in report and (tmp_path / "figures" / "head_to_head.png").is_file()


def test_ratios_follow_from_times_and_errors():
    """MuJoCo takes 1 ms a rollout: 100 ms for the mean, 84 ms for a probability of 0.3.

    An error of 0.1 lies halfway between 0.2 and 0.05, whose times differ by a factor of 4, in logarithms.
    """

    def rows_of(method, seconds, mean, probability, samples):
        values = {TIME: seconds, MEAN: mean, SPREAD: 0.1, PROBABILITY: probability}
        return [Row(method, quantity, "1", value, samples) for quantity, value in values.items()]

    rows = [
        *rows_of("cloud runs=12", 0.01, 0.2, 0.08, 12),
        *rows_of("cloud runs=32", 0.04, 0.05, 0.06, 32),
        *rows_of("auto", 0.042, 0.03, 0.02, 64),
        *rows_of(PLAIN, 0.035, 0.03, float("nan"), 64),
        *(row for size in experiment.SIZES for row in rows_of(LOOP, 0.001 * size, 0.1, 0.1, size)),
        Row(LOOP, experiment.TRUTH, "1", 0.3),
    ]
    found = experiment.ratios(Rows(row._asdict() for row in rows))
    assert found == ("0.200 (cloud)", "0.500 (auto)", "1.20")
