"""The node among what runs on a robot: tf2, launch, other nodes in its process, simulated time.

What is not on PyPI is used where a machine has it; the other tests run anywhere.
"""

import signal
import sys
import threading
from pathlib import Path

import numba
import pytest
import rclpy
from geometry_msgs.msg import TransformStamped
from lifecycle_msgs.srv import GetState
from rclpy.duration import Duration
from rclpy.executors import MultiThreadedExecutor
from running import READY_TIMEOUT, Client, NodeProcess, node_in_this_process, result_of, wait_until
from scenes import assert_answered, good_request, moving_object, position_of, request_of, with_physics
from std_srvs.srv import Empty

from unc_physics.checks.errors import ErrorCode
from unc_physics.ros import server
from unc_physics_msgs.srv import Predict

LAUNCH = Path(__file__).resolve().parents[2] / "launch"
AHEAD = 0.05  # s, of a scene's stamp before the newest transform's


def test_no_variance_is_negative(predict):
    request = request_of(moving_object(), horizon=0.2, return_covariance=True)
    message = request.scene.objects[0]
    message.pose.covariance[:] = 0.0
    message.pose.covariance[35] = 0.01  # it turns about a line that is not one of its axes
    q = message.pose.pose.orientation
    q.x, q.y, q.z, q.w = 0.1, 0.7, -0.1, 0.7
    (predicted,) = predict(request).prediction.objects
    state = predicted.states[-1]
    for C in (state.pose.covariance, state.twist.covariance):
        assert min(C[::7]) >= 0.0
    assert min(state.covariance[::13]) >= 0.0


@pytest.fixture
def robot():
    """The node and a service of somebody else in one executor of this process, in a robot's namespace."""

    def other(context):
        made = rclpy.create_node("other", context=context)
        made.create_service(Empty, "/other/call", lambda _, response: response)
        return made

    options = {"namespace": "robot_1", "warm_up": [""], "zero_covariance": "exact"}
    with node_in_this_process(executor=two_threads, others=[other], **options) as node:
        yield node


def two_threads(context):
    return MultiThreadedExecutor(2, context=context)


def test_in_the_executor_of_others(robot, client, monkeypatch):
    """A request waits in its own thread."""
    name, predict, go = "robot_1/unc_physics", robot.server.predict, threading.Event()

    def held(job, *others):
        if job.scene.dt == slow.physics.dt:
            go.wait()
        return predict(job, *others)

    monkeypatch.setattr(robot.server, "predict", held)
    slow = with_physics(good_request(propagator="monte_carlo"), dt=0.005)
    waiting = client.start(Predict, f"/{name}/predict", Predict.Request(request=slow))
    try:
        client.call(Empty, "/other/call", Empty.Request())
        assert_answered(client.predict(good_request(), node=name))
        assert not waiting.done()
    finally:
        go.set()
    assert_answered(result_of(waiting))


def test_a_request_to_a_node_that_is_closing_is_answered(robot, client):
    robot.server.ending = "is shutting down"
    robot.server.pool.shutdown()
    result = client.predict(good_request(), node="robot_1/unc_physics").result
    assert result.error_code == ErrorCode.CANCELED and "is shutting down" in result.error_msg


def test_a_request_waits_for_kernels_within_its_time(robot, client, monkeypatch):
    kernel, write = numba.njit(lambda x: x + 1.0), server.write_answer

    def compiling(*arguments):
        assert kernel(1.0) == 2.0
        write(*arguments)

    monkeypatch.setattr(server, "write_answer", compiling)
    hurried = good_request(max_computation_time=1e-3)
    result = client.predict(hurried, node="robot_1/unc_physics").result
    assert result.error_code == ErrorCode.NOT_READY and "still compiles kernel" in result.error_msg
    assert_answered(client.predict(good_request(), node="robot_1/unc_physics"))


def test_a_scene_ahead_of_its_transform_waits_and_holds_up_nobody():
    tf2_ros = pytest.importorskip("tf2_ros", reason="needs tf2_ros, which is not on PyPI")
    with NodeProcess(transform_timeout=3.0, zero_covariance="exact", name="seeing"), Client() as client:
        broadcaster = tf2_ros.TransformBroadcaster(client.node)
        wait_until(lambda: broadcaster.pub_tf.get_subscription_count() == 1)

        def send(stamp):
            found = TransformStamped(child_frame_id="camera")
            found.header.frame_id, found.header.stamp = "world", stamp
            found.transform.translation.x, found.transform.rotation.w = 1.0, 1.0
            broadcaster.sendTransform(found)

        first = client.node.get_clock().now()
        request = good_request()
        request.scene.header.frame_id, request.scene.header.stamp = "camera", first.to_msg()
        for _ in range(5):  # until it has arrived
            send(first.to_msg())
            if client.predict(request, node="seeing").result.error_code == ErrorCode.NONE:
                break
        request.scene.header.stamp = (first + Duration(seconds=AHEAD)).to_msg()
        lost = good_request()
        lost.scene.header.frame_id = "nowhere"
        waiting = [
            client.start(Predict, "/seeing/predict", Predict.Request(request=one))
            for one in [request, *[lost] * 6]
        ]
        assert_answered(client.predict(good_request(), node="seeing"))
        assert not any(one.done() for one in waiting)
        send((first + Duration(seconds=2.0 * AHEAD)).to_msg())
        answer = result_of(waiting[0])
        assert_answered(answer)
        assert position_of(answer.prediction.objects[0].states[0].pose.pose)[0] > 0.5
        for one in waiting[1:]:
            error = result_of(one).result
            assert error.error_code == ErrorCode.UNKNOWN_FRAME and "within 3 s" in error.error_msg


@pytest.mark.parametrize(
    ("file", "arguments", "name"),
    [
        ("predict.launch.py", ["lifecycle:=true", "namespace:=arm"], "/arm/unc_physics"),
        ("robots.launch.py", ["robots:=left,right"], "/right/unc_physics"),
    ],
)
def test_launch_files(client, tmp_path, file, arguments, name):
    pytest.importorskip("launch_ros", reason="needs launch_ros, which is not on PyPI")
    from subprocess import PIPE, STDOUT, Popen

    from launching import prefix_with_the_package

    environment = prefix_with_the_package(tmp_path)
    starter = Path(__file__).with_name("launching.py")
    command = [sys.executable, str(starter), str(LAUNCH / file), *arguments]
    with Popen(command, env=environment, stdout=PIPE, stderr=STDOUT, text=True) as process:
        service = client.node.create_client(Predict, f"{name}/predict")
        found = service.wait_for_service(READY_TIMEOUT)
        if "lifecycle:=true" in arguments:
            state = client.call(GetState, f"{name}/get_state", GetState.Request()).current_state
            assert state.label == "active"
        answer = client.predict(good_request(), node=name.removeprefix("/"))
        process.send_signal(signal.SIGINT)  # launch leaves its nodes alone at SIGTERM
        output = process.communicate(timeout=60.0)[0]
    assert found, output
    assert output.count("process has finished cleanly") == output.count("process started with pid")
    assert_answered(answer)
    assert "Traceback" not in output
