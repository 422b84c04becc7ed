"""Objects in other frames: transformed as their poses are, one by one."""

import sys
import types

import numpy as np
import pytest
from geometry_msgs.msg import TransformStamped
from scenes import moving_object, orientation_of, position_of
from scipy.spatial.transform import Rotation
from std_msgs.msg import Header

from unc_physics.errors import UnknownFrameError
from unc_physics.ros.frames import Frames

TURN = Rotation.from_rotvec([0.3, 1.2, -0.4])
SHIFT = np.array([0.5, -2.0, 1.0])
DRAWS = 40_000
SIGMAS = 5.5  # statistics
SMALL = 1e-3


class Tf2:
    """What the node uses of tf2_ros, which is not on PyPI: a buffer that knows one transform."""

    class Buffer:
        def lookup_transform(self, target, source, time):
            if (target, source) != ("world", "camera"):
                raise LookupError(f'"{source}" passed to lookupTransform does not exist')
            found = TransformStamped()
            t, q = found.transform.translation, found.transform.rotation
            t.x, t.y, t.z = SHIFT
            q.x, q.y, q.z, q.w = TURN.as_quat()
            return found

    @staticmethod
    def TransformListener(buffer, node):
        return buffer


@pytest.fixture
def frames(monkeypatch):
    module = types.ModuleType("tf2_ros")
    module.Buffer, module.TransformListener = Tf2.Buffer, Tf2.TransformListener
    module.__spec__ = types.SimpleNamespace()
    monkeypatch.setitem(sys.modules, "tf2_ros", module)
    return Frames(None, "world")


def test_poses_velocities_and_covariances_against_drawn_poses(frames):
    message = moving_object(position=(0.1, 0.2, 0.3), velocity=(1.0, 2.0, 3.0))
    rotation = Rotation.from_rotvec([1.0, 0.2, 0.1])
    q = message.pose.pose.orientation
    q.x, q.y, q.z, q.w = rotation.as_quat()
    factor = np.random.default_rng(1).normal(size=(6, 6))
    covariance = SMALL**2 * factor @ factor.T / 6.0
    message.pose.covariance = covariance.ravel()
    message.twist.covariance[0] = -1.0
    (seen,) = frames.in_world(Header(frame_id="camera"), [message])
    assert position_of(message.pose.pose).tolist() == [0.1, 0.2, 0.3]
    assert np.allclose(position_of(seen.pose.pose), TURN.apply([0.1, 0.2, 0.3]) + SHIFT)
    mean = Rotation.from_quat(orientation_of(seen.pose.pose))
    assert (mean.inv() * TURN * rotation).magnitude() < 1e-12
    v = seen.twist.twist.linear
    assert np.allclose([v.x, v.y, v.z], TURN.apply([1.0, 2.0, 3.0]))
    assert seen.twist.covariance[0] == -1.0
    drawn = np.random.default_rng(2).multivariate_normal(np.zeros(6), covariance, DRAWS)
    errors = np.empty((DRAWS, 6))
    errors[:, :3] = TURN.apply([0.1, 0.2, 0.3] + drawn[:, :3]) + SHIFT - position_of(seen.pose.pose)
    errors[:, 3:] = (TURN * Rotation.from_rotvec(drawn[:, 3:]) * rotation * mean.inv()).as_rotvec()
    expected = np.reshape(seen.pose.covariance, (6, 6))
    variance = np.diag(expected)
    standard_error = np.sqrt((np.outer(variance, variance) + expected**2) / DRAWS)
    assert np.all(np.abs(errors.T @ errors / DRAWS - expected) < SIGMAS * standard_error)


def test_the_world_frame_and_no_frame_are_the_same(frames):
    objects = [moving_object()]
    assert frames.in_world(Header(), objects) is objects
    assert frames.in_world(Header(frame_id="world"), objects) is objects


def test_a_frame_without_transform(frames):
    with pytest.raises(UnknownFrameError, match="nowhere"):
        frames.in_world(Header(frame_id="nowhere"), [moving_object()])
