"""Random and malformed requests against a running node: ``python test/ros/soak.py`` (``make soak``).

Every request must be answered, nothing that is not finite may come back, the node's memory must stay flat,
and a good request must be answered at the end as at the beginning.
"""

import argparse
import os
import random
import sys
import time
from array import array

os.environ.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))
os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")

import numpy as np
from builtin_interfaces.msg import Duration
from diagnostic_msgs.msg import KeyValue
from geometry_msgs.msg import Vector3
from rclpy.qos import qos_profile_sensor_data
from running import Client, Inbox, NodeProcess, result_of
from scenes import assert_answered, assert_same, check_numbers, explicit, good_request, moving_object, packed
from shape_msgs.msg import Mesh, Plane, SolidPrimitive

from unc_physics import PROPAGATORS
from unc_physics.checks.errors import ErrorCode
from unc_physics_msgs.msg import (
    Action,
    BoxRegion,
    Candidate,
    EnvironmentElement,
    Event,
    JointCovariance,
    Prediction,
    Scene,
)
from unc_physics_msgs.srv import Predict, PredictCandidates

NODE = "soaked"
IN_FLIGHT = 4
WARM_UP_SHARE = 0.25
GROWTH_LIMIT = 20.0  # MB
LIMITS = {"max_horizon": 5.0, "max_computation_time": 0.2, "max_memory": 16.0}

_NUMBERS = """
0 -0 1 -1 0.5 1e-3 1e3 -1e6 1e-300 5e-324 1e154 1e300 1.8e308 -1e308 nan inf -inf
"""
_WORDS = """
left right world bunny pin can camera sigma_points monte_carlo surrogate linearization local_sampling
null ../../etc/passwd /dev/zero %s%n{} 1e-3 .nan { 7 dt gravity stiffness points full samples
"""
NUMBERS = [float(text) for text in _NUMBERS.split()]
TEXTS = ["", "Ünïcödé 🐇", "兎" * 50, "a" * 5000, "\n\t", "[0, 0, -9.81]", *_WORDS.split()]
INTEGERS = [0, 1, 2, 7, 20, 100, 2**31 - 1, 2**32 - 1]
PARTS = [
    lambda: moving_object("left"),
    lambda: moving_object("other", "pin"),
    lambda: BoxRegion(id="bin"),
    lambda: EnvironmentElement(plane=Plane(coef=[0.0, 0.0, 1.0, 2.0])),
    lambda: JointCovariance(object_ids=["left"], data=packed(np.eye(12))),
    lambda: Action(type=Action.WRENCH, object="left"),
    Mesh,
    Vector3,
    Duration,
    lambda: Event(kind=Event.AT_REST, object="left"),
    Plane,
    SolidPrimitive,
    lambda: KeyValue(key="points", value="full"),
    lambda: Candidate(id="c"),
]


def spoil(message, rng, depth=0):
    """Change a field of a message, or of one of its parts, into something that may make no sense."""
    name, kind = rng.choice(list(message.get_fields_and_field_types().items()))
    value = getattr(message, name)
    if hasattr(value, "get_fields_and_field_types"):
        spoil(value, rng, depth + 1)
    elif isinstance(value, np.ndarray):
        value = value.copy()
        value[rng.randrange(len(value))] = rng.choice(NUMBERS)
        setattr(message, name, value)
    elif isinstance(value, (list, array)):
        spoil_list(value, kind, rng, depth)
    elif isinstance(value, bool):
        setattr(message, name, not value)
    elif isinstance(value, float):
        setattr(message, name, rng.choice(NUMBERS))
    elif isinstance(value, str):
        setattr(message, name, rng.choice(TEXTS))
    elif isinstance(value, int):
        limit = 2**8 - 1 if "8" in kind else 2**31 - 1
        setattr(message, name, min(rng.choice(INTEGERS), limit))


def spoil_list(values, kind, rng, depth):
    """Change an entry of a list, or add, double or remove one; optional fields keep at most one."""
    element, _, bound = kind.removeprefix("sequence<").removesuffix(">").partition(", ")
    full = bool(bound) and len(values) >= int(bound)
    if element in _PLAIN:
        if full:
            values.pop()
        else:
            values.append(_PLAIN[element](rng))
        return
    if values and rng.random() < 0.7 and hasattr(values[0], "get_fields_and_field_types"):
        spoil(rng.choice(values), rng, depth + 1)
        return
    fitting = [part for part in (make() for make in PARTS) if element == _type_name(part) and not full]
    if fitting and rng.random() < 0.5:
        values.append(fitting[0])
    elif values and not full and rng.random() < 0.3:
        values.append(values[0])
    elif values:
        values.pop(rng.randrange(len(values)))


_PLAIN = {
    "string": lambda rng: rng.choice(TEXTS),
    "double": lambda rng: rng.choice(NUMBERS),
    "boolean": lambda rng: rng.random() < 0.5,
}


