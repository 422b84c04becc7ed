"""Laws of the corrections, beside a Kalman filter written out in NumPy."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tracked_scenes import NOISE, angle, bodies, box, pose

from unc_physics import PoseMeasurement, PositionMeasurement, RelativePoseMeasurement
from unc_physics.spatial.moments import mean_and_errors, spread_states, symmetric_root
from unc_physics.tracking.ensemble import BodyObservation, Gates, corrected
from unc_physics.tracking.hypotheses import Filter
from unc_physics.tracking.noise import whitened

BODY = bodies(1)[0]


def random_covariance(size, rng, scale):
    A = rng.standard_normal((size, size + 4))
    return scale[:, None] * (A @ A.T / (size + 4)) * scale


def ensemble(covariance, count, rng, mean=None, moving=(0,)):
    """Members whose mean and covariance are exactly those given."""
    mean = np.tile(np.r_[np.zeros(9), 1.0, np.zeros(3)], (len(moving), 1)) if mean is None else mean
    z = whitened(rng.standard_normal((count, len(covariance))))
    errors = z @ np.linalg.cholesky(covariance).T
    return spread_states(mean, np.array(moving, np.int64), errors)


def moments(states, moving=(0,)):
    mean, errors = mean_and_errors(states, np.array(moving, np.int64))
    return mean, errors.T @ errors / (len(errors) - 1)


SCALE = np.r_[np.full(3, 0.005), np.full(3, 0.1), np.full(3, 0.02), np.full(3, 0.5)]


@pytest.mark.parametrize("groups", [(0, 0), (0, 1)])
def test_equals_the_linear_kalman_filter(groups):
    """Of two bodies and two parameters, about which two measurements tell; one between them is prescribed.

    A measurement corrects the parameters, and the other body only if both are of one group.
    """
    rng = np.random.default_rng(1)
    scale = np.r_[SCALE, 2.0 * SCALE]
    P = random_covariance(26, rng, np.r_[scale, 0.7, 2.0])
    curved = np.r_[6:12, 18:24]  # without rotations nothing is curved
    P[curved], P[:, curved] = 0.0, 0.0
    mean = np.zeros((3, 13))
    mean[:, 9], mean[2, 0], offset = 1.0, 0.2, np.array([0.3, -1.2])
    moving = np.array([0, 2])
    errors = whitened(rng.standard_normal((64, 26))) @ symmetric_root(P).T
    states = spread_states(mean, moving, np.ascontiguousarray(errors[:, :24]))
    states[:, 1, 0] = rng.standard_normal(64)  # its path is uncertain
    R = random_covariance(3, rng, np.array([2e-3, 3e-3, 1e-3]))
    measured = [(2, np.array([0.207, -0.003, 0.002])), (2, np.array([0.204, 0.001, -0.004]))]
    result = corrected(
        states,
        moving,
        [BodyObservation(b, PositionMeasurement(z, R).observation(BODY), b) for b, z in measured],
        np.array(groups),
        parameters=errors[:, 24:] + offset,
    )
    some = np.r_[:26] if groups == (0, 0) else np.r_[12:26]
    x, own = np.r_[np.zeros(12), 0.2, np.zeros(11), offset][some], P[np.ix_(some, some)]
    H = np.zeros((3, len(some)))
    H[:, np.searchsorted(some, np.r_[12:15])] = np.eye(3)
    for (_, z), innovation in zip(measured, result.innovations, strict=True):
        S, y = H @ own @ H.T + R, z - H @ x
        K = own @ H.T @ np.linalg.inv(S)
        x, own = x + K @ y, own - K @ H @ own
        assert innovation.square == pytest.approx(y @ np.linalg.solve(S, y), rel=1e-6)
        density = -0.5 * (y @ np.linalg.solve(S, y) + np.linalg.slogdet(2.0 * np.pi * S)[1])
        assert innovation.density == pytest.approx(density, rel=1e-6)
    after = np.hstack([result.states[:, 0, :6], result.states[:, 2, :6], result.parameters])
    places = np.r_[:6, 12:18, 24:26]
    known = np.isin(places, some)
    places = np.searchsorted(some, places[known])
    assert after.mean(axis=0)[known] == pytest.approx(x[places], abs=1e-7)
    assert np.cov(after[:, known].T) == pytest.approx(own[np.ix_(places, places)], abs=1e-7)
    np.testing.assert_array_equal(result.states[:, 1], states[:, 1])
    assert np.array_equal(result.states[:, 0], states[:, 0]) == (groups == (0, 1))


def test_gaussian_and_ensemble_agree_about_poses():
    rng = np.random.default_rng(2)
    P = random_covariance(12, rng, SCALE)
    start = np.zeros((1, 13))
    start[0, 6:10] = Rotation.from_rotvec([0.3, -0.8, 0.5]).as_quat()
    states = ensemble(P, 400, rng, start)
    turned = Rotation.from_quat(start[0, 6:10]) * Rotation.from_rotvec([0.01, -0.02, 0.015])
    seen = PoseMeasurement(pose([0.003, 0.001, -0.002], turned.as_quat()), NOISE).observation(BODY)
    by_members = corrected(states, np.array([0]), [BodyObservation(0, seen, 0)], np.zeros(1))
    exact, innovation = Filter(start[0], P, 0.0).corrected(seen, start[0], np.inf)
    mean, covariance = moments(by_members.states)
    assert mean[0, :6] == pytest.approx(exact.mean[:6], abs=2e-4)
    assert angle(mean[0, 6:10], exact.mean[6:10]) < 2e-4
    deviations = np.sqrt(np.diag(exact.covariance))
    assert covariance / deviations[:, None] / deviations == pytest.approx(
        exact.covariance / deviations[:, None] / deviations, abs=0.02
    )
    assert by_members.innovations[0].square == pytest.approx(innovation.square, rel=0.02)


def test_a_relative_pose_ties_two_bodies():
    rng = np.random.default_rng(7)
    P = np.diag(np.r_[SCALE, SCALE] ** 2)
    mean = np.zeros((2, 13))
    mean[0, 6:10] = Rotation.from_rotvec([0.0, 0.0, np.pi / 2]).as_quat()
    mean[1, 9], mean[1, 1] = 1.0, 0.2  # along x of the first
    states = ensemble(P, 400, rng, mean, (0, 1))
    turn = Rotation.from_rotvec([0.0, 0.0, -np.pi / 2]).as_quat()
    seen = RelativePoseMeasurement("box0", pose([0.206, 0.0, 0.0], turn), NOISE).observation(BODY)
    result = corrected(states, np.array([0, 1]), [BodyObservation(1, seen, 0)], np.array([0, 1]))
    after, covariance = moments(result.states, (0, 1))
    # 6 mm farther apart than expected
    share = SCALE[0] ** 2 / (2.0 * SCALE[0] ** 2 + NOISE[0] ** 2)
    assert after[1, 1] - 0.2 == pytest.approx(share * 0.006, rel=0.1)
    assert after[0, 1] == pytest.approx(-share * 0.006, rel=0.1)
    between = covariance[1, 1] + covariance[13, 13] - 2.0 * covariance[1, 13]
    assert between == pytest.approx(1.0 / (1.0 / NOISE[0] ** 2 + 0.5 / SCALE[0] ** 2), rel=0.1)


def test_gates():
    rng = np.random.default_rng(8)
    P = np.diag(SCALE**2)
    states = ensemble(P, 64, rng)
    s = np.sqrt(SCALE[0] ** 2 + NOISE[0] ** 2)
    for deviations, accepted, share in ((3.0, True, 1.0), (6.0, True, 20.0 / 36.0), (11.0, False, 0.0)):
        seen = PoseMeasurement(pose([deviations * s, 0.0, 0.0]), NOISE).observation(BODY)
        result = corrected(states, np.array([0]), [BodyObservation(0, seen, 0)], np.zeros(1), gates=Gates())
        assert result.innovations[0].accepted is accepted
        assert result.innovations[0].square == pytest.approx(deviations**2, rel=1e-3)
        R = NOISE[0] ** 2 / (share or 1.0)
        moved = deviations * s * SCALE[0] ** 2 / (SCALE[0] ** 2 + R) if accepted else 0.0
        assert result.states[:, 0, 0].mean() == pytest.approx(moved, abs=1e-6)


def test_the_model_origin_is_where_the_pose_is_measured():
    model = replace(box(), origin=np.array([0.0, 0.0, -0.04]))
    body = replace(BODY, model=model)
    turn = Rotation.from_rotvec([0.5 * np.pi, 0.0, 0.0])
    seen = PoseMeasurement(pose([1.0, 2.0, 3.0], turn.as_quat()), NOISE, origin="model").observation(body)
    assert seen.value[:3] == pytest.approx([1.0, 2.0, 3.0] - turn.apply([0.0, 0.0, -0.04]))
    assert seen.noise[2, 2] == pytest.approx(NOISE[0] ** 2 + (0.04 * NOISE[3]) ** 2, rel=1e-6)
