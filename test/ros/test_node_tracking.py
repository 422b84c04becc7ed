"""The node's tracker over DDS: bad, late, lost, repeated and swapped observations, forks and paths."""

import importlib.util
import re
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped, Transform
from rclpy.qos import qos_profile_sensor_data
from running import READY_TIMEOUT, Client, Inbox, NodeProcess, wait_until
from scenes import measured, position_of
from shape_msgs.msg import SolidPrimitive
from trajectory_msgs.msg import MultiDOFJointTrajectoryPoint

from unc_physics.checks.errors import ErrorCode, InvalidRequestError
from unc_physics.ros import Client as PythonClient
from unc_physics.ros import make_message, poses_of
from unc_physics.ros.messages.fields import duration, nanoseconds, seconds
from unc_physics_msgs.msg import (
    Action,
    ActionArray,
    BoxRegion,
    Event,
    ObjectState,
    Prediction,
    PredictionRequest,
    TrackedObjects,
)
from unc_physics_msgs.srv import Fork, Reset

ROOT = Path(__file__).resolve().parents[2]
G, PERIOD, STD, TURN_STD = 9.81, 1.0 / 30.0, 0.002, 0.02
HORIZONS = [0.1, 0.4]
MODELS = {"box": "salt_box", "left/1": "can", "right": "can", "dish": "plate"}


@pytest.fixture(scope="module")
def node(tmp_path_factory):
    table = tmp_path_factory.mktemp("environment") / "table.yaml"
    table.write_text("environment:\n  - name: table\n    plane: {normal: [0, 0, 1], offset: 0.0}\n")
    parameters = {
        "track": True,
        "observed_objects": ["=".join(pair) for pair in MODELS.items()],
        "environment": str(table),
        "horizons": HORIZONS,
        "warm_up": [""],
        "max_input_age": 0.0,  # stamps do not depend on the machine
        "max_input_lead": 0.0,
        "tracked_rate": 0.01,
        "exact": True,
    }
    with NodeProcess(name="tracker", **parameters) as process:
        yield process


@pytest.fixture(scope="module")
def listener():
    with Client() as made:
        yield made


class Camera:
    """Observes objects whose states are known."""

    def __init__(self, listener):
        self._node, self._listener = listener.node, listener
        self._publishers = {
            name: self._node.create_publisher(
                PoseWithCovarianceStamped,
                f"/tracker/observed/{name.replace('/', '_')}",
                qos_profile_sensor_data,
            )
            for name in MODELS
        }
        self._inbox = Inbox(listener, TrackedObjects, "/tracker/tracked", 100)
        self._start = 1000.0
        for k, name in enumerate(MODELS):  # until all topics are connected
            stamp = self.stamp(k)
            self._inbox.answer(
                lambda k=k, name=name: self.send(k, name, (k, 0.0, 0.0)),
                lambda found, stamp=stamp: found.header.stamp == stamp or found.skipped,
            )

    def begin(self):
        """Forget all objects; later times."""
        began = time.time()
        assert self._listener.call(Reset, "/tracker/reset", Reset.Request()).result.error_code == 0
        self._start += 1000.0
        while (found := self._inbox.next()).objects or seconds_of(found) < began:
            pass  # from before; without objects the stamp is the time of the reset

    def stamp(self, t):
        """The stamp of a time since `begin`."""
        sec, nanosec = divmod(round(1e9 * (self._start + t)), 1_000_000_000)
        return Time(sec=sec, nanosec=nanosec)

    def send(self, t, name, position, frame="world", q=(0.0, 0.0, 0.0, 1.0)):
        """Observe an object at a time."""
        message = PoseWithCovarianceStamped(pose=measured(position, STD, TURN_STD, q))
        message.header.stamp, message.header.frame_id = self.stamp(t), frame
        self._publishers[name].publish(message)

    def next(self):
        """What is published after one observation."""
        return self._inbox.next()

    def answer_of(self, t, send):
        """What is published of a time; ``send`` causes it, and may be repeated without an effect."""
        return self._inbox.answer(send, lambda found: found.header.stamp == self.stamp(t))

    def see(self, *observation, **others):
        """What is published after one observation that is sent."""
        self.send(*observation, **others)
        return self.next()

    def see_until_skipped(self, *observation):
        """What is published once something else that was sent is left out; repetitions have no effect."""
        while not (found := self.see(*observation)).skipped:
            pass
        return found


