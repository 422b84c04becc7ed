"""Heaps: the scene, and the report."""

import numpy as np

from unc_physics.prediction.overlap_depths import overlaps
from unc_physics.spatial.layout import POSITION
from unc_physics_evaluation.experiments import heaps
from unc_physics_evaluation.jobs import Outcome, Row, Settings
from unc_physics_evaluation.methods import OURS
from unc_physics_evaluation.results import Results
from unc_physics_evaluation.scenarios import cubes_into_bin


def test_cubes_start_apart_and_above_the_bin():
    scene, mean, _ = cubes_into_bin(20, 30)
    assert overlaps(scene, mean[None])[0].max() == 0.0
    wall = max(abs(element.position[0]) for element in scene.environment)
    assert np.abs(mean[:, POSITION.start]).max() < wall - 0.05


def test_a_rollout_reports_time_convergence_and_rest():
    scene, mean, _ = cubes_into_bin(2, 30)
    found = {quantity: value for quantity, _, value in heaps._advance(scene, mean, 2.0)}
    assert found[heaps.TIME] > 0.0
    assert found[heaps.UNCONVERGED] == 0.0
    assert found[heaps.CREEP] < 1e-5
    assert found[heaps.DEPTH] < 1e-3


def test_the_report_compares_growth_with_its_goal(tmp_path):
    results = Results(tmp_path)
    for job in heaps.jobs(Settings()):
        bodies = job.parameters["bodies"]
        rows = [
            Row(OURS, heaps.TIME, "s", 1e-4 * bodies**2),
            Row(heaps.ENGINE, heaps.TIME, "s", 0.01 * bodies),
        ]
        values = {heaps.UNCONVERGED: 0.0, heaps.RESIDUAL: 1e-3, heaps.CREEP: 1e-6, heaps.DEPTH: 1e-4}
        rows += [Row(OURS, quantity, "", value) for quantity, value in values.items()]
        results.add(job, Outcome(rows), {"versions": "", "machine": ""})
    text = heaps.report(results)
    assert "| unc_physics | 1.00 | 4.00 | 9.00 | 9.00 |" in text
    assert "| PyBullet | 1.00 | 2.00 | 3.00 | 3.00 |" in text
    assert "| 100 cubes, 2000 spheres | 0 | 1e-03 | 1.00 | 100 |" in text
    assert heaps.verdict(results).startswith("0 of 1 goals met")
