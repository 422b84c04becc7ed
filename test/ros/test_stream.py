"""Scenes in on topics, predictions out."""

import time

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.qos import qos_profile_sensor_data
from running import Client, Inbox, NodeProcess, wait_until
from scenes import good_request, numbers_of, position_of
from visualization_msgs.msg import Marker, MarkerArray

from unc_physics.ros.conversions import seconds
from unc_physics.ros.streaming import topic_name
from unc_physics_msgs.msg import ObjectStateArray, Prediction

HORIZONS = [0.1, 0.2, 0.25]


@pytest.fixture(scope="module")
def node():
    parameters = {
        "zero_covariance": "exact", "horizons": HORIZONS, "gravity": [0.0, 0.0, 0.0], "pose_objects": ["left/1"],
        "pose_horizon": 0.2, "max_input_age": 30.0, "tracked_topics": ["/tracker/pose"], "tracked_models": ["can"],
        "markers": ["initial", "predicted", "ellipsoid", "rotation"], "default_linear_velocity_std": 0.5,
    }
    arguments = [part for name, value in parameters.items() for part in ("-p", f"{name}:={value}".replace("'", '"'))]
    with NodeProcess(*arguments, name="stream") as process:
        yield process


@pytest.fixture(scope="module")
def listener():
    with Client() as made:
        yield made


def scene(listener, age=0.0):
    message = ObjectStateArray(objects=good_request().objects)
    message.objects[0].id = "left/1"
    now = listener.node.get_clock().now().nanoseconds - int(age * 1e9)
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(now, 1_000_000_000)
    return message


@pytest.fixture(scope="module")
def publish(node, listener):
    publisher = listener.node.create_publisher(ObjectStateArray, "/stream/objects", qos_profile_sensor_data)
    wait_until(lambda: publisher.get_subscription_count() == 1)
    return publisher.publish


def test_a_scene_is_predicted_for_all_horizons(publish, listener):
    with Inbox(listener, Prediction, "/stream/predictions") as inbox:
        wait_until(lambda: listener.node.count_publishers("/stream/predictions") == 1)
        time.sleep(0.3)
        sent = scene(listener)
        publish(sent)
        message = inbox.next()
    assert (message.header.stamp, message.header.frame_id) == (sent.header.stamp, "world")
    assert [predicted.id for predicted in message.objects] == ["left/1", "right"]
    for predicted in message.objects:
        assert np.allclose([seconds(state.time_from_start) for state in predicted.states], HORIZONS)
        for state in predicted.states:
            assert np.isfinite(numbers_of(state)).all()
    xs = [position_of(state.pose.pose)[0] for state in message.objects[0].states]
    assert np.allclose(np.array(xs) - sent.objects[0].pose.pose.position.x, 0.5 * np.array(HORIZONS))


def test_a_pose_of_one_object_at_one_horizon(publish, listener):
    assert topic_name("left/1") == "left_1"
    with Inbox(listener, PoseWithCovarianceStamped, "/stream/predicted_pose/left_1") as inbox:
        publish(scene(listener))  # the topic comes with the first pose
        wait_until(lambda: listener.node.count_publishers("/stream/predicted_pose/left_1") == 1)
        time.sleep(0.3)
        inbox.all()
        publish(scene(listener))
        assert position_of(inbox.next().pose.pose)[0] == pytest.approx(-0.2 + 0.5 * 0.2)


def test_old_scenes_are_dropped_and_bad_ones_told(publish, listener):
    def status(inbox):
        inbox.all()
        while True:  # other nodes tell about themselves, too
            (found,) = inbox.next().status
            if found.name.startswith("stream:"):
                return found, {pair.key: pair.value for pair in found.values}

    with Inbox(listener, DiagnosticArray, "/diagnostics") as diagnostics, \
            Inbox(listener, Prediction, "/stream/predictions") as inbox:
        time.sleep(0.3)
        _, before = status(diagnostics)
        publish(scene(listener, age=60.0))
        bad = scene(listener)
        bad.objects[1].mass = -1.0
        time.sleep(0.3)
        publish(bad)
        wait_until(lambda: int(status(diagnostics)[1]["errors"]) == int(before["errors"]) + 1)
        found, after = status(diagnostics)
        assert int(after["dropped inputs"]) == int(before["dropped inputs"]) + 1
        assert found.level == DiagnosticStatus.WARN
        assert "objects[1].mass" in after["last error"]
        assert not inbox.all()
        publish(scene(listener))
        inbox.next()


def test_the_newest_scene_wins(publish, listener):
    with Inbox(listener, Prediction, "/stream/predictions") as inbox:
        time.sleep(0.3)
        for _ in range(200):
            last = scene(listener)
            publish(last)
        newest = inbox.next()
        deadline = time.monotonic() + 20.0
        while newest.header.stamp != last.header.stamp and time.monotonic() < deadline:
            newest = inbox.next()
        assert newest.header.stamp == last.header.stamp


def test_a_tracked_object(node, listener):
    publisher = listener.node.create_publisher(PoseWithCovarianceStamped, "/tracker/pose", qos_profile_sensor_data)
    wait_until(lambda: publisher.get_subscription_count() == 1)
    message = PoseWithCovarianceStamped()
    message.pose.pose.position.z = 2.0
    with Inbox(listener, Prediction, "/stream/predictions") as inbox:
        time.sleep(0.3)
        publisher.publish(message)
        (predicted,) = inbox.next().objects
    assert (predicted.id, predicted.model) == ("/tracker/pose", "can")
    spread = np.sqrt(np.reshape(predicted.states[-1].pose.covariance, (6, 6))[0, 0])
    assert spread == pytest.approx(0.5 * HORIZONS[-1], rel=0.05)  # its velocity is not known


def test_markers(publish, listener):
    with Inbox(listener, MarkerArray, "/stream/markers") as inbox:
        wait_until(lambda: listener.node.count_publishers("/stream/markers") == 1)
        time.sleep(0.3)
        publish(scene(listener))
        first, *others = inbox.next().markers
    assert first.action == Marker.DELETEALL
    kinds = {marker.ns for marker in others}
    assert kinds == {f"{kind} {name}" for kind in ("initial", "predicted", "ellipsoid", "rotation") for name in ("left/1", "right")}
    for marker in others:
        assert marker.header.frame_id == "world"
        assert min(marker.scale.x, max(marker.scale.y, marker.scale.x)) > 0.0
        q = marker.pose.orientation
        assert np.linalg.norm([q.x, q.y, q.z, q.w]) == pytest.approx(1.0)
        points = np.array([[p.x, p.y, p.z] for p in marker.points])
        assert np.isfinite(points).all()
        if marker.type == Marker.SPHERE_LIST:
            assert 20 < len(points) < 2000
            assert np.abs(points).max() < 0.3
