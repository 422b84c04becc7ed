"""``python -m unc_physics.ros.demo``: a can is thrown at a carton on a table; does the carton stay upright?

A node, in a process of its own, predicts the scene by several methods. The client prints how long each took
and how far it is from many Monte Carlo samples. The picture is the library's prediction of the same scene by
the default method. The methods share the kernels of rollouts; ``--all-methods`` adds the others, which
compile for another minute.
"""

from __future__ import annotations

import argparse
import contextlib
import math
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple, TypeAlias

import numpy as np

from unc_physics_msgs.msg import Environment, Event, ObjectState, Physics, Prediction

from ..checks.errors import OutputError, UncPhysicsError
from ..compiler.compile_time import FIRST_USE
from ..prediction.predict import predict
from ..propagators.names import ANYTIME, BUILT_IN, POINTS, REFERENCE, SURFACE
from ..propagators.registry import make_propagator
from ..scene.environment import Box
from ..spatial.layout import ANGULAR_VELOCITY, POSITION, QUATERNION, VELOCITY
from ..spatial.origin import at_origin
from .client import Client, environment, make_message, object_state, poses_of, prediction_request
from .demo_scene import HORIZON, PERIOD, table_scene
from .messages.fields import seconds, writable

#: Names of methods, and their numbers of samples or None.
Methods: TypeAlias = tuple[tuple[str, int | None], ...]

NODE = "unc_physics_demo"
TRUTH = 2000  # samples
#: Methods that share the kernels of rollouts, and their numbers of samples, where these are given.
METHODS: Methods = ((ANYTIME, None), (REFERENCE, 32), (REFERENCE, 200), (SURFACE, None), (POINTS, None))
#: Methods with a time loop of their own.
OTHER_METHODS: Methods = tuple((name, None) for name in BUILT_IN if name not in dict(METHODS))
SEED, TRUTH_SEED = 1, 2
_TIMEOUT = 240.0  # s, of each call; a node that starts for the first time compiles its kernels
_END_TIMEOUT = 10.0  # s


class Answer(NamedTuple):
    """Prediction of one method, and the wall time of the service call [s]."""

    name: str
    prediction: Prediction
    wall_time: float


def main(arguments=None) -> int:
    """Run the demo; return the exit status."""
    parser = argparse.ArgumentParser(prog="unc_physics.ros.demo", description=__doc__)
    parser.add_argument(
        "--output", default="demo.png", metavar="FILE.png", help="picture to write (default demo.png)"
    )
    parser.add_argument("--all-methods", action="store_true", help="also ask the methods of the paper")
    options = parser.parse_args(arguments)
    methods = METHODS + OTHER_METHODS if options.all_methods else METHODS
    output = Path(options.output).resolve()
    if not output.parent.is_dir():
        error = OutputError("is no folder", field="--output", value=str(output.parent))
        print(f"demo: {error}", file=sys.stderr)
        return int(error.code)
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    print(f"Starting the node /{NODE}; a first start compiles for {FIRST_USE} ...", flush=True)
    with tempfile.TemporaryFile("w+") as log:
        node = subprocess.Popen(node_command(), stdout=log, stderr=subprocess.STDOUT)
        status = 1
        try:
            answers = []
            for answer in ask(methods):
                answers.append(answer)
                print(f"  {answer.name}: {1e3 * answer.wall_time:.0f} ms over ROS", flush=True)
            print(table(answers), flush=True)
            draw(output)
            print(f"Picture: {output}", flush=True)
            status = 0
        except UncPhysicsError as error:
            print(f"demo: {error}", file=sys.stderr)
        except KeyboardInterrupt:  # the node received it, too
            status = 130
        finally:
            node_status = _end(node)
        if status or node_status:
            log.seek(0)
            print(f"demo: failed; the node's log:\n{log.read()}", file=sys.stderr)
            return status or 1
    print("The node has shut down cleanly.")
    return 0


def node_command() -> list[str]:
    """Return the command line of the node, which reads zero covariances as exact.

    It compiles only what the client asks for. Its limit of computation time does not end the reference on a
    busy machine.
    """
    parameters = {"zero_covariance": "exact", "warm_up": "['']", "max_computation_time": _TIMEOUT}
    options = [part for name, value in parameters.items() for part in ("-p", f"{name}:={value}")]
    return [sys.executable, "-m", "unc_physics.ros.node", "--ros-args", "-r", f"__node:={NODE}", *options]


