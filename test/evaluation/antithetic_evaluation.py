"""The evaluation of a propagator of another package: run where `antithetic` is installed."""

import csv
import sys
from pathlib import Path

from unc_physics_evaluation.experiments import paper
from unc_physics_evaluation.jobs import Job
from unc_physics_evaluation.methods import color, label, method_of
from unc_physics_evaluation.results import Results

if __name__ == "__main__":
    assert (label("antithetic"), color("antithetic")) == ("antithetic", "#A6761D")
    assert method_of("antithetic pairs=20", Job("paper", {})).pairs == 20
    results = Results(Path(sys.argv[1]))
    small = {"case": "pin", "spheres": 10, "sigma": 0.05, "repeat": 0, "truth": 20, "rounds": 1}
    for method in ("", "antithetic pairs=20"):
        for section in ("error", "time", "storage"):
            job = Job("paper", {"section": section, **small, "added": method})
            results.add(job, paper.run(job), {"versions": "", "machine": ""})
    print(paper.report(results))
    for name in ("figure_6", "figure_7"):
        with open(results.folder / f"{name}.csv", newline="") as file:
            (row,) = (row for row in csv.DictReader(file) if row["method"] == "antithetic")
        assert row["options"] == "pairs=20"
