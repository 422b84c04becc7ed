"""Clutter: its scenes, what a node is asked about them, and the report."""

import os

import numpy as np
import pytest

from unc_physics import Belief, make_propagator, predict
from unc_physics.physics.layout import POSITION, QUATERNION
from unc_physics_evaluation.comparison import mean_errors
from unc_physics_evaluation.experiments import clutter
from unc_physics_evaluation.jobs import Outcome, Row, Settings
from unc_physics_evaluation.results import Results
from unc_physics_evaluation.scenarios import dropped_cans, lying_in_bin, spread


def test_what_lies_in_the_bin_stays_there():
    scene, belief, horizon = lying_in_bin()
    positions = belief.mean[:, POSITION]
    assert (np.abs(positions[:, :2]) < 0.19).all() and (positions[:, 2] < 0.38).all(), "as high as wide"
    alone = predict(scene, Belief.exact(belief.mean), make_propagator("monte_carlo", samples=1), horizon)
    assert np.abs(alone.belief.mean[:, POSITION] - positions).max() < 2e-3
    np.testing.assert_allclose(belief.blocks[:, range(3), range(3)], 9e-6)


def test_errors_of_means_are_over_the_standard_deviation():
    _, given, _ = dropped_cans(2, 20)
    mean = given.mean.copy()
    mean[0, POSITION] += 0.3, 0.0, 0.4
    mean[1, QUATERNION] = np.sin(0.1), 0.0, 0.0, np.cos(0.1)
    truth = Belief(given.mean, spread(2, position=0.1))
    expected = [[5.0 / np.sqrt(3.0), 0.0], [0.0, 0.0]]
    np.testing.assert_allclose(mean_errors(Belief(mean, truth.covariance), truth), expected)
    truth = Belief(given.mean, spread(2, rotation=0.1))
    expected = [[0.0, 0.0], [0.0, 2.0 / np.sqrt(3.0)]]
    np.testing.assert_allclose(mean_errors(Belief(mean, truth.covariance), truth), expected)


def test_a_node_answers_as_the_library_and_says_how_sure_it_is(monkeypatch):
    pytest.importorskip("rclpy", reason="needs ROS 2 (rclpy)")
    from unc_physics_evaluation import node_clutter

    monkeypatch.setenv("ROS_DOMAIN_ID", str(210 + os.getpid() % 20))  # in which no other test's node is
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    monkeypatch.setattr(node_clutter, "WARM_UP", 0)
    scene, belief, _ = dropped_cans(2, 20)
    horizon = 0.2  # soon after the first impact, so that round-off has not grown
    asked = {
        "monte_carlo": make_propagator("monte_carlo", samples=10),
        "auto": make_propagator("auto", time=1e-3, error=0.0),
    }
    found = node_clutter.ask((scene, belief, horizon), asked, 2)
    for name, options in (("monte_carlo", {"samples": 10}), ("auto", {"runs": 12})):
        assert len(found[name]) == 2
        for k, answer in enumerate(found[name]):
            own = predict(scene, belief, make_propagator(name, seed=1 + k, **options), horizon)
            assert answer.rollouts == own.propagator.rollouts(own.carry)
            found_at, own_at = (x.belief.mean[:, POSITION] for x in (answer.prediction, own))
            # which of equal directions comes first, round-off decides, and draws follow
            np.testing.assert_allclose(found_at, own_at, atol=5e-3)
            assert 0.0 < answer.prediction.wall_time < answer.round_trip
    assert all(np.isnan(answer.mean_error) for answer in found["monte_carlo"])
    assert all(0.0 < answer.mean_error < 0.5 for answer in found["auto"])


def test_the_report_holds_what_was_asked_to_the_goals(tmp_path):
    results = Results(tmp_path)
    values = dict.fromkeys((clutter.TRIP, clutter.CORE, clutter.CPU, clutter.USED, clutter.ERROR), 0.06)
    values |= {clutter.CLAIMED: 0.1, "w1_position": 2e-3}
    made = [(quantity, "", value) for quantity, value in values.items()]
    for job in clutter.jobs(Settings(quick=True)):
        rows = [Row("floor", "w1_position", "m", 1e-3)]
        rows += [Row(method, *of) for method in ("monte_carlo", "auto") for of in made]
        if job.parameters["section"] == clutter.SECOND_THREAD:
            rows = [
                Row("monte_carlo", f"wall_time_{n}", "s", 1.8 / n, 100, k) for n in (1, 2) for k in (0, 1)
            ]
        results.add(job, Outcome(rows), {"versions": "", "machine": ""})
    text, verdict = clutter.report(results), clutter.verdict(results)
    if not clutter.missing(Settings()):
        assert "| lying in bin, auto | 60.0 | 60.0 | 60.0 | 60.0 | 0.0600 | 0.0600 | 0.100 | 2.00 |" in text
        assert "| median round trip | dropped cans, auto | 60.0 ms | **≤ 50, missed** |" in text
        assert "| two threads over one | MC-100 in the bin | 2.00 x | ≥ 1.7, met |" in text
        assert verdict.startswith("3 of 5 goals met")


def test_without_ros_the_threads_are_left(monkeypatch):
    monkeypatch.setattr("unc_physics_evaluation.experiments.latency.NEEDS", ("no_such_module",))
    assert clutter.missing(Settings())[0].startswith("clutter: no_such_module not found")
    assert all(job.parameters["section"] == clutter.SECOND_THREAD for job in clutter.jobs(Settings()))
