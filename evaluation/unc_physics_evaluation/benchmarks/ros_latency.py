"""Latency of the node beside an empty service's in the same run: ``python -m
unc_physics_evaluation.benchmarks.ros_latency``.

Two processes on this machine, over Fast DDS: the node in one, this client in the other. Prints round trips of
empty services (each in a process of its own: on the executor of ``rclpy.spin``, as most nodes are, and on the
one that the node uses), of ``~/predict`` for two objects for each propagator beside the core's own time,
whether a stream of ten objects at 30 Hz is predicted without a drop, the time to cancel a long prediction,
and the time from start to ready. Every request is another one: poses and covariances change a little.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import threading
import time

import numpy as np

os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
os.environ.setdefault("ROS_DOMAIN_ID", str(101 + os.getpid() % 100))

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.action import ActionClient
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.qos import qos_profile_sensor_data
from std_srvs.srv import Empty

from unc_physics import PROPAGATORS
from unc_physics.ros.durations import duration, seconds
from unc_physics.ros.node import leave, spin_node
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
READY_TIMEOUT = 300.0  # s
STREAM_RATE = 30.0  # Hz
EMPTY = "spin", "own"  # empty services: on the executor of rclpy.spin, and on the node's own


def main(arguments=None) -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        prog="unc_physics_evaluation.benchmarks.ros_latency", description=__doc__.splitlines()[0]
    )
    parser.add_argument("--calls", type=int, default=300, help="calls of each service (default 300)")
    parser.add_argument(
        "--stream", type=float, default=10.0, metavar="S", help="length of the stream [s] (default 10)"
    )
    parser.add_argument("--serve-empty", choices=EMPTY, help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.serve_empty:
        return serve_empty(options.serve_empty)
    started = time.perf_counter()
    node = subprocess.Popen(
        [
            sys.executable,
            "-m",
            "unc_physics.ros.node",
            "--ros-args",
            "--log-level",
            "warn",
            "-p",
            "zero_covariance:=exact",
            "-p",
            "gravity:=[0.0, 0.0, 0.0]",
            "-p",
            "dt:=0.01",
            "-p",
            "stiffness:=1e5",
            "-p",
            "horizons:=[0.2, 0.5, 1.0, 2.0]",
        ]
    )
    empty = [
        subprocess.Popen(
            [sys.executable, "-m", "unc_physics_evaluation.benchmarks.ros_latency", "--serve-empty", kind]
        )
        for kind in EMPTY
    ]
    rclpy.init()
    client = rclpy.create_node("latency_client")
    executor = SingleThreadedExecutor()
    executor.add_node(client)
    thread = threading.Thread(target=spin, args=(executor,), daemon=True)
    thread.start()
    try:
        predict = client.create_client(Predict, "/unc_physics/predict")
        ready = predict.wait_for_service(READY_TIMEOUT)
        print(f"start to ready: {time.perf_counter() - started:.1f} s")
        if not ready:
            return 1
        services(client, predict, options.calls)
        messages(client, options.calls)
        cancel(client, executor)
        stream(client, options.stream)
    finally:
        for process in (node, *empty):
            process.send_signal(signal.SIGINT)
            process.wait()
        executor.shutdown()
        rclpy.try_shutdown()
        thread.join()
    return 0


def spin(executor):
    """Spin until the end."""
    try:
        executor.spin()
    except ExternalShutdownException:
        pass


def serve_empty(kind):
    """A node with nothing but an empty service, until SIGINT."""
    rclpy.init()
    node = rclpy.create_node(f"empty_{kind}")
    node.create_service(Empty, "~/call", lambda _, response: response)
    node.create_service(Predict, "~/canned", lambda request, _: canned_answer(request))
    try:
        if kind == "own":
            spin_node(node)
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
    if propagator == "monte_carlo":
        request.samples = 100
    return request


def another(request, rng):
    """Change the poses and covariances of a request a little, as a tracker does."""
    for message in request.scene.objects:
        message.pose.pose.position.y = 1e-4 * rng.standard_normal()
        message.pose.covariance = np.diag([1e-4 * rng.uniform(0.9, 1.1)] * 3 + [0.0] * 3).ravel()


def services(client, predict, calls):
    """Round trips of empty services and, alternating with them, of each propagator's prediction."""
    empty = [client.create_client(Empty, f"/empty_{kind}/call") for kind in EMPTY]
    for service in empty:
        service.wait_for_service(READY_TIMEOUT)
    rng = np.random.default_rng(1)
    print(
        f"{'':16}{'p50':>9}{'p99':>9}{'core p50':>10}{'over core':>11}{'empty: spin':>13}{'ratio':>7}"
        f"{'own':>7}{'ratio':>7}"
        "   [ms]"
    )
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
                raise RuntimeError(answer.result.error_msg)
        p50, p99 = 1e3 * np.percentile(trips[WARM_UP:], [50, 99])
        core, (spin, own) = 1e3 * np.median(cores[WARM_UP:]), 1e3 * np.median(empties[WARM_UP:], axis=0)
        over = 1e3 * np.median(np.subtract(trips, cores)[WARM_UP:])
        print(
            f"{propagator:16}{p50:9.2f}{p99:9.2f}{core:10.2f}{over:11.2f}{spin:13.2f}{over / spin:7.2f}"
            f"{own:7.2f}{over / own:7.2f}"
        )


