"""Asks the node where a can on its way to a brick will be: the smallest client in Python.

Start the node first (`ros2 run unc_physics unc_physics_node`, or `python -m unc_physics.ros.node`), then run
this.
"""

import numpy as np

from unc_physics.ros import Client, object_state, poses_of, prediction_request
from unc_physics_msgs.msg import ObjectState

TIMES = [0.1, 0.2, 0.3, 0.4, 0.5]  # s


def main() -> None:
    can = object_state(
        "can",
        "can",  # with the mass of its model
        pose=(-0.2, 0.0, 0.01),  # of the model's own origin [m]
        covariance=np.square([0.005, 0.005, 0.005, 0.02, 0.02, 0.02]),  # m, rad, about fixed axes
        twist=(0.5, 0.0, 0.0, 0.0, 0.0, 0.0),  # m/s, rad/s
    )
    brick = object_state("brick", "brick", pose=(0.0, 0.0, 0.0), kind=ObjectState.FIXED)
    request = prediction_request([can, brick], TIMES[-1], times=TIMES[:-1], propagator="sigma_points")

    with Client() as client:
        prediction = client.predict(request)
    for time, pose, covariance in zip(TIMES, *poses_of(prediction)["can"], strict=True):
        print(f"{time:.1f} s: {row(pose[:3])} m +- {row(np.sqrt(covariance.diagonal()[:3]))} m")


def row(vector: np.ndarray) -> str:
    """Three numbers to the millimetre."""
    return f"({', '.join(f'{value:.3f}' for value in vector)})"


if __name__ == "__main__":
    main()
