"""The particle filter that a tracker is compared with: laws of its correction."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from unc_physics import Belief, PoseMeasurement
from unc_physics.spatial.moments import boxplus
from unc_physics.tracking.observation import constant_velocity, expectation, kalman_update
from unc_physics_evaluation.recorded_tosses import recorded_tosses
from unc_physics_evaluation.tracked_tosses import NOISE, SHAPE, tracked_scene

pytest.importorskip("mujoco")
STEPS = 10


def thrown_cube():
    """A cube that flies without gravity, far above the table, and a belief about it."""
    scene = replace(tracked_scene(recorded_tosses()), gravity=(0.0, 0.0, 0.0))
    mean = np.zeros(13)
    mean[:6], mean[6:10] = [0.0, 0.0, 1.0, 0.3, -0.2, 0.4], [0.0, 0.0, 0.0, 1.0]
    return scene, mean, np.diag(np.repeat([3e-3, 0.1, 0.02, 0.5], 3) ** 2)


def test_free_flight_equals_the_filter_with_constant_velocity():
    from unc_physics_evaluation.particle_filter import ParticleFilter

    scene, mean, P = thrown_cube()
    belief, rng = Belief(mean[None], P[None]), np.random.default_rng(5)
    filters = [ParticleFilter(scene, belief, 0.0, 1000, seed) for seed in range(10)]
    h, start, noise = STEPS * scene.dt, mean.copy(), np.diag(NOISE**2 + np.repeat(SHAPE, 3) ** 2)
    for k in range(1, 6):
        turned = Rotation.from_rotvec(NOISE[3:] * rng.standard_normal(3)).as_quat()
        pose = np.r_[start[:3] + start[3:6] * k * h + NOISE[:3] * rng.standard_normal(3), turned]
        measurement = PoseMeasurement(pose, NOISE)
        for one in filters:
            one.correct(k * h, measurement)
        mean, P = constant_velocity(mean, P, h, 0.0, 0.0)
        seen = measurement.observation(scene.bodies[0])
        y, H = expectation(mean, mean, seen.kind, seen.value, seen.point, 6)
        change, P, _, _ = kalman_update(P, H, y, noise)
        moved = np.empty(13)
        boxplus(mean, change, moved)
        mean = moved
    std, back, errors, variances = np.sqrt(P.diagonal()), Rotation.from_quat(mean[6:10]).inv(), [], []
    for one in filters:
        found = one.belief(5 * h)
        turn = (back * Rotation.from_quat(found.mean[0, 6:10])).as_rotvec()
        errors.append(np.r_[found.mean[0, :6] - mean[:6], turn, found.mean[0, 10:] - mean[10:]] / std)
        variances.append(found.marginal(0).diagonal() - np.repeat([SHAPE[0], 0.0, SHAPE[1], 0.0], 3) ** 2)
    error = np.std(errors, axis=0, ddof=1) / np.sqrt(len(filters))
    assert (error < 0.15).all()
    assert (np.abs(np.mean(errors, axis=0)) < 4.5 * error).all()
    assert np.sqrt(np.mean(variances, axis=0)) == pytest.approx(std, rel=0.1)