@pytest.fixture(scope="module")
def camera(node, listener):
    return Camera(listener)


def fall(seed=0, count=10):
    """Times and measured positions of a box that falls from half a metre."""
    rng = np.random.default_rng(seed)
    times = PERIOD * np.arange(count)
    return [
        (t, "box", (0.3 * t, 0.0, 0.5 - 0.5 * G * t**2) + STD * rng.standard_normal(3))
        for t in times.tolist()
    ]


def numbers_of(message):
    return [
        np.r_[position_of(own.pose.pose), own.covariance, own.distance, own.rejections]
        for own in message.objects
    ]


def test_a_falling_object_is_tracked(camera):
    camera.begin()
    found = [camera.see(*observation) for observation in fall()]
    assert found[0].objects[0].status == found[0].objects[0].STATUS_STARTING
    last, t = found[-1], 9 * PERIOD
    (own,) = last.objects
    assert (last.header.stamp, last.header.frame_id) == (camera.stamp(t), "world")
    assert (own.id, own.model, own.status) == ("box", "salt_box", own.STATUS_TRACKED)
    assert own.last_seen == last.header.stamp and own.rejections == 0
    v, C = own.twist.twist.linear, np.reshape(own.twist.covariance, (6, 6))
    std = np.sqrt(C.diagonal()[:3])
    # ten positions with 2 mm determine a velocity in the middle to 22 mm/s
    assert std[2] == pytest.approx(STD / PERIOD / np.sqrt(82.5), rel=0.5)
    assert abs(v.z + G * t) < 4.0 * std[2] and abs(v.x - 0.3) < 4.0 * std[0]


def test_order_and_repetition_of_observations_make_no_difference(camera):
    sent = fall()
    camera.begin()
    in_order = [camera.see(*observation) for observation in sent][-1]
    camera.begin()
    order = [0, 1, 4, 2, 3, 3, 6, 5, 1, 8, 7, 9, 9]  # late, swapped in time, and repeated
    disorder = [camera.see(*sent[k]) for k in order][-1]
    assert seconds_of(disorder) - seconds_of(in_order) == pytest.approx(1000.0)
    assert np.array_equal(numbers_of(in_order), numbers_of(disorder))


def seconds_of(message):
    return 1e-9 * nanoseconds(message.header.stamp)


def test_bad_observations_are_left_out_alone(camera):
    camera.begin()
    camera.see(0.0, "box", (0.0, 0.0, 0.0))
    bad = [
        camera.see(PERIOD, "box", (np.nan, 0.0, 0.5)),
        camera.see(PERIOD, "box", (0.0, 0.0, 0.5), q=(0.0, 0.0, 0.0, 0.0)),
    ]
    camera.send(PERIOD, "box", (0.0, 0.0, 0.5), frame="nowhere")
    bad.append(camera.see_until_skipped(PERIOD, "box", (0.0, 0.0, 0.0)))
    reasons = [(own.key, own.value) for message in bad for own in message.skipped]
    expected = ("pose.position must be finite", "pose.orientation", "header.frame_id ")
    assert [name for name, _ in reasons] == ["box"] * 3
    assert all(part in reason for part, (_, reason) in zip(expected, reasons, strict=True)), reasons
    assert "scene" not in reasons[-1][1] and "nowhere" in reasons[-1][1]
    (own,) = bad[-1].objects
    assert own.id == "box" and own.last_seen == camera.stamp(PERIOD) and own.rejections == 0


