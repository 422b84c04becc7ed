"""The folder of results: what was written is read back, and what an interruption left half written is done
again.
"""

import pytest

from unc_physics.checks.errors import OutputError
from unc_physics_evaluation.jobs import Job, Outcome, Row
from unc_physics_evaluation.results import Results

ORIGIN = {"versions": "unc_physics 0.1.0; python 3.11", "machine": "Some(R) CPU, 2 threads"}


def job(sigma):
    return Job("paper", {"model": "bunny", "sigma": sigma})


def outcome(count, value=0.1):
    return Outcome([Row("surrogate", "w1_position", "m", value + k, None, k, 7) for k in range(count)])


def test_rows_are_read_back(tmp_path):
    results = Results(tmp_path)
    results.add(
        job(0.05), Outcome([Row("monte_carlo", "w1_position", "m", 1.0 / 3.0, 10, 2, 4_000_000_000)]), ORIGIN
    )
    (row,) = results.rows("paper")
    assert row["value"] == 1.0 / 3.0
    assert (row["model"], row["sigma"], row["samples"], row["replicate"], row["seed"]) == (
        "bunny",
        0.05,
        10,
        2,
        4_000_000_000,
    )
    assert row["versions"] == ORIGIN["versions"] and row["machine"] == ORIGIN["machine"]


def test_a_file_cut_off_anywhere_loses_at_most_its_last_job(tmp_path):
    """Whatever the interruption left, the file can be added to and holds whole jobs only."""
    results, jobs = Results(tmp_path), [job(0.01), job(0.02)]
    path = tmp_path / "paper.csv"
    results.add(jobs[0], outcome(2), ORIGIN)
    first = len(path.read_bytes())
    results.add(jobs[1], outcome(12), ORIGIN)
    whole = path.read_bytes()
    for length in [*range(0, len(whole), 11), len(whole) - 1]:
        path.write_bytes(whole[:length])
        missing = results.missing(jobs)
        assert missing == (jobs if length < first else jobs[1:])
        for again in missing:
            results.add(again, outcome(2 if again == jobs[0] else 12), ORIGIN)
        assert sorted(path.read_bytes().splitlines()) == sorted(whole.splitlines())


def test_other_columns_are_refused_before_any_work(tmp_path):
    results = Results(tmp_path)
    results.add(job(0.05), outcome(1), ORIGIN)
    with pytest.raises(
        OutputError,
        match=(
            "paper.csv was written by another version of unc_physics; choose another folder with --output"
        ),
    ):
        results.missing([Job("paper", {"model": "bunny"})])


def test_one_evaluation_at_a_time(tmp_path):
    with (
        Results(tmp_path).locked(),
        pytest.raises(OutputError, match="is in use by another evaluation"),
        Results(tmp_path).locked(),
    ):
        pass
    with Results(tmp_path).locked():
        pass
