"""Scenes in on topics, predictions out."""

from types import SimpleNamespace

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import Pose, PoseWithCovariance, PoseWithCovarianceStamped, Vector3
from in_process import FRAMES
from rclpy.qos import ReliabilityPolicy, qos_profile_sensor_data
from running import Client, Inbox, NodeProcess, wait_until
from scenes import POSITION_STD, good_request, moving_object, numbers_of, position_of
from shape_msgs.msg import Plane
from std_msgs.msg import Header
from visualization_msgs.msg import Marker, MarkerArray

from unc_physics.ros.detected import read_detections, settle_detected, topic_name
from unc_physics.ros.messages.clocks import stamp_problem
from unc_physics.ros.messages.fields import seconds
from unc_physics.ros.messages.request import read_request
from unc_physics.ros.models import ModelLibrary
from unc_physics.ros.parameters import Settings
from unc_physics.ros.streams import request_of, transforms
from unc_physics_msgs.msg import Environment, EnvironmentElement, PredictedObject, Prediction, Scene

HORIZONS = [0.1, 0.2, 0.25]
AHEAD = 20.0  # s, of stamps before now: the horizon has not passed, however slow the machine
STATUS = "stream: predictions"
SPHERES = 200  # their loss of extent is below the standard deviation of position, and raises no flag


@pytest.fixture(scope="module")
def node():
    parameters = {
        "zero_covariance": "exact",
        "horizons": HORIZONS,
        "gravity": [0.0, 0.0, 0.0],
        "pose_objects": ["left/1"],
        "pose_horizon": 0.2,
        "max_input_age": 30.0,
        "max_input_lead": 30.0,
        "stream_time_budget": 30.0,  # predictions do not depend on the machine
        "observed_objects": ["mine=can"],
        "markers": ["initial", "predicted", "ellipsoid", "rotation"],
        "default_twist_std": [0.5, 0.1],
        "qos_overrides./stream/observed/mine.subscription.reliability": "reliable",
    }
    with NodeProcess(name="stream", **parameters) as process:
        yield process


@pytest.fixture(scope="module")
def listener():
    with Client() as made:
        yield made


def scene(listener, age=-AHEAD):
    message = Scene(objects=good_request().scene.objects)
    message.objects[0].id = "left/1"
    for entry in message.objects:
        entry.spheres = SPHERES
    now = listener.node.get_clock().now().nanoseconds - int(age * 1e9)
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(now, 1_000_000_000)
    return message


@pytest.fixture(scope="module")
def publish(node, listener):
    publisher = listener.node.create_publisher(Scene, "/stream/scene", qos_profile_sensor_data)
    wait_until(lambda: publisher.get_subscription_count() == 1)
    return publisher.publish


@pytest.fixture(scope="module")
def answer_to(publish, listener):
    """Function that publishes a scene and returns its prediction; those of earlier scenes may still come."""
    with Inbox(listener, Prediction, "/stream/predictions", 100) as inbox:
        yield lambda sent: inbox.answer(lambda: publish(sent), is_of(sent))


def is_of(sent):
    """Whether a message has the stamp of a scene."""
    return lambda message: message.header.stamp == sent.header.stamp


def test_a_scene_is_predicted_for_all_horizons(answer_to, listener):
    sent = scene(listener)
    message = answer_to(sent)
    assert (message.header.stamp, message.header.frame_id) == (sent.header.stamp, "world")
    assert [predicted.id for predicted in message.objects] == ["left/1", "right"]
    for predicted in message.objects:
        assert np.allclose([seconds(state.time_from_start) for state in predicted.states], HORIZONS)
        for state in predicted.states:
            assert np.isfinite(numbers_of(state)).all()
            assert state.status == PredictedObject.STATUS_FINE
    ends = [stamp.sec + 1e-9 * stamp.nanosec for stamp in (message.header.stamp, message.valid_until)]
    assert ends[1] - ends[0] == pytest.approx(seconds(message.time_reached), abs=1e-6)
    xs = [position_of(state.pose.pose)[0] for state in message.objects[0].states]
    way = np.array(xs) - sent.objects[0].pose.pose.position.x
    assert np.allclose(way, 0.5 * np.array(HORIZONS), atol=1e-3)  # a few sigma points may touch at the end


def test_the_same_scene_has_the_same_prediction(answer_to, listener):
    """What changes from one prediction of a stream to the next is the scene, not what was drawn."""
    first, second = (answer_to(scene(listener)) for _ in range(2))
    assert first.header.stamp != second.header.stamp and first.seed == second.seed
    for one, other in zip(first.objects, second.objects, strict=True):
        for states in zip(one.states, other.states, strict=True):
            assert np.array_equal(*map(numbers_of, states))