@pytest.mark.parametrize("association", ["id", "distance"])
def test_swapped_names_move_nothing(camera, listener, association):
    camera.begin()
    places = {"left/1": (0.0, -0.15, 0.5), "right": (0.0, 0.15, 0.5)}

    def see(k, swapped):
        t, names = k * PERIOD, list(places)
        for name, other in zip(names, reversed(names), strict=True):
            x, y, z = places[other if swapped else name]
            found = camera.see(t, name, (x, y, z - 0.5 * G * t**2))
        return {own.id: own for own in found.objects}

    try:
        if association == "distance":
            listener.set_parameter("tracker", "association_distance", 0.1)
            listener.set_parameter("tracker", "association", "distance")
        for k in range(6):
            found = see(k, swapped=False)
        names = [name for _, name in sorted((own.pose.pose.position.y, name) for name, own in found.items())]
        assert len(names) == 2 and set(names) == set(places)
        for k in range(6, 8):
            found = see(k, swapped=True)
    finally:
        listener.set_parameter("tracker", "association", "id")
        listener.set_parameter("tracker", "association_distance", 0.2)
    rejections = 2 if association == "id" else 0
    for name, y in zip(names, (-0.15, 0.15), strict=True):
        assert found[name].pose.pose.position.y == pytest.approx(y, abs=0.01)
        assert found[name].rejections == rejections


def test_detections_are_tracked(camera, listener):
    messages = pytest.importorskip("vision_msgs.msg", reason="needs vision_msgs, which is not on PyPI")
    camera.begin()
    publisher = listener.node.create_publisher(
        messages.Detection3DArray, "/tracker/detections", qos_profile_sensor_data
    )
    places = {
        ("can", ""): (0.0, -0.2, 0.0),
        ("can", " "): (0.0, 0.2, 0.0),
        ("mug", "mug of Ann"): (1.0, 0.0, 0.0),
    }
    for k in range(4):
        array = messages.Detection3DArray()
        array.header.stamp, array.header.frame_id = camera.stamp(k * PERIOD), "world"
        for (model, name), place in sorted(places.items(), reverse=bool(k % 2)):
            own = messages.Detection3D(id=name.strip())
            best = messages.ObjectHypothesisWithPose()
            best.hypothesis.class_id, best.hypothesis.score = model, 0.9
            best.pose = measured(place, STD, TURN_STD)
            own.results = [best]
            array.detections = [*array.detections, own]
        found = camera.answer_of(k * PERIOD, lambda array=array: publisher.publish(array))
    assert not found.skipped
    ys = {own.id: own.pose.pose.position.y for own in found.objects}
    assert list(ys) == ["mug of Ann", "can_1", "can_2"]  # a can without an id needs a second detection
    assert sorted([ys["can_1"], ys["can_2"]]) == pytest.approx([-0.2, 0.2], abs=0.01)


def stand(camera):
    """Observe a box that stands on the table."""
    camera.begin()
    for k in range(6):
        message = camera.see(k * PERIOD, "box", (0.0, 0.0, 0.0))
    return message


def test_the_newest_belief_is_predicted(camera, listener):
    with Inbox(listener, Prediction, "/tracker/predictions") as inbox:
        # the newest belief alone is predicted, and none before the topic is connected
        message = inbox.answer(
            lambda: stand(camera), lambda found: found.header.stamp == camera.stamp(5 * PERIOD)
        )
    (own,) = message.objects
    assert [seconds(state.time_from_start) for state in own.states] == pytest.approx(HORIZONS)
    valid = nanoseconds(message.valid_until) - nanoseconds(message.header.stamp)
    assert valid == pytest.approx(1e9 * HORIZONS[-1], abs=1e3)
    assert position_of(own.states[-1].pose.pose) == pytest.approx([0.0, 0.0, 0.0], abs=0.005)


#: Place of a box that a brick has pushed: the path's end, and both half lengths [m].
PUSHED = -0.05 + 0.120 + 0.039


def push(name="hand"):
    """A brick that moves along x, towards the box and beyond, in half a second."""
    action = Action(type=Action.TRAJECTORY, object=name)
    points = []
    for t, x in ((0.0, -0.25), (0.5, -0.05)):
        place = Transform()
        place.translation.x, place.translation.z = x, 0.01
        points.append(MultiDOFJointTrajectoryPoint(transforms=[place], time_from_start=duration(t)))
    action.trajectory.points = points
    return ObjectState(id=name, model="brick", kind=ObjectState.PRESCRIBED), action


def fork(listener, **fields):
    answer = listener.call(Fork, "/tracker/fork", Fork.Request(**fields))
    assert answer.result.error_code == ErrorCode.NONE, answer.result.error_msg
    return answer


