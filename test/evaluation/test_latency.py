"""Latency of the node: figures beside their goals, from a stream and from calls of a node."""

import pytest

from unc_physics_evaluation.experiments import latency as experiment
from unc_physics_evaluation.jobs import Job
from unc_physics_evaluation.served_scenes import BIN, TABLE


@pytest.mark.long
def test_a_node_is_measured():
    pytest.importorskip("rclpy", reason="needs ROS 2 (rclpy)")
    stream = Job("latency", {"by": experiment.STREAM, "scene": TABLE, "objects": 1, "amount": 1.0})
    rows = {row.quantity: row.value for row in experiment.run(stream).rows}
    assert 0.0 < rows["latency p50"] <= rows["latency p95"] < 5e3 and 0.0 < rows["rate"] <= 10.0
    assert 1.0 < rows[experiment.CPU] < 1e3


def test_scenes_have_their_objects():
    pytest.importorskip("unc_physics_msgs", reason="needs the interface package unc_physics_msgs")
    import numpy as np

    from unc_physics_evaluation.served_scenes import scene_message

    scene = scene_message(BIN, 10, np.random.default_rng(1), at_rest=True)
    assert len(scene.objects) == 10 and len(scene.environment.elements) == 5
    assert all(own.at_rest and own.belief.twist_covariance[0] == -1.0 for own in scene.objects)
    positions = np.array([(own.pose.position.x, own.pose.position.y) for own in scene.objects])
    apart = np.linalg.norm(positions[:, None] - positions, axis=2) + np.eye(10)
    assert apart.min() > 0.08  # m: they do not overlap
