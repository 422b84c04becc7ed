"""Latency of the node beside an empty service's: two processes on this machine, over Fast DDS.

The node is in one process, the client in this one, and each empty service in one of its own. Every request is
another one: poses and covariances change a little.
"""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
os.environ.setdefault("ROS_DOMAIN_ID", str(101 + os.getpid() % 100))

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.action import ActionClient
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.qos import qos_profile_sensor_data
from std_srvs.srv import Empty

from unc_physics.checks.errors import UncPhysicsError
from unc_physics.propagators.names import REFERENCE
from unc_physics.propagators.registry import PROPAGATORS
from unc_physics.ros.messages.fields import duration, seconds
from unc_physics.ros.node import Spinning, leave, main
from unc_physics_evaluation.jobs import Row
from unc_physics_msgs.action import PredictLong
from unc_physics_msgs.msg import (
    ObjectState,
    PredictedObject,
    PredictedState,
    Prediction,
    PredictionRequest,
    Scene,
)
from unc_physics_msgs.srv import Predict

WARM_UP = 30
READY_TIMEOUT = 900.0  # s, kernels are compiled first
STREAM_RATE = 30.0  # Hz
LOOK = 0.5  # s
PR_SET_PDEATHSIG = 1
CANCELS = 5
KINDS = ("spin", "own")  # empty services: on the executor of rclpy.spin, as most nodes are, and on the node's
NODE = (
    "integrator:=explicit",  # which all propagators run on
    "friction:=0.0",
    "restitution:=1.0",
    "zero_covariance:=exact",
    "gravity:=[0.0, 0.0, 0.0]",
    "dt:=0.01",
    "stiffness:=1e5",
    "horizons:=[0.2, 0.5, 1.0, 2.0]",
)


def measure(calls: int, length: float) -> list[Row]:
    """Round trips of so many calls of each service, cancels, and a stream of that length [s].

    Raises
    ------
    UncPhysicsError
        If the node is not ready in time, or answers with an error.
    """
    started = time.perf_counter()
    parameters = [part for parameter in NODE for part in ("-p", parameter)]
    node = ["node", "--ros-args", "--log-level", "warn", *parameters]
    with processes([node, *([kind] for kind in KINDS)]) as running, spinning_client() as (client, executor):
        predict = client.create_client(Predict, "/unc_physics/predict")
        until_ready(predict, running[0])
        return [
            Row("node", "start", "s", time.perf_counter() - started),
            *services(client, predict, calls),
            *messages(client, calls),
            *cancel(client, executor),
            *stream(client, length),
        ]


def until_ready(predict, node: subprocess.Popen) -> None:
    """Wait for the service of a node that was just started; `UncPhysicsError` if it does not come."""
    started = time.perf_counter()
    while not predict.wait_for_service(1.0):
        if node.poll() is not None or time.perf_counter() - started > READY_TIMEOUT:
            raise UncPhysicsError("the node ended, or was not ready in time")


@contextmanager
def processes(commands) -> Iterator[list[subprocess.Popen]]:
    """Run this file in processes of their own, which end when this one does."""
    module = [sys.executable, "-m", "unc_physics_evaluation.node_latency", str(os.getpid())]
    running = [subprocess.Popen([*module, *command]) for command in commands]
    try:
        yield running
    finally:
        for process in running:
            process.terminate()
        for process in running:
            process.wait()


@contextmanager
def spinning_client() -> Iterator[tuple]:
    """A node and its executor, which spins in a thread."""
    rclpy.init(signal_handler_options=rclpy.SignalHandlerOptions.NO)
    client = rclpy.create_node("latency_client")
    executor = SingleThreadedExecutor()
    executor.add_node(client)
    thread = threading.Thread(target=spin, args=(executor,), daemon=True)
    thread.start()
    try:
        yield client, executor
    finally:
        executor.shutdown()
        rclpy.try_shutdown()
        thread.join()


