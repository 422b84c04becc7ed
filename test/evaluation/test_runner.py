"""A sweep gives the same results whoever does the work, in whatever order."""

import pytest

from unc_physics.checks.errors import UncPhysicsError
from unc_physics_evaluation import runner
from unc_physics_evaluation.jobs import Job, Settings
from unc_physics_evaluation.results import Results
from unc_physics_evaluation.runner import run_job, run_jobs

TIMES = ("cpu_time", "wall_time", "rollout_time", "rollout_time_over_ours")
SHARED = Settings().parameters()


def tiny_jobs():
    """Every kind of job, small."""
    free = {"section": "free", "case": "linear_velocity", "spheres": 10, "sigma": 0.1, "repeat": 0}
    free |= {"truth": 100, "rounds": 0, "added": ""}
    error = free | {"section": "error", "case": "bunny", "sigma": 0.05}
    speed = error | {"section": "time", "truth": 0, "rounds": 1}
    return [
        Job("paper", {**free, **SHARED}),
        Job("paper", {**error, **SHARED}, cost=3.0),
        Job("paper", {**speed, **SHARED}, alone=True),
        Job("paper", {**free, "case": "angular_velocity", **SHARED}),
    ]


def figures(results):
    """All that does not depend on the clock, by job and place in it."""
    return {
        (row["job"], row["part"]): (
            row["method"],
            row["quantity"],
            row["samples"],
            row["replicate"],
            row["seed"],
            row["value"],
        )
        for row in results.rows("paper")
        if row["quantity"] not in TIMES
    }


@pytest.fixture(scope="module")
def in_this_process(tmp_path_factory):
    results = Results(tmp_path_factory.mktemp("here"))
    for job in reversed(tiny_jobs()):
        results.add(job, *run_job(job))
    return results


@pytest.fixture(scope="module")
def in_a_pool(tmp_path_factory):
    """Results of two processes, and how the job failed that cannot be done."""
    results = Results(tmp_path_factory.mktemp("pool"))
    good = tiny_jobs()
    bad = Job("paper", {**good[0].parameters, "case": "mass"})
    failures = run_jobs([bad, *good], results, "processes:2")
    assert results.missing([bad, *good]) == [bad], "it stops no other"
    return results, bad, failures


def test_a_pool_gives_the_same(in_this_process, in_a_pool):
    expected = figures(in_this_process)
    assert len(expected) > 100
    assert figures(in_a_pool[0]) == expected


def test_a_job_that_fails_is_reported(in_a_pool):
    _, bad, failures = in_a_pool
    assert list(failures) == [f"paper {bad.key}"]
    assert "uncertain must be one of" in failures[f"paper {bad.key}"]


def test_a_log_file_gets_lines_of_progress(tmp_path, capsys, monkeypatch):
    """One at the start, one at each interval, and one at the end."""

    def lines(interval):
        monkeypatch.setattr(runner, "LOG_INTERVAL", interval)
        monkeypatch.setattr(runner, "_finished_jobs", lambda workers, jobs, tick: results_of(jobs, tick))
        run_jobs(tiny_jobs(), Results(tmp_path / str(interval)), None)
        return [line.strip() for line in capsys.readouterr().err.splitlines() if line.strip()]

    def results_of(jobs, tick):
        for job in jobs:
            tick()
            yield job, UncPhysicsError("left out")

    often, seldom = lines(0.0), lines(3600.0)
    assert len(seldom) == 2 and len(often) > 4
    assert all(line.startswith("evaluate: ") and " left" in line for line in (*often, *seldom))
    assert seldom[0].startswith("evaluate:   0%,") and seldom[1].startswith("evaluate: 100%,")


def test_rows_name_versions_and_machine(in_a_pool):
    row = in_a_pool[0].rows("paper")[0]
    assert row["versions"].startswith("unc_physics ") and "numba " in row["versions"]
    assert "threads" in row["machine"]