def test_one_bad_object_is_left_out_alone(answer_to, listener):
    sent = scene(listener)
    bad = [moving_object(name, position=(2.0 * k + 5.0, 0.0, 0.0)) for k, name in enumerate("abcde")]
    bad[0].pose.pose.position.x = float("nan")
    bad[1].pose.pose.orientation.w = 0.0
    bad[2].pose.covariance[0] = -3.0
    bad[3].model = "teapot"
    bad[4].id = "right"
    sent.objects = [*bad[:4], *sent.objects, bad[4]]
    message = answer_to(sent)
    assert [predicted.id for predicted in message.objects] == ["left/1", "right"]
    reasons = {pair.key: pair.value for pair in message.skipped}
    assert reasons["a"] == "scene.objects[0].pose.pose.position must be finite (got nan)"
    assert reasons["b"].startswith("scene.objects[1].pose.pose.orientation must have unit length, not 0")
    assert reasons["c"].startswith("scene.objects[2].pose.covariance")
    assert reasons["d"].startswith("scene.objects[3].model") and "teapot" in reasons["d"]
    assert reasons["right"] == "scene.objects[6].id is the id of two objects (got 'right')"


def test_a_pose_of_one_object_at_one_horizon(publish, listener):
    assert topic_name("left/1") == "left_1"
    sent = scene(listener)
    with Inbox(listener, PoseWithCovarianceStamped, "/stream/predicted_pose/left_1") as inbox:
        message = inbox.answer(lambda: publish(sent), is_of(sent))  # the topic comes with the first pose
    assert position_of(message.pose.pose)[0] == pytest.approx(-0.2 + 0.5 * 0.2, abs=1e-4)


def node_at(seconds, sim_time=False):
    """A node whose clock shows a time [s]."""
    clock = SimpleNamespace(
        now=lambda: SimpleNamespace(nanoseconds=seconds * 10**9), ros_time_is_active=sim_time
    )
    use_sim_time = SimpleNamespace(value=sim_time)
    return SimpleNamespace(get_clock=lambda: clock, get_parameter=lambda _: use_sim_time)


@pytest.mark.parametrize(
    ("now", "stamp", "sim_time", "words"),
    [
        (1000, 971, False, None),
        (1000, 1029, False, None),
        (1000, 940, False, "60 s old, and the parameter max_input_age allows 30 s"),
        (1000, 1060, False, "60 s in the future, and the parameter max_input_lead allows 30 s"),
        (1000, -5, False, "1e+03 s old"),
        (
            1000,
            77,
            False,
            "stamp is 77.000 s, the node's clock 1000.000 s (the system's, as use_sim_time is f",
        ),
        (1000, 77, True, "that of /clock, as use_sim_time is true"),
        (0, 77, True, "no /clock has come"),
    ],
)
def test_messages_about_stamps_name_parameters_and_both_clocks(now, stamp, sim_time, words):
    settings = Settings(max_input_age=30.0, max_input_lead=30.0)
    problem = stamp_problem(node_at(now, sim_time), Time(sec=stamp), settings)
    assert problem is None if words is None else words in problem


def test_scenes_of_other_times_are_dropped_and_bad_ones_told(publish, answer_to, listener):
    old, bad, last = scene(listener, age=60.0), scene(listener), scene(listener)
    bad.common_pose_std[1] = -1.0
    received = []
    with (
        Inbox(listener, DiagnosticArray, "/diagnostics") as diagnostics,
        Inbox(listener, Prediction, "/stream/predictions", 100) as predictions,
    ):
        _, before = diagnostics.status(STATUS)
        for sent, counter in ((old, "dropped inputs"), (bad, "errors")):

            def counted(values, counter=counter):
                return int(values[counter]) > int(before[counter])

            status, values = diagnostics.status(STATUS, counted, lambda sent=sent: publish(sent))
        assert status.level == DiagnosticStatus.WARN and "common_pose_std[1]" in status.message
        assert "common_pose_std[1]" in values["last error"]
        answer_to(last)
        wait_until(lambda: received.extend(predictions.all()) or any(map(is_of(last), received)))
    assert not [one for one in received if is_of(old)(one) or is_of(bad)(one)]