def test_a_fork_answers_what_if(camera, listener):
    last = stand(camera)
    around = BoxRegion(id="here")
    around.size.x = around.size.y = around.size.z = 0.15
    asked = {"horizon": duration(0.6), "return_probabilities": True, "regions": [around]}
    alone = fork(listener, **asked)
    hand, action = push()
    pushed = fork(listener, **asked, objects=[hand], actions=[action])
    again = fork(listener, **asked)
    assert alone.prediction.header.stamp == last.header.stamp
    assert [own.id for own in pushed.prediction.objects] == ["box", "hand"]
    x = [answer.prediction.objects[0].states[-1].pose.pose.position.x for answer in (alone, pushed, again)]
    assert abs(x[0]) < 0.005 and x[0] == x[2]  # the tracker has not changed
    assert x[1] == pytest.approx(PUSHED, abs=0.02)
    inside = [
        [one.probability for one in answer.prediction.events if one.kind == Event.IN_REGION]
        for answer in (alone, pushed)
    ]
    assert inside == [[1.0], [0.0]]
    touches = {
        frozenset((one.object, one.other)): one.probability
        for one in pushed.prediction.events
        if one.kind == Event.TOUCHES
    }
    assert touches[frozenset(("box", "hand"))] == 1.0
    assert [own.id for own in pushed.scene.objects] == ["box", "hand"] and len(pushed.actions) == 1


def act(publisher, message, fork):
    """Publish what the robot does until the node has heard of it; repetitions have no effect."""

    def is_known():
        publisher.publish(message)
        return len(fork().prediction.objects) == 2

    wait_until(is_known)


def test_what_the_robot_does_moves_what_it_pushes(camera, listener):
    stand(camera)
    publisher = listener.node.create_publisher(ActionArray, "/tracker/robot_motion", 10)
    hand, action = push()
    message = ActionArray(objects=[hand], actions=[action])
    message.header.stamp = camera.stamp(5 * PERIOD)
    act(publisher, message, lambda: fork(listener))
    x = fork(listener, horizon=duration(0.6)).prediction.objects[0].states[-1].pose.pose.position.x
    assert x == pytest.approx(PUSHED, abs=0.02)
    action.type = Action.WRENCH
    publisher.publish(message)
    (reason,) = camera.see_until_skipped(6 * PERIOD, "box", (0.0, 0.0, 0.0)).skipped
    assert reason.key == "~/robot_motion" and "trajectory" in reason.value.lower()


@pytest.fixture(scope="module")
def planner(camera):
    """A client of the node whose topic of tracked objects is connected."""
    with PythonClient(server="/tracker", timeout=READY_TIMEOUT) as made, ThreadPoolExecutor() as pool:
        found = pool.submit(made.tracked)
        while not found.done():
            stand(camera)
        yield made


def test_the_client_has_the_tracked_objects(camera, planner):
    last = stand(camera)
    found = planner.tracked(after=seconds_of(last) - 1e-6)
    assert found == last
    poses, covariances = poses_of(found)["box"]
    assert poses == pytest.approx(np.array([[0, 0, 0, 0, 0, 0, 1]]), abs=0.005)
    np.testing.assert_array_equal(covariances, [np.reshape(last.objects[0].pose.covariance, (6, 6))])
    stable = planner.assess_stability("box")
    assert stable.probability == 1.0 and stable.supports == ["table"] and stable.has_margin
    planner.reset(["box"])
    for ask in (lambda: planner.fork(horizon=0.1), lambda: planner.assess_stability("box")):
        with pytest.raises(InvalidRequestError, match="holds no objects"):
            ask()
    with pytest.raises(InvalidRequestError, match="is no tracked object") as caught:
        planner.reset(["box"])
    assert caught.value.field == "ids[0]"


