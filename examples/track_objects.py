"""Follows a falling can that is covered before it lands, and asks the node where it will come to rest.

Start the node first, with its tracker and a table, then run this:

    ros2 run unc_physics unc_physics_node --ros-args -p track:=true \\
        -p environment:=examples/scenes/push_box.yaml -p observed_objects:=[can] -p observed_models:=[can]

Another name of the node, such as /tracker, is an argument of this program.
"""

import sys
import time

import numpy as np

from unc_physics import AtRest, PoseMeasurement
from unc_physics.ros import Client

HEIGHT, GRAVITY = 1.0, 9.81  # m, m/s^2
PERIOD, SEEN_FOR = 1.0 / 30.0, 0.3  # s
STD = np.array([0.002, 0.002, 0.002, 0.02, 0.02, 0.02])  # m, rad


def main(server: str = "/unc_physics") -> None:
    rng = np.random.default_rng(0)
    with Client(server=server) as client:
        client.reset()
        start = client.observe("can", seen(0.0, rng))
        for t in np.arange(PERIOD, SEEN_FOR, PERIOD):  # a camera would do this
            time.sleep(max(0.0, start + t - time.time()))
            client.observe("can", seen(t, rng), start + t)
        can = client.tracked()["can"]
        while can.stamp < start + t - 0.5 * PERIOD:  # the node still processes observations
            can = client.tracked()["can"]
        rest = AtRest("can")
        prediction = client.fork(3.0, events=[rest])
    speed = -can.belief.linear_velocity[2]
    print(f"{can.status.value} at {row(can.belief.position)} m, falling at {speed:.1f} m/s")
    predicted = prediction["can"]
    print(f"in 3 s at {row(predicted.position)} m +- {row(predicted.position_std)} m")
    print(f"at rest then: {prediction.probability(rest).estimate:.2f}")


def seen(t: float, rng: np.random.Generator) -> PoseMeasurement:
    """The pose of the can's model after a time, as a camera measures it."""
    position = [0.2 * t, 0.0, HEIGHT - 0.5 * GRAVITY * t**2] + STD[:3] * rng.standard_normal(3)
    return PoseMeasurement([*position, 0.0, 0.0, 0.0, 1.0], STD, "model")


def row(vector: np.ndarray) -> str:
    """Three numbers to the centimetre."""
    return f"({', '.join(f'{value:.2f}' for value in vector)})"


if __name__ == "__main__":
    main(*sys.argv[1:])