def detection(make, class_scores, name="", x=0.0, frame=""):
    """A vision_msgs/Detection3D; ``make`` makes its parts by the names of their types."""
    results = []
    for class_id, score in class_scores:
        pose = PoseWithCovariance()
        pose.pose.position.x, pose.covariance = x, 0.01**2 * np.eye(6).ravel()
        results.append(
            make(
                "ObjectHypothesisWithPose",
                hypothesis=make("ObjectHypothesis", class_id=class_id, score=score),
                pose=pose,
            )
        )
    box = make("BoundingBox3D", center=Pose(), size=Vector3())
    return make("Detection3D", header=Header(frame_id=frame), results=results, id=name, bbox=box)


def detections(make):
    """Two objects, of which one has an id and two hypotheses, and a third that nothing is known of."""
    return make(
        "Detection3DArray",
        header=Header(frame_id="world"),
        detections=[
            detection(make, [("bottle", 0.2), ("can", 0.7)], "the can"),
            detection(make, []),
            detection(make, [("brick", 0.9)], x=1.0),
            detection(make, [("teapot", 0.9)], x=2.0),
        ],
    )


def test_the_scene_of_detections():
    message = detections(lambda kind, **parts: SimpleNamespace(**parts))
    found = read_detections(message, ModelLibrary(), Settings())
    assert found.skipped == {
        "detection_1": "detections[1].results must name a class, with a finite score: none does"
    }
    assert found.header.frame_id == "world"
    assert [(state.id, state.model) for state in found.objects] == [
        ("the can", "can"),
        ("brick_2", "brick"),
        ("teapot_3", "teapot"),
    ]
    assert found.objects[1].pose.pose.position.x == 1.0
    assert all(state.twist.covariance[0] == -1.0 for state in found.objects)
    assert all(state.mass == 0.0 for state in found.objects)  # the models'


def test_frames_of_detections_count_where_the_array_has_none():
    def make(kind, **parts):
        return SimpleNamespace(**parts)

    message = detections(make)
    message.header.frame_id = ""
    for own, frame in zip(message.detections, ("", "", "camera", "wrist"), strict=True):
        own.header.frame_id = frame
    found = read_detections(message, ModelLibrary(), Settings())
    assert found.header.frame_id == "camera"
    assert [state.id for state in found.objects] == ["the can", "brick_2"]
    assert found.skipped["teapot_3"] == (
        "detections[3].header.frame_id must be that of the other detections, 'camera' (got 'wrist')"
    )
    message.header.frame_id = "base"
    found = read_detections(message, ModelLibrary(), Settings())
    assert found.header.frame_id == "base" and len(found.objects) == 3


def test_one_bad_detection_is_left_out_alone():
    message = detections(lambda kind, **parts: SimpleNamespace(**parts))
    message.detections[2].results[0].pose.pose.position.x = float("nan")
    message.detections[3].results[0].pose.pose.orientation.w = 0.0
    library, settings = ModelLibrary(), Settings()
    seen = read_detections(message, library, settings)
    floor = EnvironmentElement(id="floor", plane=Plane(coef=[0.0, 0.0, 1.0, 0.0]))
    scene = Scene(header=seen.header, objects=seen.objects)
    scene, _ = settle_detected(scene, Environment(elements=[floor]), library, settings)
    found = read_request(request_of(scene, settings), settings, library, FRAMES)
    assert [body.name for body in found.scene.bodies] == ["the can"]
    assert list(found.skipped) == ["brick_2", "teapot_3"]
    assert "pose.pose.position must be finite (got nan)" in found.skipped["brick_2"]


def test_what_holds_no_valid_object_is_answered_by_an_empty_prediction(answer_to, listener):
    empty, bad = scene(listener), scene(listener)
    empty.objects = []
    for own in bad.objects:
        own.mass = -1.0
    answers = [answer_to(one) for one in (empty, bad)]
    assert all(not message.objects and message.header.frame_id == "world" for message in answers)
    assert [pair.key for pair in answers[1].skipped] == ["left/1", "right"]


def test_transforms_of_predicted_poses():
    header = Header(frame_id="world")
    header.stamp.sec = 7
    pose = PoseWithCovariance()
    pose.pose.position.x, pose.pose.orientation.z, pose.pose.orientation.w = 0.3, 0.6, 0.8
    (found,) = transforms(header, {"can": pose})
    assert (found.header, found.child_frame_id) == (header, "can_predicted")
    assert found.transform.translation.x == 0.3 and found.transform.rotation == pose.pose.orientation


def test_predicted_poses_are_on_tf(listener):
    messages = pytest.importorskip("tf2_msgs.msg", reason="needs tf2_msgs, which is not on PyPI")
    options = {"horizons": [0.5], "pose_horizon": 0.5, "publish_tf": True, "warm_up": ["cloud"]}
    with NodeProcess(name="on_tf", **options), Inbox(listener, messages.TFMessage, "/tf") as inbox:
        sent = scene(listener)
        publisher = listener.node.create_publisher(Scene, "/on_tf/scene", qos_profile_sensor_data)
        names = {one.child_frame_id for one in inbox.answer(lambda: publisher.publish(sent)).transforms}
        assert names == {"left/1_predicted", "right_predicted"}