def test_the_scene_of_a_fork_can_be_predicted_again(camera, listener, planner):
    """With the rest of the path of a hand without a model, which began before the fork."""
    stand(camera)
    hand, action = push("finger")
    hand.model, hand.scale = "", 0.5
    hand.primitive = SolidPrimitive(type=SolidPrimitive.BOX, dimensions=[0.48, 0.23, 0.14])
    publisher = listener.node.create_publisher(ActionArray, "/tracker/robot_motion", 10)
    message = ActionArray(objects=[hand], actions=[action])
    message.header.stamp = camera.stamp(5 * PERIOD)
    act(publisher, message, planner.fork)
    for k in range(6, 12):  # 0.2 s later the hand has moved by 8 cm, and not yet touched the box
        camera.see(k * PERIOD, "box", (0.0, 0.0, 0.0))
    answer = planner.fork(horizon=0.4)
    box, finger = answer.scene.objects
    assert (box.model, finger.kind, finger.primitive) == ("salt_box", ObjectState.PRESCRIBED, hand.primitive)
    times = [seconds(point.time_from_start) for point in answer.actions[0].trajectory.points]
    assert times == pytest.approx([0.0, 0.3], abs=1e-6)
    request = make_message(
        PredictionRequest,
        scene=answer.scene,
        actions=answer.actions,
        horizon=0.4,
        propagator="monte_carlo",
        samples=64,
    )
    again, forked = poses_of(planner.predict(request)), poses_of(answer.prediction)
    assert again["finger"][0] == pytest.approx(forked["finger"][0], abs=1e-6)
    assert again["box"][0][0, 0] == pytest.approx(forked["box"][0][0, 0], abs=0.01)
    for k in range(12, 24):  # until the path has ended
        camera.see(k * PERIOD, "box", (0.2, 0.0, 0.0))
    answer = planner.fork(horizon=0.1)
    assert answer.scene.objects[1].kind == ObjectState.FIXED and not answer.actions


def test_the_example_follows_a_covered_can():
    parameters = {
        "track": "true",
        "environment": ROOT / "examples" / "scenes" / "push_box.yaml",
        "observed_objects": "[can]",
        "max_input_age": 20.0,  # on a slow machine
        "warm_up": [""],
    }
    with NodeProcess(name="follower", **parameters) as process:
        program = [sys.executable, str(ROOT / "examples" / "track_objects.py"), "/follower"]
        done = subprocess.run(program, check=False, capture_output=True, text=True, timeout=READY_TIMEOUT)
        process.end()
    assert done.returncode == 0, done.stderr
    place = r"\((-?[\d.]+), (-?[\d.]+), (-?[\d.]+)\) m"
    (x, y, _), speed = re.findall(place, done.stdout)[0], float(re.findall(r"([\d.]+) m/s", done.stdout)[0])
    fallen = float(x) / 0.2  # since when [s]; a slow node's first answer may be of a time after the landing
    assert fallen > 0.2 and abs(float(y)) < 0.03
    assert fallen > 0.4 or speed == pytest.approx(9.81 * fallen, abs=0.8)
    # the model's origin is in the middle of the can's bottom: on the table, or a radius above it
    height = float(re.findall(place, done.stdout)[1][2])
    assert -0.01 < height < 0.05
    assert float(re.findall(r"at rest then: ([\d.]+)", done.stdout)[0]) > 0.2


def test_the_start_warns_about_what_cannot_be_tracked(node):
    assert "before the node's environment is set" not in node.output  # a file has set it
    parameters = {
        "track": "true",
        "observed_objects": "[can, cup=mug]",
        "symmetric_models": "[cann]",
        "warm_up": [""],
    }
    with NodeProcess(name="careless", **parameters) as process:
        before = process.output.partition("]: ready")[0]
    assert "parameter symmetric_models: 'cann' is no model; did you mean 'can'?" in before
    assert "nothing is tracked before the node's environment is set" in before
    has_detections = importlib.util.find_spec("vision_msgs") is not None
    assert ("vision_msgs is not installed" in before) is not has_detections


def test_diagnostics_count_observations(camera, listener):
    with Inbox(listener, DiagnosticArray, "/diagnostics") as inbox:
        camera.begin()
        _, before = inbox.status("tracker: tracking")
        sent = fall()
        for k in (0, 1, 2, 4, 3, 3):
            camera.see(*sent[k])

        def counted(name, values):
            return int(values[name]) - int(before[name])

        _, values = inbox.status(
            "tracker: tracking", lambda values: counted("observations", values) >= 6
        )  # an older status may come first
    assert values["objects"] == "1"
    assert counted("late observations", values) >= 1 and counted("duplicate observations", values) == 1
