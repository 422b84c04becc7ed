"""Rate and latency of the node: streams of detections at 10 Hz, and calls of its service."""

from __future__ import annotations

import time

import numpy as np

from ..jobs import Job, Outcome, Row, Settings
from ..results import Results
from ..served_scenes import BIN, BOX, TABLE, cpu_time, scene_message, served, wait_until
from ..served_scenes import missing_ros as missing
from ..tables import number

TITLE = "Latency of the node"
NODE = "measured"
RATE = 10.0  # Hz, of the input
CPU = "CPU time"
STREAM, STANDING, SERVICE = "stream, velocities unknown", "stream, at rest", "service"
#: Streams: objects, and the goal of the 95 % latency [ms].
STREAMS = (1, 60.0), (5, 100.0), (10, 200.0)
#: Service: kind, objects, goal of the median latency [ms], number of calls.
SERVICES = (BOX, 1, 20.0, 60), (TABLE, 5, 60.0, 60), (BIN, 10, 400.0, 5)
_HORIZON = 1.0  # s, of the service's requests


def jobs(settings: Settings) -> list[Job]:
    """Return jobs for a stream of each number of objects, and for requests of each scene."""
    seconds = 4.0 if settings.quick else 20.0
    parts = [
        {"by": by, "scene": TABLE, "objects": count, "amount": seconds}
        for by in (STREAM, STANDING)
        for count, _ in STREAMS
    ]
    parts += [
        {
            "by": SERVICE,
            "scene": kind,
            "objects": count,
            "amount": min(calls, 10) if settings.quick else calls,
        }
        for kind, count, _, calls in SERVICES
    ]
    return [Job("latency", settings.parameters(**part), cost=30.0, alone=True) for part in parts]


def run(job: Job) -> Outcome:
    """Return latencies of one scene, from the input's stamp or the call to the answer."""
    if missing():
        return Outcome([])
    p, rng = job.parameters, np.random.default_rng(job.seed("errors of poses"))

    def make():
        return scene_message(str(p["scene"]), int(p["objects"]), rng, at_rest=p["by"] == STANDING)

    with served(NODE, {}) as (node, pid):
        if p["by"] == SERVICE:
            latencies, spent = _calls(make, int(p["amount"]), pid)
            return Outcome(_rows(latencies, spent))
        latencies, rate, spent = _stream(node, make, float(p["amount"]), pid)
    return Outcome([*_rows(latencies, spent), Row("node", "rate", "Hz", rate)])


def _rows(latencies, spent):
    """Return quantiles of latencies, and the CPU time of a prediction; that of all threads."""
    quantiles = {"p50": 0.5, "p95": 0.95}
    found = [
        Row(
            "node",
            f"latency {name}",
            "ms",
            1e3 * float(np.quantile(latencies, share)) if latencies else np.inf,
        )
        for name, share in quantiles.items()
    ]
    return [*found, Row("node", CPU, "ms", 1e3 * spent / max(len(latencies), 1))]


def _calls(make, count, pid):
    """Return latencies of calls and the node's CPU time [s], after two calls that are not counted."""
    from unc_physics.ros.client import Client, make_message
    from unc_physics_msgs.msg import PredictionRequest

    latencies, before = [], 0.0
    with Client(f"/{NODE}") as client:
        for k in range(count + 2):
            if k == 2:
                before = cpu_time(pid)
            request = make_message(PredictionRequest, scene=make(), horizon=_HORIZON)
            began = time.perf_counter()
            client.predict(request)
            latencies.append(time.perf_counter() - began)
    return latencies[2:], cpu_time(pid) - before


def _stream(node, make, seconds, pid):
    """Return latencies [s], rate [Hz] and the node's CPU time [s], after a second that is not counted."""
    from rclpy.qos import qos_profile_sensor_data

    from unc_physics_msgs.msg import Prediction, Scene

    received = []
    publisher = node.create_publisher(Scene, f"/{NODE}/scene", qos_profile_sensor_data)
    subscription = node.create_subscription(
        Prediction,
        f"/{NODE}/predictions",
        lambda message: received.append((time.time(), message.header.stamp)),
        10,
    )
    wait_until(lambda: publisher.get_subscription_count() and subscription.get_publisher_count())
    sent, before = {}, 0.0
    began = time.perf_counter()
    for k in range(round((1.0 + seconds) * RATE)):
        scene = make()
        time.sleep(max(0.0, began + k / RATE - time.perf_counter()))
        if k == round(RATE):
            before = cpu_time(pid)
        now = time.time()
        scene.header.stamp.sec, scene.header.stamp.nanosec = int(now), int(1e9 * (now % 1.0))
        sent[scene.header.stamp.sec, scene.header.stamp.nanosec] = now, k >= RATE
        publisher.publish(scene)
    time.sleep(2.0)
    spent, latencies = cpu_time(pid) - before, []
    for arrived, stamp in received:
        at, counts = sent[stamp.sec, stamp.nanosec]
        if counts:
            latencies.append(arrived - at)
    return latencies, len(latencies) / seconds, spent


def report(results: Results) -> str:
    """Return a table of rates and latencies."""
    head, *lines = _lines(results)
    return results.table("node_latency", head, lines)


def _lines(results):
    """Return the rows of one table of streams and calls, its head first."""
    rows = results.rows("latency")
    yield [
        "input",
        "objects",
        "output [Hz]",
        "median latency [ms]",
        "95 % latency [ms]",
        "goal [ms]",
        "CPU time [ms]",
    ]
    cases = [
        (by, TABLE, count, f"{latency:g} (95 %)") for by in (STREAM, STANDING) for count, latency in STREAMS
    ]
    cases += [(SERVICE, kind, count, f"{goal:g} (median)") for kind, count, goal, _ in SERVICES]
    for by, kind, count, goal in cases:
        found = rows.where(by=by, scene=kind, objects=count)
        of = [found.where(quantity=q) for q in ("rate", "latency p50", "latency p95", CPU)]
        rate, p50, p95, spent = (number(one.median()) if one else "" for one in of)
        name = by if by != SERVICE else f"service, {kind}"
        yield [name, str(count), rate, p50, p95, goal, spent]
