"""What the evaluation asks of a propagator of another package: run where `antithetic` is installed."""

import sys

from example_scenes import three_bodies

from unc_physics import predict
from unc_physics.scene.scene_file import scene_from_dict
from unc_physics_evaluation.comparison import error_rows, monte_carlo
from unc_physics_evaluation.experiments import collision_free
from unc_physics_evaluation.jobs import Job, Outcome
from unc_physics_evaluation.methods import color, label, methods
from unc_physics_evaluation.results import Results

if __name__ == "__main__":
    scene, belief, _ = scene_from_dict(three_bodies())
    job = Job("collision_free", {})
    truth, second = (monte_carlo(scene, belief, 0.5, 20, seed) for seed in (1, 2))
    prediction = predict(scene, belief, methods(job)["antithetic", None], 0.5)
    rows = error_rows(job, truth, second, {("antithetic", None): prediction.belief}, [5])
    assert any(row.method == "antithetic" and row.value > 0.0 for row in rows)
    assert (label("antithetic"), color("antithetic")) == ("antithetic", "#A6761D")
    results = Results(sys.argv[1])
    for uncertain, *_ in collision_free.COLUMNS:
        case = Job("collision_free", {"uncertain": uncertain, "truth": 20})
        results.add(case, Outcome(rows), {"versions": "", "machine": ""})
    print(collision_free.report(results))