def spin(executor):
    """Spin until the end."""
    try:
        executor.spin()
    except ExternalShutdownException:
        pass


def serve_empty(kind: str) -> None:
    """A node with nothing but an empty service, and one that answers without calculating, until SIGTERM."""
    rclpy.init()
    node = rclpy.create_node(f"empty_{kind}")
    node.create_service(Empty, "~/call", lambda _, response: response)
    node.create_service(Predict, "~/canned", lambda request, _: canned_answer(request))
    try:
        if kind == "own":
            spinning = Spinning(node)
            while rclpy.ok():
                time.sleep(LOOK)
            spinning.end()
        else:
            rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    leave(0)


def canned_answer(request):
    """An answer to a request that nothing was calculated for."""
    response = Predict.Response()
    response.prediction.objects = [
        PredictedObject(id=message.id, states=[PredictedState()]) for message in request.request.scene.objects
    ]
    return response


def moving(name, x, speed, spheres):
    """A bunny on the x axis, with an uncertain position."""
    message = ObjectState(id=name, model="bunny", mass=1.0, spheres=spheres)
    message.pose.pose.position.x = x
    message.pose.pose.orientation.w = 1.0
    message.twist.twist.linear.x = speed
    message.pose.covariance = np.diag([1e-4] * 3 + [0.0] * 3).ravel()
    return message


def request_of(propagator):
    """Two objects of 100 spheres that collide within a second."""
    request = PredictionRequest(
        scene=Scene(objects=[moving("left", -0.2, 0.5, 100), moving("right", 0.2, -0.5, 100)]),
        horizon=duration(1.0),
        propagator=propagator,
        seed=1,
    )
    if propagator == REFERENCE:
        request.samples = 100
    return request


def another(request, rng):
    """Change the poses and covariances of a request a little, as a tracker does."""
    for message in request.scene.objects:
        message.pose.pose.position.y = 1e-4 * rng.standard_normal()
        message.pose.covariance = np.diag([1e-4 * rng.uniform(0.9, 1.1)] * 3 + [0.0] * 3).ravel()


def services(client, predict, calls) -> list[Row]:
    """Round trips of empty services and, alternating with them, of each propagator's prediction."""
    empty = [client.create_client(Empty, f"/empty_{kind}/call") for kind in KINDS]
    for service in empty:
        service.wait_for_service(READY_TIMEOUT)
    rng = np.random.default_rng(1)
    rows = []
    for propagator in PROPAGATORS:
        request = request_of(propagator)
        trips, cores, empties = [], [], []
        for _ in range(WARM_UP + calls):
            another(request, rng)
            empties.append([round_trip(service, Empty.Request())[0] for service in empty])
            took, answer = round_trip(predict, Predict.Request(request=request))
            trips.append(took)
            cores.append(seconds(answer.prediction.computation_time))
            if answer.result.error_code:
                raise UncPhysicsError(answer.result.error_msg)
        found = {
            "round_trip": np.median(trips[WARM_UP:]),
            "round_trip_p99": np.percentile(trips[WARM_UP:], 99),
            "core": np.median(cores[WARM_UP:]),
            "over_core": np.median(np.subtract(trips, cores)[WARM_UP:]),
            **dict(zip(KINDS, np.median(empties[WARM_UP:], axis=0), strict=True)),
        }
        rows += [Row(propagator, quantity, "s", float(value)) for quantity, value in found.items()]
    return rows


def messages(client, calls) -> list[Row]:
    """Round trips of the messages of ``~/predict`` to services that calculate nothing."""
    request, rows = Predict.Request(request=request_of("surrogate")), []
    for kind in KINDS:
        service = client.create_client(Predict, f"/empty_{kind}/canned")
        service.wait_for_service(READY_TIMEOUT)
        trips = [round_trip(service, request)[0] for _ in range(WARM_UP + calls)]
        rows.append(Row("messages", kind, "s", float(np.median(trips[WARM_UP:]))))
    return rows


