"""Releases and pushes: regions of the node, and where objects end."""

import numpy as np
import pytest

from unc_physics_evaluation.experiments import releases as experiment


@pytest.mark.parametrize("model", experiment.MODELS)
def test_an_upright_object_slides_as_coulomb_says(model):
    """Both simulators, with their own draws of friction: the way is v^2 / (2 mu g)."""
    scene, state = experiment.true_start(experiment.PUSH, model, np.random.default_rng(3))
    speed = float(np.hypot(*state[0, 3:5]))
    assert scene.friction is not None
    usual = speed**2 / (2.0 * scene.friction * 9.81)
    start = experiment._origin(scene.bodies[0], state[0])
    for end in (experiment.own_end, experiment.mujoco_end):
        ways = [float(np.linalg.norm(end(scene, state, seed)[:2] - start[:2])) for seed in range(1, 8)]
        assert 0.5 * usual < np.median(ways) < 2.0 * usual
        assert max(ways) > 1.2 * min(ways)


def test_a_region_holds_what_lies_within_it():
    pytest.importorskip("unc_physics_msgs", reason="needs the interface package unc_physics_msgs")
    from geometry_msgs.msg import Pose

    from unc_physics_msgs.msg import PredictedState

    rng, std = np.random.default_rng(2), np.array([0.01, 0.02, 0.03])
    state = PredictedState()
    state.pose.covariance = np.diag([*std**2, 0.0, 0.0, 0.0]).ravel()
    for x, y, z in (std * rng.standard_normal((1000, 3))).tolist():
        pose = Pose()
        pose.position.x, pose.position.y, pose.position.z = x, y, z
        state.pose_samples.append(pose)
    points = std * rng.standard_normal((1000, 3))
    for region in (experiment.ELLIPSOID, experiment.SAMPLES):
        share = np.mean([experiment.held(state, point)[region] for point in points])
        assert share == pytest.approx(0.9, abs=0.04)
