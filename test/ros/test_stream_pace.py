"""Streams in time: a limit on computation, predictions that are too late, and jumps of the clock."""

import sys
import threading
import time
import types
import typing

import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped, TransformStamped
from rclpy.parameter import Parameter
from rclpy.qos import qos_profile_sensor_data
from rosgraph_msgs.msg import Clock
from running import Inbox, node_in_this_process, wait_until
from scenes import moving_object, position_of

from unc_physics import make_propagator
from unc_physics.checks.errors import DivergedError
from unc_physics.ros import stream_pace
from unc_physics.ros.messages.fields import seconds
from unc_physics.ros.stream_pace import Pace
from unc_physics_msgs.msg import Prediction, Scene, TrackedObjects

NODE = "hurried"
PERIOD = 100_000_000  # ns
SHIFT = 3.0  # m, of the camera


def test_the_limit_is_half_the_period_of_the_input(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(stream_pace.time, "monotonic", lambda: now[0])
    pace = Pace()
    assert pace.limit(0.3) == 0.3
    for interval in (0.0, 0.1, 0.1, 5.0, 0.1, 0.1):  # a pause is not the period
        assert pace.limit(0.0) in (None, pytest.approx(0.05))
        now[0] += interval
        pace.arrived()
    assert pace.limit(0.0) == pytest.approx(0.05)
    pace.reset()
    assert pace.limit(0.0) is None


def test_rollouts_follow_the_time_that_they_take():
    pace, cloud = Pace(), make_propagator("cloud")
    limit, each = 0.05, 4e-3  # s
    counts = []
    for _ in range(8):
        counts.append(pace.adapted(cloud, limit).runs)
        pace.took(each * counts[-1], limit)
    assert counts == [32] + [12] * 7  # one prediction is late, and not one for each step down
    for _ in range(4):
        pace.took(0.1 * limit, limit)
    assert pace.adapted(cloud, limit).runs == 32
    assert pace.adapted(cloud, None) is cloud
    assert pace.adapted(make_propagator("auto"), limit).time == limit
    points = make_propagator("sigma_points")
    assert pace.adapted(points, limit) is points


class Tf2:
    """What the node uses of tf2_ros, which is not on PyPI: transforms that arrive late."""

    class Buffer:
        transforms: typing.ClassVar[dict] = {}
        waiting: typing.ClassVar[set] = set()
        cleared = 0

        def lookup_transform(self, target, source, time, timeout):
            self.waiting.add(time.nanoseconds)
            wait_until(lambda: time.nanoseconds <= self.transforms.get(source, -1))
            self.waiting.discard(time.nanoseconds)
            found = TransformStamped()
            found.transform.translation.x, found.transform.rotation.w = SHIFT, 1.0
            return found

        def clear(self):
            Tf2.Buffer.cleared += 1
            self.transforms.clear()

    @staticmethod
    def TransformListener(buffer, node):
        return buffer


@pytest.fixture
def hurried(monkeypatch):
    """The node in this process, with a tf2 of its own."""
    module = types.ModuleType("tf2_ros")
    module.Buffer, module.TransformListener = Tf2.Buffer, Tf2.TransformListener
    module.__spec__ = types.SimpleNamespace()
    monkeypatch.setitem(sys.modules, "tf2_ros", module)
    values = {
        "warm_up": ["cloud"],
        "zero_covariance": "exact",
        "gravity": [0.0, 0.0, 0.0],
        "horizons": [0.1, 50.0],
        "max_input_age": 0.0,
        "stream_time_budget": 1e3,
        "service_introspection": "disabled",
    }
    with node_in_this_process(NODE, **values) as node:
        yield node


@pytest.fixture
def scenes(hurried, client):
    publisher = client.node.create_publisher(Scene, f"/{NODE}/scene", qos_profile_sensor_data)
    yield publisher
    client.node.destroy_publisher(publisher)


@pytest.fixture
def predictions(client, scenes):
    """Predictions, once both topics are connected and no scene is on its way."""
    with Inbox(client, Prediction, f"/{NODE}/predictions", 100) as inbox:
        first, last = (at(client.node.get_clock().now().nanoseconds + k) for k in range(2))
        inbox.answer(lambda: scenes.publish(first))
        scenes.publish(last)
        while inbox.next().header.stamp != last.header.stamp:
            pass
        yield inbox


def at(nanoseconds, frame=""):
    message = Scene(objects=[moving_object(velocity=(0.0, 0.0, 0.0))])
    message.header.frame_id = frame
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(int(nanoseconds), 10**9)
    return message


def test_scenes_wait_for_late_transforms_side_by_side(client, scenes, predictions):
    begin, buffer = client.node.get_clock().now().nanoseconds, Tf2.Buffer
    sent = [at(begin + k * PERIOD, "camera") for k in range(5)]
    for k, scene in enumerate(sent):
        scenes.publish(scene)
        wait_until(lambda k=k: len(buffer.waiting) == k + 1)
    for k, scene in enumerate(sent):  # each transform lets one scene go on
        buffer.transforms["camera"] = begin + k * PERIOD
        answer = predictions.next()
        assert answer.header.stamp == scene.header.stamp
    place = position_of(answer.objects[0].states[0].pose.pose)
    assert place[0] == pytest.approx(SHIFT - 0.2, abs=0.01)
    assert seconds(answer.valid_until) - seconds(answer.header.stamp) == pytest.approx(50.0)


def test_a_bag_that_starts_again(hurried, client, scenes, predictions):
    hurried.set_parameters([Parameter("use_sim_time", value=True)])
    clock = client.node.create_publisher(Clock, "/clock", 1)
    wait_until(lambda: clock.get_subscription_count() >= 1)

    def set_clock(sec):
        clock.publish(Clock(clock=Time(sec=sec)))
        return hurried.get_clock().now().nanoseconds == sec * 10**9

    before = Tf2.Buffer.cleared
    for begin in (1000, 500):  # the second time the bag has jumped back
        wait_until(lambda begin=begin: set_clock(begin))
        scene = at(begin * 10**9, "camera")

        def send(scene=scene, begin=begin):
            Tf2.Buffer.transforms["camera"] = begin * 10**9  # again, as the jump empties the buffer
            scenes.publish(scene)

        predictions.answer(send, lambda found, begin=begin: found.header.stamp.sec == begin)
    assert Tf2.Buffer.cleared > before
    client.node.destroy_publisher(clock)


def test_a_limit_takes_rollouts_and_warns_and_what_is_over_is_dropped(hurried, client, scenes, predictions):
    hurried.set_parameters([Parameter("stream_time_budget", value=1e-4)])
    name = f"{NODE}: predictions"
    with Inbox(client, DiagnosticArray, "/diagnostics") as diagnostics:
        rollouts = []
        for _ in range(5):
            scenes.publish(at(client.node.get_clock().now().nanoseconds))
            rollouts.append(predictions.next().rollouts)
        assert rollouts == [32, 12, 12, 12, 12]
        status, values = diagnostics.status(name, lambda values: int(values["late predictions"]) >= 5)
        assert values["late predictions"] == "5"
        assert status.level == DiagnosticStatus.WARN and "the stream's limit is 0.0001 s" in status.message
        hurried.set_parameters([Parameter("horizons", value=[0.1])])
        scenes.publish(at(client.node.get_clock().now().nanoseconds - 1e9))
        status, _ = diagnostics.status(name, lambda values: int(values["expired predictions"]) == 1)
        assert status.level == DiagnosticStatus.WARN and "horizon" in status.message
        assert not predictions.all()


def test_diagnostics_tell_faults_of_the_node_and_streams_that_ended(
    hurried, client, scenes, predictions, monkeypatch
):
    def fault(*_):
        raise ZeroDivisionError

    def publish():
        scenes.publish(at(client.node.get_clock().now().nanoseconds))

    name = f"{NODE}: predictions"
    hurried.set_parameters([Parameter("horizons", value=[0.5]), Parameter("stream_time_budget", value=0.0)])
    with Inbox(client, DiagnosticArray, "/diagnostics") as diagnostics:
        _, before = diagnostics.status(name)
        with monkeypatch.context() as patch:
            patch.setattr("unc_physics.ros.streams.write_answer", fault)
            for more in (1, 2):
                status, _ = diagnostics.status(
                    name,
                    lambda values, more=more: int(values["errors"]) >= int(before["errors"]) + more,
                    publish,
                )
        assert status.level == DiagnosticStatus.ERROR and "fault of the node" in status.message
        later = types.SimpleNamespace(monotonic=lambda: time.monotonic() + 100.0)
        monkeypatch.setattr("unc_physics.ros.diagnostics.time", later)
        wait_until(lambda: "no input for 1" in diagnostics.status(name)[0].message)
        assert diagnostics.status(name)[0].level == DiagnosticStatus.STALE


def test_a_tracker_that_starts_anew_is_an_error(client, monkeypatch):
    def diverge(*_):
        raise DivergedError("left the range of numbers", field="tracker")

    monkeypatch.setattr("unc_physics.ros.tracks.Tracks.observe", diverge)
    values = {"track": True, "observed_objects": ["can"], "warm_up": [""]}
    with (
        node_in_this_process("restarted", **values),
        Inbox(client, DiagnosticArray, "/diagnostics") as diagnostics,
    ):
        pose = PoseWithCovarianceStamped()
        publisher = client.node.create_publisher(
            PoseWithCovarianceStamped, "/restarted/observed/can", qos_profile_sensor_data
        )
        status, _ = diagnostics.status(
            "restarted: tracking",
            lambda values: int(values["skipped observations"]) > 0,
            lambda: publisher.publish(pose),
        )
        assert status.level == DiagnosticStatus.ERROR and "starts anew" in status.message
        client.node.destroy_publisher(publisher)


@pytest.fixture
def tracking(tmp_path):
    """The node in this process with a tracker, and a limit that no prediction keeps."""
    table = tmp_path / "table.yaml"
    table.write_text("environment:\n  - plane: {normal: [0, 0, 1], offset: 0.0}\n")
    values = {"track": True, "observed_objects": ["can"], "warm_up": [""], "environment": str(table)}
    values |= {"horizons": [0.1], "stream_time_budget": 1e-4, "max_input_age": 0.0, "tracked_rate": 0.01}
    with node_in_this_process("pursued", **values) as node:
        yield node


def test_tracked_predictions_keep_their_limit_and_come_once_for_what_waits(tracking, client):
    publisher = client.node.create_publisher(
        PoseWithCovarianceStamped, "/pursued/observed/can", qos_profile_sensor_data
    )

    def publish():
        message = PoseWithCovarianceStamped()
        message.header.stamp = client.node.get_clock().now().to_msg()
        publisher.publish(message)
        return message.header.stamp

    with (
        Inbox(client, Prediction, "/pursued/predictions") as predictions,
        Inbox(client, TrackedObjects, "/pursued/tracked") as tracked,
        Inbox(client, DiagnosticArray, "/diagnostics") as diagnostics,
    ):
        tracked.answer(publish)
        assert predictions.answer(publish, lambda found: found.rollouts < 64).rollouts == 12
        status, _ = diagnostics.status(
            "pursued: predictions", lambda values: int(values["late predictions"]) > 1
        )
        assert status.level == DiagnosticStatus.WARN and "the stream's limit is 0.0001 s" in status.message
        last = publish()
        tracked.answer(lambda: None, lambda found: found.header.stamp == last)
        worker, go_on, stamps = tracking.server.tracking, threading.Event(), []
        worker._worker.submit(go_on.wait)  # the tracker is busy
        for k in range(3):
            stamps.append(publish())
            wait_until(lambda k=k: worker._pending == k + 1)
        go_on.set()
        published = [tracked.next().header.stamp]
        while published[-1] != stamps[-1]:
            published.append(tracked.next().header.stamp)
        assert not any(stamp in published for stamp in stamps[:2])
    client.node.destroy_publisher(publisher)


def test_disabled_introspection_publishes_no_events(hurried):
    def topics():
        return {name for name, _ in hurried.get_publisher_names_and_types_by_node(NODE, "/")}

    wait_until(lambda: f"/{NODE}/predictions" in topics())
    assert not [name for name in topics() if name.startswith(f"/{NODE}/") and name.endswith("_service_event")]
