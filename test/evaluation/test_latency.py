"""Latency of the node, from its stream."""

import pytest

from unc_physics_evaluation.experiments import latency as experiment
from unc_physics_evaluation.jobs import Job
from unc_physics_evaluation.served_scenes import TABLE


@pytest.mark.long
def test_a_node_is_measured():
    pytest.importorskip("rclpy", reason="needs ROS 2 (rclpy)")
    stream = Job("latency", {"by": experiment.STREAM, "scene": TABLE, "objects": 1, "amount": 1.0})
    rows = {row.quantity: row.value for row in experiment.run(stream).rows}
    assert 0.0 < rows["latency p50"] <= rows["latency p95"] < 5e3 and 0.0 < rows["rate"] <= 10.0
    assert 1.0 < rows[experiment.CPU] < 1e3
