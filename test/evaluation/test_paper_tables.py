"""The paper's Table 3 and the tables behind its Figs. 6 and 7."""

import csv
from pathlib import Path

import pytest

from unc_physics_evaluation.experiments import collisions, storage
from unc_physics_evaluation.jobs import Job, Settings
from unc_physics_evaluation.results import Results


def filled(tmp_path, experiment, jobs):
    results = Results(tmp_path)
    for job in jobs:
        results.add(job, experiment.run(job), {"versions": "", "machine": ""})
    experiment.report(results)
    return results


def written(tmp_path, name):
    with open(tmp_path / "tables" / f"{name}.csv", newline="") as file:
        return list(csv.DictReader(file))


def test_carries_hold_as_many_numbers_as_the_paper_says(tmp_path):
    jobs = [job for job in storage.jobs(Settings()) if job.parameters["bodies"] <= 4]
    filled(tmp_path, storage, jobs)
    counts = {
        row["method"]: (int(row["2 bodies"]), int(row["4 bodies"])) for row in written(tmp_path, "storage")
    }
    for method in ("surrogate", "local sampling", "sigma points, full"):
        assert counts[method] == counts[f"{method}, in the paper"]
    # Positions alone are uncertain: 3 of the 12 columns of each body's root are there.
    assert counts["linearization"] == (2 * 13 + 24 * 6, 4 * 13 + 48 * 12)
    assert counts["MC-100"] == (100 * 2 * 13, 100 * 4 * 13)


@pytest.mark.parametrize(("truth", "rounds", "table"), [(100, 0, "collisions"), (0, 1, "collisions_time")])
def test_collisions_fill_their_tables(tmp_path, truth, rounds, table):
    sizes = {"model": "pin", "spheres": 10, "sigma": 0.05, "truth": truth, "rounds": rounds, "base_seed": 0}
    filled(tmp_path, collisions, [Job("collisions", sizes)])
    rows = {row["method"]: row for row in written(tmp_path, table)}
    if rounds:
        assert float(rows["MC-10"]["times faster than MC-10"]) == 1.0
        assert float(rows["MC-100"]["CPU time [ms]"]) > float(rows["MC-10"]["CPU time [ms]"])
    else:
        errors = {method: float(row["W1 position [m]"]) for method, row in rows.items()}
        assert errors["floor"] < errors["MC-5"]
        assert errors["floor"] <= errors["best Gaussian"] * 1.5


def test_each_table_of_the_docs_is_written_by_an_experiment_or_a_release_script():
    root = Path(__file__).resolve().parents[2]
    sources = [
        path.read_text(encoding="utf-8")
        for folder in ("evaluation/unc_physics_evaluation", "release")
        for path in (root / folder).rglob("*.py")
    ]
    for path in (root / "docs" / "results").glob("*.csv"):
        named = f'"{path.stem}"', f'"{path.name}"', f"'{path.stem}'", f"/{path.name}"
        assert any(name in text for text in sources for name in named), path.name