def messages(client, calls):
    """Round trips of services with the messages of ``~/predict`` that calculate nothing: what the messages
    alone take.
    """
    request, medians = Predict.Request(request=request_of("surrogate")), []
    for kind in EMPTY:
        service = client.create_client(Predict, f"/empty_{kind}/canned")
        service.wait_for_service(READY_TIMEOUT)
        medians.append(
            1e3 * np.median([round_trip(service, request)[0] for _ in range(WARM_UP + calls)][WARM_UP:])
        )
    print(
        f"a service with the same messages that calculates nothing: spin {medians[0]:.2f}, own"
        f" {medians[1]:.2f} ms (p50)"
    )


def round_trip(service, request):
    """The time that a call takes [s], and its answer."""
    started = time.perf_counter()
    answer = service.call(request)
    return time.perf_counter() - started, answer


def cancel(client, executor, repeats=5):
    """Time until a cancel request of a long Monte Carlo run is answered, and until its result is there."""
    action = ActionClient(client, PredictLong, "/unc_physics/predict_long")
    action.wait_for_server(READY_TIMEOUT)
    goal = PredictLong.Goal(request=request_of("monte_carlo"))
    goal.request.samples, goal.request.horizon = 20_000, duration(60.0)
    answers, results = [], []
    for _ in range(repeats):
        # by the thread that spins: rclpy drops an answer that comes before the call has returned
        handle = wait_for(wait_for(executor.create_task(lambda: action.send_goal_async(goal))))
        result = wait_for(executor.create_task(handle.get_result_async))
        time.sleep(0.5)
        started = time.perf_counter()
        wait_for(wait_for(executor.create_task(handle.cancel_goal_async)))
        answers.append(time.perf_counter() - started)
        wait_for(result)
        results.append(time.perf_counter() - started)
    print(
        f"cancel of a run with 20 000 samples: answered after {1e3 * np.median(answers):.0f} ms (at most"
        f" {1e3 * max(answers):.0f}), result after {1e3 * np.median(results):.0f} ms (at most"
        f" {1e3 * max(results):.0f})"
    )
    action.destroy()


def wait_for(future):
    """The result of a future that another thread completes."""
    done = threading.Event()
    future.add_done_callback(lambda _: done.set())
    done.wait(READY_TIMEOUT)
    return future.result()


def stream(client, length):
    """Ten objects of 100 spheres, two of them in contact, at 30 Hz: predictions received, and
    their delays.
    """
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
    p50, p99 = 1e3 * np.percentile(delays, [50, 99])
    print(
        f"stream of ten objects, four horizons, surrogate, {STREAM_RATE:g} Hz: {len(delays)} of {count}"
        f" predicted, delay p50 {p50:.1f} ms, p99 {p99:.1f} ms; of all inputs, the node counts {counts}"
    )


if __name__ == "__main__":
    sys.exit(main())
