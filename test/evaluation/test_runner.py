"""A sweep gives the same results whoever does the work, in whatever order, and goes on where it stopped."""

import pytest

from unc_physics_evaluation.jobs import Job, Settings
from unc_physics_evaluation.results import Results
from unc_physics_evaluation.runner import run_job, run_jobs

TIMES = ("cpu_time", "cpu_time_over_mc10", "wall_time", "rollout_time", "rollout_time_over_ours")
SHARED = Settings().parameters()


def tiny_jobs():
    """Every kind of job, small."""
    free = {
        "uncertain": "linear_velocity",
        "model": "pin",
        "spheres": 10,
        "sigma": 0.1,
        "truth": 100,
        "repeat": 0,
    }
    case = {"model": "bunny", "spheres": 10, "sigma": 0.05}
    collision = {**case, "truth": 100, "subset": 50, "rounds": 1}
    speed = {"measured": "time", **case, "truth": 10, "encounter": 0, "encounters": 2}
    return [
        Job("collision_free", {**free, **SHARED}),
        Job("collisions", {**collision, **SHARED}, cost=3.0),
        Job("collisions", {**collision, "sigma": 0.1, **SHARED}, cost=2.0),
        Job("speed_against_error", {**speed, **SHARED}, alone=True),
        Job("storage", {"bodies": 4, **SHARED}),
    ]


def figures(results):
    """All that does not depend on the clock, by job and place in it."""
    return {
        (name, row["job"], row["part"]): (
            row["method"],
            row["quantity"],
            row["samples"],
            row["replicate"],
            row["seed"],
            row["value"],
        )
        for name in ("collision_free", "collisions", "speed_against_error", "storage")
        for row in results.rows(name)
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
    results = Results(tmp_path_factory.mktemp("pool"))
    assert run_jobs(tiny_jobs(), results, workers=2) == {}
    return results


def test_a_pool_gives_the_same(in_this_process, in_a_pool):
    expected = figures(in_this_process)
    assert len(expected) > 150
    assert figures(in_a_pool) == expected


def test_dask_gives_the_same(in_this_process, tmp_path):
    distributed = pytest.importorskip("distributed")
    results = Results(tmp_path)
    with distributed.LocalCluster(
        n_workers=1,
        threads_per_worker=2,
        processes=False,
        dashboard_address=None,
        protocol="tcp://",
        host="127.0.0.1",
    ) as cluster:
        assert run_jobs(tiny_jobs(), results, scheduler=cluster.scheduler_address) == {}
    assert figures(results) == figures(in_this_process)


def test_finished_jobs_are_not_run_again(in_a_pool, tmp_path):
    folder, jobs = tmp_path / "copy", tiny_jobs()
    folder.mkdir()
    for file in in_a_pool.folder.glob("*.csv"):
        (folder / file.name).write_bytes(file.read_bytes())
    path = folder / "collisions.csv"
    whole = path.read_bytes()
    path.write_bytes(whole[:-100])  # the last job is torn
    results = Results(folder)
    (torn,) = results.missing(jobs)
    assert run_jobs(jobs, results, workers=1) == {}
    assert figures(results) == figures(in_a_pool)
    kept = [line for line in whole.splitlines() if torn.key.encode() not in line]
    assert path.read_bytes().splitlines()[: len(kept)] == kept


def test_a_job_that_fails_is_reported_and_stops_no_other(tmp_path):
    good, bad = tiny_jobs()[-1], Job("storage", {"bodies": 0, **SHARED})
    results = Results(tmp_path)
    failures = run_jobs([bad, good], results, workers=1)
    assert list(failures) == [f"storage {bad.key}"]
    assert "must name at least one body" in failures[f"storage {bad.key}"]
    assert results.missing([bad, good]) == [bad]


def test_rows_name_versions_and_machine(in_a_pool):
    row = in_a_pool.rows("storage")[0]
    assert row["versions"].startswith("unc_physics ") and "numba " in row["versions"]
    assert "threads" in row["machine"]
