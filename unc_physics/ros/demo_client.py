"""The demo's client: asks the node where two bunnies will be, and shows the answer as a table
and a picture.
"""

from __future__ import annotations

import argparse
import math
import sys
import time

import numpy as np
import rclpy

from unc_physics_msgs.msg import ObjectState, Prediction, PredictionRequest, Result, Scene
from unc_physics_msgs.srv import Predict

from ..propagators.names import ANYTIME, REFERENCE
from ..propagators.registry import PROPAGATORS
from .durations import duration, seconds

NODE = "unc_physics_demo"
HORIZON = 5.0  # s
PERIOD = 0.1  # s
SCALE = 6.0  # makes the bunnies nearly a metre long
SPHERES = 1000
POSITION_STD = 0.03  # m
SEED = 1
SAMPLES = 200
SHOWN_SAMPLES = 40

_WAIT = 120.0  # s; a node that is started for the first time compiles its kernels


def scene() -> list[ObjectState]:
    """Two bunnies that rise towards each other, one a little higher than the other."""
    half = math.sqrt(0.5)  # the model's own y axis points up, and it looks along its -x
    left = _bunny("left", (-1.2, 0.0, 0.0), (0.6, 0.0, 0.35), (0.0, half, half, 0.0))
    right = _bunny("right", (1.2, 0.0, 0.1), (-0.6, 0.0, 0.35), (half, 0.0, 0.0, half))
    return [left, right]


def _bunny(name, position, velocity, orientation):
    message = ObjectState(id=name, model="bunny", scale=SCALE, spheres=SPHERES, mass=1.0)
    pose, twist = message.pose.pose, message.twist.twist
    pose.position.x, pose.position.y, pose.position.z = position
    pose.orientation.x, pose.orientation.y, pose.orientation.z, pose.orientation.w = orientation
    twist.linear.x, twist.linear.y, twist.linear.z = velocity
    message.pose.covariance = np.diag([POSITION_STD**2] * 3 + [0.0] * 3).ravel()
    return message


def requests() -> dict[str, PredictionRequest]:
    """The same question to two propagators: the node's own with the path there, the reference with poses
    drawn.
    """
    common = {"scene": Scene(objects=scene()), "horizon": duration(HORIZON), "seed": SEED}
    return {
        PROPAGATORS[ANYTIME].label: PredictionRequest(
            propagator=ANYTIME, trajectory_period=duration(PERIOD), **common
        ),
        PROPAGATORS[REFERENCE].label: PredictionRequest(
            propagator=REFERENCE, samples=SAMPLES, return_samples=SHOWN_SAMPLES, **common
        ),
    }


def ask() -> dict[str, tuple[Prediction, float]]:
    """Each propagator's answer and the time that it took over ROS [s]."""
    rclpy.init()
    node = rclpy.create_node("demo_client")
    try:
        client = node.create_client(Predict, f"/{NODE}/predict")
        if not client.wait_for_service(_WAIT):
            raise RuntimeError(f"the node /{NODE} does not answer")
        answers = {}
        for name, request in requests().items():
            started = time.perf_counter()
            future = client.call_async(Predict.Request(request=request))
            rclpy.spin_until_future_complete(node, future, timeout_sec=_WAIT)
            answer = future.result()
            if answer is None or answer.result.error_code != Result.NONE:
                raise RuntimeError(answer.result.error_msg if answer else "no answer came")
            answers[name] = answer.prediction, time.perf_counter() - started
        return answers
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


def table(answers) -> str:
    """Predicted pose and standard deviations of each object."""
    lines = [
        f"Predicted after {HORIZON:g} s, poses of the models' origins in the world frame:",
        (
            f"{'object':8}{'propagator':14}{'position [m]':^26}{'std [m]':^21}"
            f"{'rotation [deg]':^24}{'std [deg]':^21}"
        ),
    ]
    for k, predicted in enumerate(scene()):
        for name, (answer, _) in answers.items():
            pose = answer.objects[k].states[-1].pose
            p, q = pose.pose.position, pose.pose.orientation
            std = np.sqrt(np.reshape(pose.covariance, (6, 6)).diagonal())
            lines.append(
                f"{predicted.id:8}{name:14}"
                f"{_row((p.x, p.y, p.z), '8.3f')}  {_row(std[:3], '6.3f')}   "
                f"{_row(np.degrees(_rotation_vector(q)), '7.1f')}  {_row(np.degrees(std[3:]), '6.1f')}"
            )
    for name, (answer, wall) in answers.items():
        lines.append(
            f"{name}: {answer.rollouts} rollouts, computed in"
            f" {1e3 * seconds(answer.computation_time):.1f} ms, answered over ROS in {1e3 * wall:.1f} ms"
        )
    whole, end = answers
    lines.append(f"{whole} was asked for the path there, a pose every {PERIOD:g} s; {end} for its end alone.")
    return "\n".join(lines)


def _row(values, form):
    return "".join(f"{value:{form}}" for value in values)


def _rotation_vector(q):
    """Rotation vector [rad] of a quaternion message."""
    axis, w = np.array([q.x, q.y, q.z]), q.w
    if w < 0.0:
        axis, w = -axis, -w
    length = np.linalg.norm(axis)
    return 2.0 * math.atan2(length, w) / length * axis if length > 0.0 else np.zeros(3)


def main(arguments=None) -> int:
    """Ask, print the table, draw the picture."""
    parser = argparse.ArgumentParser(prog="unc_physics.ros.demo_client", description=__doc__)
    parser.add_argument("--output", required=True, metavar="FILE.png")
    options = parser.parse_args(arguments)
    try:
        answers = ask()
    except RuntimeError as error:
        print(f"demo client: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    print(table(answers), flush=True)
    from .demo_picture import draw

    draw(options.output, scene(), {name: answer for name, (answer, _) in answers.items()})
    print(f"Picture: {options.output}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
