"""Times of the propagators: each has figures of its own, whatever number of samples it takes."""

from unc_physics_evaluation.experiments import propagators as experiment
from unc_physics_evaluation.jobs import Job
from unc_physics_evaluation.methods import RUNS, label
from unc_physics_evaluation.results import Results


def test_each_number_of_samples_has_its_own_figures(tmp_path):
    results, rounds = Results(tmp_path), 2
    job = Job("propagators", {"model": "pin", "spheres": 10, "rounds": rounds, "base_seed": 0})
    results.add(job, experiment.run(job), {"versions": "", "machine": ""})
    rows = results.rows("propagators")
    for method, samples in rows.curves():
        assert len(rows.where(method=method, samples=samples)) == 2 * rounds
    report = experiment.report(results)
    for samples in RUNS["cloud"]:
        assert report.count(f"| {label('cloud', samples)} |") == 1