def test_detections_are_predicted(node, listener):
    messages = pytest.importorskip("vision_msgs.msg", reason="needs vision_msgs, which is not on PyPI")
    publisher = listener.node.create_publisher(
        messages.Detection3DArray, "/stream/detections", qos_profile_sensor_data
    )
    sent = detections(lambda kind, **parts: getattr(messages, kind)(**parts))
    with Inbox(listener, Prediction, "/stream/predictions") as inbox:
        answer = inbox.answer(lambda: publisher.publish(sent), has_objects("the can", "brick_2"))
    assert [predicted.model for predicted in answer.objects] == ["can", "brick"]
    assert [skipped.key for skipped in answer.skipped] == ["teapot_3", "detection_1"]


def has_objects(*names):
    """Whether a prediction is of these objects."""
    return lambda message: [predicted.id for predicted in message.objects] == list(names)


def test_a_tracked_object_with_another_quality_of_service(node, listener):
    publisher = listener.node.create_publisher(PoseWithCovarianceStamped, "/stream/observed/mine", 1)
    wait_until(lambda: publisher.get_subscription_count() == 1)
    (info,) = listener.node.get_subscriptions_info_by_topic("/stream/observed/mine")
    assert info.qos_profile.reliability == ReliabilityPolicy.RELIABLE and "has no effect" not in node.output
    sent = PoseWithCovarianceStamped()
    sent.pose.pose.position.z = 2.0
    with Inbox(listener, Prediction, "/stream/predictions") as inbox:
        (predicted,) = inbox.answer(lambda: publisher.publish(sent), has_objects("mine")).objects
    assert predicted.model == "can"
    spread = np.sqrt(np.reshape(predicted.states[-1].pose.covariance, (6, 6))[0, 0])
    assert spread == pytest.approx(0.5 * HORIZONS[-1], rel=0.05)  # its velocity is not known


def draws(sent):
    """Whether markers are of a scene."""
    return lambda message: is_of(sent)(message.markers[-1])


def test_markers(publish, listener):
    with (
        Inbox(listener, MarkerArray, "/stream/stream_markers") as inbox,
        Inbox(listener, MarkerArray, "/stream/markers") as of_requests,
    ):
        sent, request = scene(listener), good_request()
        request.scene.header.stamp.sec = 123
        first, *others = inbox.answer(lambda: publish(sent), draws(sent)).markers
        assert draws(request.scene)(of_requests.answer(lambda: listener.predict(request, node="stream")))
        assert not any(map(draws(request.scene), inbox.all()))
    assert first.action == Marker.DELETEALL
    kinds = {marker.ns for marker in others}
    assert kinds == {
        f"{kind} {name}"
        for kind in ("initial", "predicted", "ellipsoid", "rotation")
        for name in ("left/1", "right")
    }
    for marker in others:
        assert seconds(marker.lifetime) == 10.0
        assert marker.header.frame_id == "world"
        assert min(marker.scale.x, max(marker.scale.y, marker.scale.x)) > 0.0
        q = marker.pose.orientation
        assert np.linalg.norm([q.x, q.y, q.z, q.w]) == pytest.approx(1.0)
        points = np.array([[p.x, p.y, p.z] for p in marker.points])
        assert np.isfinite(points).all()
        if marker.type == Marker.SPHERE_LIST:
            assert 20 < len(points) < 2000
            assert np.abs(points).max() < 0.3
            # 12 cells along the longest side, each with a ball of 1.3 cells
            assert np.ptp(points, axis=0).max() == pytest.approx(11 * marker.scale.x / 1.3)


def test_occupancy(publish, listener):
    sent = scene(listener)
    with Inbox(listener, MarkerArray, "/stream/occupancy") as inbox:
        first, *boxes = inbox.answer(lambda: publish(sent), draws(sent)).markers
    assert first.action == Marker.DELETEALL
    assert [(box.ns, box.id) for box in boxes] == [
        (f"occupancy {name}", k) for name in ("left/1", "right") for k in range(len(HORIZONS))
    ]
    places = np.array([box.pose.position.x for box in boxes[: len(HORIZONS)]])
    assert np.allclose(np.diff(places), 0.5 * np.diff(HORIZONS), atol=2e-3)  # it moves with its object
    assert all(box.scale.x > 6.0 * POSITION_STD for box in boxes)
