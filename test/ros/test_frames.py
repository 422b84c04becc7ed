"""Scenes in other frames: transformed as poses and points are, one by one."""

import sys
import types

import numpy as np
import pytest
from geometry_msgs.msg import Point, TransformStamped
from rclpy.clock import Clock
from rclpy.parameter import Parameter
from scenes import good_request, moving_object, orientation_of, packed, position_of
from scipy.spatial.transform import Rotation
from shape_msgs.msg import Plane, SolidPrimitive
from std_msgs.msg import Header

from unc_physics.checks.errors import InvalidOrientationError, PredictionTimeoutError, UnknownFrameError
from unc_physics.ros.messages.environment import read_environment
from unc_physics.ros.messages.fields import pose_message
from unc_physics.ros.messages.frames import Frames
from unc_physics.ros.messages.request import as_sent, read_request
from unc_physics.ros.models import ModelLibrary, ShapePacker
from unc_physics.ros.parameters import Settings
from unc_physics_msgs.msg import BoxRegion, Environment, EnvironmentElement, JointCovariance

TURN = Rotation.from_rotvec([0.3, 1.2, -0.4])
SHIFT = np.array([0.5, -2.0, 1.0])


class Tf2:
    """What the node uses of tf2_ros, which is not on PyPI: a buffer that knows one transform."""

    class Buffer:
        def lookup_transform(self, target, source, time, timeout):
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


class FakeNode:
    """What frames need of a node: a clock, and whether it is simulated."""

    def get_clock(self):
        return Clock()

    def get_parameter(self, name):
        return Parameter(name, value=False)


@pytest.fixture
def frames(monkeypatch):
    module = types.ModuleType("tf2_ros")
    module.Buffer, module.TransformListener = Tf2.Buffer, Tf2.TransformListener
    module.__spec__ = types.SimpleNamespace()
    monkeypatch.setitem(sys.modules, "tf2_ros", module)
    return Frames(FakeNode(), "world")


def test_poses_velocities_and_covariances_are_turned(frames):
    """Also whole and joint ones; unknown ones, and those of a wrong size, stay as they are."""
    message, place = moving_object(velocity=(1.0, 2.0, 3.0)), [0.1, 0.2, 0.3]
    rotation = Rotation.from_rotvec([1.0, 0.2, 0.1])
    message.pose.pose = pose_message(place, rotation.as_quat())
    factor = np.random.default_rng(1).normal(size=(24, 24))
    C, A = factor @ factor.T, np.kron(np.eye(8), TURN.as_matrix())
    message.pose.covariance, message.covariance = C[:6, :6].ravel(), packed(C[:12, :12])
    message.twist.covariance[0] = -1.0
    joint = JointCovariance(object_ids=["left", "right"], data=packed(C))
    transform = frames.to_world(Header(frame_id="camera"))
    seen = transform.moved(message)
    assert position_of(message.pose).tolist() == place
    assert np.allclose(position_of(seen.pose), TURN.apply(place) + SHIFT)
    assert (Rotation.from_quat(orientation_of(seen.pose)).inv() * TURN * rotation).magnitude() < 1e-12
    v = seen.twist.twist.linear
    assert np.allclose([v.x, v.y, v.z], TURN.apply([1.0, 2.0, 3.0]))
    turned = A @ C @ A.T
    for found in (seen.pose.covariance, seen.covariance, transform.moved(joint).data):
        size = round(len(found) ** 0.5)
        np.testing.assert_allclose(np.reshape(found, (size, size)), turned[:size, :size], atol=1e-12)
    assert seen.twist.covariance[0] == -1.0
    message.covariance = packed(np.ones(7))  # which the reader refuses
    assert len(transform.moved(message).covariance) == 7