def _type_name(message):
    package, *_ = type(message).__module__.split(".")
    return f"{package}/{type(message).__name__}"


def kinds_of_requests():
    """A request for each propagator, integrator and kind of answer that has kernels of its own."""
    for propagator in PROPAGATORS:
        for of_kind in (explicit, lambda request: request):
            for mass_std in (0.0, 0.1):
                request = good_request(horizon=0.1, return_probabilities=True, propagator=propagator)
                request.scene.objects[0].mass_std = mass_std
                yield of_kind(request)


def spoiled(rng):
    """A service's type and name, and a request with a few things changed."""
    base = good_request(
        horizon=0.3, return_samples=rng.choice([0, 0, 5]), trajectory_period=rng.choice([0.0, 0.1])
    )
    if rng.random() < 0.1:
        kind, name = PredictCandidates, "predict_candidates"
        candidates = [Candidate(id="a", objects=[moving_object("left")])]
        request = PredictCandidates.Request(request=base, candidates=candidates)
    else:
        kind, name, request = Predict, "predict", Predict.Request(request=base)
    for _ in range(rng.choice([0, 1, 1, 2, 3, 10])):
        spoil(request, rng)
    return kind, f"/{NODE}/{name}", request


def check(response):
    """An answer has a known code, a reason where it is an error, and finite numbers only."""
    code, reason = ErrorCode(response.result.error_code), response.result.error_msg
    assert code != ErrorCode.INTERNAL, reason
    assert bool(code) == bool(reason)
    for entry in getattr(response, "predictions", [response]):
        check_numbers(entry.prediction)
    return code.name


def memory(process):
    """Resident memory of a process [MB]."""
    with open(f"/proc/{process.pid}/status") as file:
        return next(int(line.split()[1]) / 1024.0 for line in file if line.startswith("VmRSS"))


def soak(duration, requests, seed, report=lambda text: None):
    """Send requests until both the duration [s] and their number are reached; memory growth [MB] and counts
    by code.
    """
    rng = random.Random(seed)
    log = "--log-level", "error", "--log-level", f"{NODE}:=info"
    with NodeProcess(*log, name=NODE, zero_covariance="exact", **LIMITS) as node, Client() as client:

        def checked(future):
            try:
                return check(result_of(future))
            except AssertionError:
                print(node.output, file=sys.stderr)
                raise

        def good_answer():
            response = client.predict(good_request(seed=1), node=NODE)
            assert_answered(response)
            return response

        before = good_answer()
        for request in kinds_of_requests():  # what is loaded for each stays in memory
            assert client.predict(request, node=NODE).result.error_code != ErrorCode.INTERNAL
        stream = client.node.create_publisher(Scene, f"/{NODE}/scene", qos_profile_sensor_data)
        started = reported = time.monotonic()
        sent, counts, warm = 0, {}, None
        waiting = []
        with Inbox(client, Prediction, f"/{NODE}/predictions") as predictions:
            while time.monotonic() - started < duration or sent < requests:
                waiting.append(client.start(*spoiled(rng)))
                sent += 1
                if sent % 10 == 0:
                    scene = Scene(objects=good_request().scene.objects)
                    spoil(scene, rng)
                    stream.publish(scene)
                if len(waiting) >= IN_FLIGHT:
                    code = checked(waiting.pop(0))
                    counts[code] = counts.get(code, 0) + 1
                for prediction in predictions.all():
                    check_numbers(prediction)
                elapsed = time.monotonic() - started
                if warm is None and elapsed > WARM_UP_SHARE * duration and sent > WARM_UP_SHARE * requests:
                    warm = memory(node.process)
                if time.monotonic() - reported > 10.0:
                    reported = time.monotonic()
                    report(f"{elapsed:5.0f} s, {sent} requests, {memory(node.process):.1f} MB")
            for future in waiting:
                code = checked(future)
                counts[code] = counts.get(code, 0) + 1
        assert_same(good_answer(), before)
        growth = memory(node.process) - warm
        assert node.end() == 0
        assert "Traceback" not in node.output, node.output
    return growth, counts


def main():
    """Soak, and print what was found."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--duration", type=float, default=600.0, metavar="S", help="at least so long [s] (default 600)"
    )
    parser.add_argument("--requests", type=int, default=10_000, help="at least so many (default 10000)")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    growth, counts = soak(
        options.duration, options.requests, options.seed, lambda text: print(text, flush=True)
    )
    for code, count in sorted(counts.items(), key=lambda item: -item[1]):
        print(f"{count:8} {code}")
    print(
        f"all {sum(counts.values())} answered, nothing but finite numbers; memory grew by {growth:.1f} MB"
        " after warm-up"
    )
    return growth > GROWTH_LIMIT


if __name__ == "__main__":
    sys.exit(main())