def round_trip(service, request):
    """The time that a call takes [s], and its answer."""
    started = time.perf_counter()
    answer = service.call(request)
    return time.perf_counter() - started, answer


def cancel(client, executor) -> list[Row]:
    """Time until a cancel request of a long Monte Carlo run is answered, and until its result is there."""
    action = ActionClient(client, PredictLong, "/unc_physics/predict_long")
    action.wait_for_server(READY_TIMEOUT)
    goal = PredictLong.Goal(request=request_of(REFERENCE))
    goal.request.samples, goal.request.horizon = 20_000, duration(60.0)
    answers, results = [], []
    for _ in range(CANCELS):
        # by the thread that spins: rclpy drops an answer that comes before the call has returned
        handle = wait_for(wait_for(executor.create_task(lambda: action.send_goal_async(goal))))
        result = wait_for(executor.create_task(handle.get_result_async))
        time.sleep(0.5)
        started = time.perf_counter()
        wait_for(wait_for(executor.create_task(handle.cancel_goal_async)))
        answers.append(time.perf_counter() - started)
        wait_for(result)
        results.append(time.perf_counter() - started)
    action.destroy()
    return [
        Row("cancel", quantity, "s", took, None, k)
        for quantity, times in (("answer", answers), ("result", results))
        for k, took in enumerate(times)
    ]


def wait_for(future):
    """The result of a future that another thread completes."""
    done = threading.Event()
    future.add_done_callback(lambda _: done.set())
    done.wait(READY_TIMEOUT)
    return future.result()


def stream(client, length) -> list[Row]:
    """Predictions of ten objects at 30 Hz, two of them in contact, and their delays."""
    scene = Scene(objects=[moving(str(k), 0.5 * k, 0.0, 100) for k in range(10)])
    scene.objects[1].pose.pose.position.x = 0.12
    delays, counts = [], {}
    received = threading.Semaphore(0)

    def receive(message):
        now = client.get_clock().now().nanoseconds
        delays.append(1e-9 * now - message.header.stamp.sec - 1e-9 * message.header.stamp.nanosec)
        received.release()

    def count_inputs(message):
        (status,) = message.status
        counts.update({pair.key: pair.value for pair in status.values if pair.key.endswith("inputs")})

    client.create_subscription(DiagnosticArray, "/diagnostics", count_inputs, 1)
    client.create_subscription(Prediction, "/unc_physics/predictions", receive, 10)
    publisher = client.create_publisher(Scene, "/unc_physics/scene", qos_profile_sensor_data)
    while not publisher.get_subscription_count():
        time.sleep(0.05)

    def publish():
        now = client.get_clock().now().nanoseconds
        scene.header.stamp.sec, scene.header.stamp.nanosec = divmod(now, 1_000_000_000)
        publisher.publish(scene)

    for _ in range(10):  # the first ones build the sphere trees
        publish()
        received.acquire(timeout=2.0)
    time.sleep(1.0)
    delays.clear()
    count = round(length * STREAM_RATE)
    started = time.perf_counter()
    for k in range(count):
        time.sleep(max(0.0, started + k / STREAM_RATE - time.perf_counter()))
        publish()
    time.sleep(1.5)  # the diagnostics come once a second
    found = {
        "sent": ("1", count),
        "predicted": ("1", len(delays)),
        "dropped": ("1", int(counts["dropped inputs"])),
    }
    found |= {"delay": ("s", np.median(delays)), "delay_p99": ("s", np.percentile(delays, 99))}
    return [Row("stream", quantity, unit, float(value)) for quantity, (unit, value) in found.items()]


if __name__ == "__main__":
    parent, kind = sys.argv[1:3]
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != int(parent):
        sys.exit("the process that measures has ended")
    if kind == "node":
        main(sys.argv[2:])
    else:
        serve_empty(kind)
