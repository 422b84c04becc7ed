"""Latency of the node beside an empty service's in the same run: ``python -m benchmarks.ros_latency``.

Two processes on this machine, over Fast DDS: the node in one, this client in the other. Prints round trips of an
empty service (on the node's own executor, in a process of its own), of ``~/predict`` for two objects for each
propagator beside the core's own time, whether a stream of ten objects at 30 Hz is predicted without a drop, the time
to cancel a long prediction, and the time from start to ready.
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
from rclpy.action import ActionClient
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.qos import qos_profile_sensor_data
from std_srvs.srv import Empty

from unc_physics import PROPAGATORS
from unc_physics_msgs.action import PredictLong
from unc_physics_msgs.msg import ObjectState, ObjectStateArray, Prediction
from unc_physics_msgs.srv import Predict

WARM_UP = 30
READY_TIMEOUT = 300.0  # s
STREAM_RATE = 30.0  # Hz
EMPTY_NODE = "empty_service"


def main(arguments=None) -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="benchmarks.ros_latency", description=__doc__.splitlines()[0])
    parser.add_argument("--calls", type=int, default=300, help="calls of each service (default 300)")
    parser.add_argument("--stream", type=float, default=10.0, metavar="S", help="length of the stream [s] (default 10)")
    parser.add_argument("--serve-empty", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.serve_empty:
        return serve_empty()
    started = time.perf_counter()
    node = subprocess.Popen(
        [sys.executable, "-m", "unc_physics.ros.node", "--ros-args", "--log-level", "warn", "-p", "zero_covariance:=exact",
         "-p", "gravity:=[0.0, 0.0, 0.0]", "-p", "dt:=0.01", "-p", "stiffness:=1e5", "-p", "horizons:=[0.2, 0.5, 1.0, 2.0]"])
    empty = subprocess.Popen([sys.executable, "-m", "benchmarks.ros_latency", "--serve-empty"])
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
        cancel(client, executor)
        stream(client, options.stream)
    finally:
        for process in (node, empty):
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


def serve_empty():
    """A node with nothing but an empty service, on the executor that the prediction node uses."""
    rclpy.init()
    node = rclpy.create_node(EMPTY_NODE)
    node.create_service(Empty, "~/call", lambda _, response: response)
    executor = MultiThreadedExecutor(8)
    executor.add_node(node)
    try:
        executor.spin()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    rclpy.try_shutdown()
    return 0


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
    request = Predict.Request(
        objects=[moving("left", -0.2, 0.5, 100), moving("right", 0.2, -0.5, 100)], horizon=1.0, propagator=propagator, seed=1)
    if propagator == "monte_carlo":
        request.samples = 100
    return request


def services(client, predict, calls):
    """Round trips of the empty service and, alternating with it, of each propagator's prediction."""
    empty = client.create_client(Empty, f"/{EMPTY_NODE}/call")
    empty.wait_for_service(READY_TIMEOUT)
    print(f"{'':16}{'p50':>9}{'p99':>9}{'core p50':>10}{'over core':>11}{'empty p50':>11}{'ratio':>7}   [ms]")
    for propagator in PROPAGATORS:
        request = request_of(propagator)
        trips, cores, empties = [], [], []
        for _ in range(WARM_UP + calls):
            started = time.perf_counter()
            empty.call(Empty.Request())
            between = time.perf_counter()
            answer = predict.call(request)
            trips.append(time.perf_counter() - between)
            empties.append(between - started)
            cores.append(answer.computation_time)
            if answer.error_code:
                raise RuntimeError(answer.error_msg)
        p50, p99 = 1e3 * np.percentile(trips[WARM_UP:], [50, 99])
        core, nothing = 1e3 * np.median(cores[WARM_UP:]), 1e3 * np.median(empties[WARM_UP:])
        over = 1e3 * np.median(np.subtract(trips, cores)[WARM_UP:])
        print(f"{propagator:16}{p50:9.2f}{p99:9.2f}{core:10.2f}{over:11.2f}{nothing:11.2f}{over / nothing:7.2f}")


def cancel(client, executor, repeats=5):
    """Time until a cancel request of a long Monte Carlo run is answered, and until its result is there."""
    action = ActionClient(client, PredictLong, "/unc_physics/predict_long")
    action.wait_for_server(READY_TIMEOUT)
    fields = {name: getattr(request_of("monte_carlo"), name) for name in PredictLong.Goal.get_fields_and_field_types()}
    fields |= {"samples": 20_000, "horizon": 60.0}
    answers, results = [], []
    for _ in range(repeats):
        # by the thread that spins: rclpy drops an answer that comes before the call has returned
        handle = wait_for(wait_for(executor.create_task(lambda: action.send_goal_async(PredictLong.Goal(**fields)))))
        result = wait_for(executor.create_task(handle.get_result_async))
        time.sleep(0.5)
        started = time.perf_counter()
        wait_for(wait_for(executor.create_task(handle.cancel_goal_async)))
        answers.append(time.perf_counter() - started)
        wait_for(result)
        results.append(time.perf_counter() - started)
    print(f"cancel of a run with 20 000 samples: answered after {1e3 * np.median(answers):.0f} ms (at most "
          f"{1e3 * max(answers):.0f}), result after {1e3 * np.median(results):.0f} ms (at most {1e3 * max(results):.0f})")
    action.destroy()


def wait_for(future):
    """The result of a future that another thread completes."""
    done = threading.Event()
    future.add_done_callback(lambda _: done.set())
    done.wait(READY_TIMEOUT)
    return future.result()


def stream(client, length):
    """Ten objects of 100 spheres, two of them in contact, at 30 Hz: predictions received, and their delays."""
    scene = ObjectStateArray(objects=[moving(str(k), 0.5 * k, 0.0, 100) for k in range(10)])
    scene.objects[1].pose.pose.position.x = 0.12
    delays = []
    received = threading.Semaphore(0)

    def receive(message):
        now = client.get_clock().now().nanoseconds
        delays.append(1e-9 * now - message.header.stamp.sec - 1e-9 * message.header.stamp.nanosec)
        received.release()

    subscription = client.create_subscription(Prediction, "/unc_physics/predictions", receive, 10)
    publisher = client.create_publisher(ObjectStateArray, "/unc_physics/objects", qos_profile_sensor_data)
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
    time.sleep(1.0)
    p50, p99 = 1e3 * np.percentile(delays, [50, 99])
    print(f"stream of ten objects, four horizons, surrogate, {STREAM_RATE:g} Hz: {len(delays)} of {count} predicted, "
          f"delay p50 {p50:.1f} ms, p99 {p99:.1f} ms")
    client.destroy_subscription(subscription)


if __name__ == "__main__":
    sys.exit(main())
