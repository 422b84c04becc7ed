"""An error of the pose that all moving bodies share, against bodies that are moved and turned together."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from unc_physics import Belief
from unc_physics.checks.errors import InvalidCovarianceError, InvalidRequestError
from unc_physics.spatial.layout import ANGULAR_VELOCITY, POSITION, QUATERNION, VELOCITY

STD = np.array([0.01, 0.02, 0.005, 0.03, 0.01, 0.02])
ORIGIN = np.array([0.3, -0.2, 1.5])
SMALL = 1e-6  # a move so small that the first order is all that shows


@pytest.fixture(scope="module")
def belief():
    """Three bodies, the second of which is fixed, with covariances of their own."""
    rng = np.random.default_rng(4)
    mean = rng.normal(size=(3, 13))
    mean[:, QUATERNION] = Rotation.random(3, random_state=5).as_quat()
    factors = 0.01 * rng.normal(size=(2, 12, 12))
    return Belief(mean, factors @ factors.transpose(0, 2, 1), [0, 2])


def moved(mean, shift, turn):
    """The states (B, 13) after a shift and a turn about `ORIGIN`, all bodies together."""
    rotation, result = Rotation.from_rotvec(turn), mean.copy()
    result[:, POSITION] = ORIGIN + rotation.apply(mean[:, POSITION] - ORIGIN) + shift
    for block in (VELOCITY, ANGULAR_VELOCITY):
        result[:, block] = rotation.apply(mean[:, block])
    result[:, QUATERNION] = (rotation * Rotation.from_quat(mean[:, QUATERNION])).as_quat()
    return result


def errors(mean, states):
    """The error state (12 B,) of states about a mean."""
    before, after = (Rotation.from_quat(x[:, QUATERNION]) for x in (mean, states))
    turns, change = (before.inv() * after).as_rotvec(), states - mean
    return np.hstack([change[:, POSITION], change[:, VELOCITY], turns, change[:, ANGULAR_VELOCITY]]).ravel()


@pytest.mark.parametrize(
    "axes", [np.eye(3), Rotation.from_rotvec([0.4, -1.0, 0.3]).as_matrix()], ids=["world", "camera"]
)
def test_it_is_as_if_all_bodies_were_moved_together(belief, axes):
    shared = belief.with_common_pose_std(STD, ORIGIN, axes)
    mean, directions = belief.mean[belief.moving].copy(), np.zeros((24, 6))
    for k, std in enumerate(STD):
        shift, turn = SMALL * np.array([axes[:, k % 3] if k // 3 == part else np.zeros(3) for part in (0, 1)])
        directions[:, k] = std * errors(mean, moved(mean, shift, turn)) / SMALL
    added = shared.covariance - belief.joint
    np.testing.assert_allclose(added, directions @ directions.T, rtol=1e-4, atol=1e-9)
    np.testing.assert_array_equal(shared.covariance, shared.covariance.T)
    np.testing.assert_array_equal(shared.mean, belief.mean)
    np.testing.assert_array_equal(shared.moving, belief.moving)


def test_bodies_keep_their_distance(belief):
    exact = Belief.exact(belief.mean, belief.moving).with_common_pose_std(STD * 1e-3, ORIGIN)
    assert exact.root().shape == (24, 6)
    states = exact.sample(50, np.random.default_rng(1))
    apart, mean_apart = (
        np.linalg.norm(x[:, 0, POSITION] - x[:, 2, POSITION], axis=1) for x in (states, belief.mean[None])
    )
    np.testing.assert_allclose(apart, np.tile(mean_apart, 50), rtol=1e-6)
    assert states[:, 0, POSITION].std(axis=0).min() > 1e-6
    np.testing.assert_array_equal(states[:, 1], np.tile(belief.mean[1], (50, 1)))


def test_no_error_changes_nothing(belief):
    assert belief.with_common_pose_std(np.zeros(6)) is belief


@pytest.mark.parametrize(
    "std, origin, error, words",
    [
        ([0.1] * 5, ORIGIN, InvalidCovarianceError, "common_pose_std must be six numbers"),
        ("far", ORIGIN, InvalidCovarianceError, "common_pose_std.*far"),
        (STD, [0.0, 0.0], InvalidRequestError, "common_pose_origin.*shape"),
    ],
)
def test_what_makes_no_error_is_refused(belief, std, origin, error, words):
    """What the numbers may be is in test/cli/test_bad_input.py."""
    with pytest.raises(error, match=words):
        belief.with_common_pose_std(std, origin)