def test_a_plane_and_a_box_stay_where_they_are(frames):
    rng, place, turned = np.random.default_rng(3), [0.3, -0.2, 0.5], Rotation.from_rotvec([0.1, -0.7, 0.4])
    pose, coef = pose_message(place, turned.as_quat()), rng.normal(size=4)
    box = SolidPrimitive(type=SolidPrimitive.BOX, dimensions=[1.0, 2.0, 3.0])
    environment = Environment(
        elements=[
            EnvironmentElement(plane=Plane(coef=coef), pose=pose),
            EnvironmentElement(primitive=box, pose=pose),
        ]
    )
    transform = frames.to_world(Header(frame_id="camera"))
    seen, region = transform.moved(environment), transform.moved(BoxRegion(id="bin", pose=pose))
    points = rng.normal(size=(20, 3))
    (plane, _), (there, _) = (read_environment(each, ShapePacker())[0] for each in (environment, seen))
    heights = (turned.inv().apply(points - place) @ coef[:3] + coef[3]) / np.linalg.norm(coef[:3])
    assert np.allclose(plane.surface(points)[0], heights)
    assert np.allclose(there.surface(TURN.apply(points) + SHIFT)[0], heights)
    for moved in (seen.elements[1].pose, region.pose):
        assert np.allclose(position_of(moved), TURN.apply(place) + SHIFT)
        assert (Rotation.from_quat(orientation_of(moved)).inv() * TURN * turned).magnitude() < 1e-12
    assert position_of(environment.elements[1].pose).tolist() == place


def test_the_world_frame_and_no_frame_are_the_same(frames):
    assert frames.to_world(Header()) is None
    assert frames.to_world(Header(frame_id="world")) is None


def test_a_frame_without_transform(frames):
    with pytest.raises(
        UnknownFrameError, match="parameter world_frame.*transform_timeout.*nowhere.*the node's clock"
    ):
        frames.to_world(Header(frame_id="nowhere"))


def test_errors_quote_what_was_sent_in_its_own_frame(frames):
    request = good_request()
    request.scene.header.frame_id = "camera"
    request.scene.objects[1].pose.pose.orientation.x = 0.5
    request.scene.objects[1].pose.pose.orientation.w = 0.0
    with pytest.raises(InvalidOrientationError) as error:
        read_request(request, Settings(), ModelLibrary(), frames)
    assert str(as_sent(error.value, request)).endswith("the order is x, y, z, w (got (0.5, 0.0, 0.0, 0.0))")


@pytest.mark.parametrize(
    ("limit", "words"),
    [
        (2.0, "max_computation_time ran out, after 0.3 s for this prediction (got 2.0)"),
        (0.0, "the node's limit of computation time ran out, after 0.3 s for this prediction"),
    ],
)
def test_a_timeout_quotes_the_limit_that_was_sent(limit, words):
    request = good_request(max_computation_time=limit)
    error = PredictionTimeoutError("ran out", field="max_computation_time", value=0.3)
    assert str(as_sent(error, request)) == words


@pytest.mark.parametrize("frame_id", ["", "camera"])
def test_a_shared_error_turns_with_its_frame(frames, frame_id):
    def belief_of(**shared):
        request = good_request()
        request.scene.header.frame_id = frame_id
        for name, value in shared.items():
            setattr(request.scene, name, value)
        return read_request(request, Settings(zero_covariance="exact"), ModelLibrary(), frames).belief

    std, origin = np.array([0.01, 0.02, 0.0, 0.0, 0.0, 0.03]), Point(x=0.1, y=-0.2, z=0.3)
    rotation, shift = (TURN, SHIFT) if frame_id else (Rotation.identity(), np.zeros(3))
    place = rotation.apply([origin.x, origin.y, origin.z]) + shift
    expected = belief_of().with_common_pose_std(std, place, rotation.as_matrix())
    found = belief_of(common_pose_std=std, common_pose_origin=origin)
    assert np.allclose(found.covariance, expected.covariance, rtol=1e-12, atol=1e-15)
    assert not np.allclose(found.covariance, belief_of().joint, atol=1e-6)