def table_messages() -> tuple[list[ObjectState], Environment, Physics]:
    """Return the scene of the demo as messages."""
    scene, belief = table_scene()
    objects = []
    for b, body in enumerate(scene.bodies):
        mean, P, origin = map(writable, (belief.mean[b], belief.marginal(b), body.model.origin))
        state, _, pose_covariance, twist_covariance, _ = at_origin(mean, P, origin)
        objects.append(
            object_state(
                body.name,
                body.model.name,
                [*state[POSITION], *state[QUATERNION]],
                pose_covariance.reshape(6, 6),
                twist_covariance.reshape(6, 6),
                twist=[*state[VELOCITY], *state[ANGULAR_VELOCITY]],
                spheres=len(body.model),
                at_rest=body.at_rest,
            )
        )
    boxes = {box.name: (box.size, box.position) for box in scene.environment if isinstance(box, Box)}
    physics = make_message(Physics, preset="everyday", restitution=scene.restitution)
    return objects, environment(boxes=boxes), physics


def draw(output: Path) -> None:
    """Draw the library's prediction by the default method."""
    times = (np.arange(1, round(HORIZON / PERIOD) + 1) * PERIOD).tolist()
    prediction = predict(*table_scene(), make_propagator(ANYTIME, seed=SEED), times=times)
    prediction.plot("a can is thrown at a carton").savefig(output, dpi=110, bbox_inches="tight")


def ask(methods: Methods) -> Iterator[Answer]:
    """Yield the answer of each method; the reference is last.

    Raises
    ------
    UncPhysicsError
        If the node does not answer.
    """
    objects, surroundings, physics = table_messages()
    asked = [(*method, SEED) for method in methods]
    with Client(server=f"/{NODE}", timeout=_TIMEOUT) as client:

        def predict_by(name, samples, seed, horizon):
            request = prediction_request(
                objects,
                horizon,
                surroundings,
                propagator=name,
                samples=samples or 0,
                seed=seed,
                return_probabilities=True,
                physics=physics,
            )
            return client.predict(request)

        client.capabilities()  # returns when the node is ready
        print("The node is ready. Loading or compiling kernels ...", flush=True)
        for method in asked:
            predict_by(*method, PERIOD)
        print("Predicting:", flush=True)
        for name, samples, seed in [*asked, (REFERENCE, TRUTH, TRUTH_SEED)]:
            started = time.perf_counter()
            prediction = predict_by(name, samples, seed, HORIZON)
            label = name if samples is None else f"{name}, {samples}"
            yield Answer(label, prediction, time.perf_counter() - started)


def table(answers: list[Answer]) -> str:
    """Return a table of each method's time and its distance from the last answer, the reference."""
    *methods, truth = answers
    width = max(len(answer.name) for answer in methods)
    lines = [
        f"The can's position after {HORIZON:g} s, beside {truth.name} samples, and the carton:",
        f"{'method':<{width}}  rollouts  time [ms]  as samples   error of mean, std [mm]  upright",
    ]
    exact = _mean_and_std(truth.prediction)
    for name, prediction, _ in [*methods, truth._replace(name="truth")]:
        mean, std = (
            1e3 * float(np.linalg.norm(one - other))
            for one, other in zip(_mean_and_std(prediction), exact, strict=True)
        )
        worth = f"{as_samples(prediction, truth.prediction):.0f}" if name != "truth" else ""
        (found,) = (one for one in prediction.events if (one.kind, one.object) == (Event.UPRIGHT, "carton"))
        took = 1e3 * seconds(prediction.computation_time)
        lines.append(
            f"{name:<{width}}  {prediction.rollouts:8d}  {took:9.1f}  {worth:>10}  {mean:12.1f}  {std:10.1f}"
            f"  {found.probability:.2f} ({found.low:.2f} to {found.high:.2f})"
        )
    return "\n".join(lines)


def as_samples(prediction: Prediction, truth: Prediction) -> float:
    """Return the number of Monte Carlo samples whose mean positions are as accurate.

    The squared error of a mean of n samples is on average the sum of variances over n. All bodies count.
    """
    exact, shares = poses_of(truth), []
    for name, (poses, _) in poses_of(prediction).items():
        others, covariances = exact[name]
        square = ((poses[-1, :3] - others[-1, :3]) ** 2).sum()
        shares.append(square / covariances[-1].diagonal()[:3].sum())
    return 1.0 / float(np.mean(shares)) if any(shares) else math.inf


def _mean_and_std(prediction):
    """Return the mean and the standard deviation of the can's last position, each (3,) [m]."""
    poses, covariances = poses_of(prediction)["can"]
    return poses[-1, :3], np.sqrt(covariances[-1].diagonal()[:3])


def _end(process):
    """End a process with SIGINT, or kill it after a timeout; return its exit status."""
    if process.poll() is None:
        process.send_signal(signal.SIGINT)
    with contextlib.suppress(subprocess.TimeoutExpired):
        return process.wait(_END_TIMEOUT)
    process.kill()
    return process.wait()


if __name__ == "__main__":
    sys.exit(main())
