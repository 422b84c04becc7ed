"""Asks the node where a can on its way to a brick will be: the smallest client in Python.

Start the node first (`ros2 run unc_physics unc_physics_node`, or `python -m unc_physics.ros.node`), then run
this.
"""

import sys

import numpy as np
import rclpy
from builtin_interfaces.msg import Duration

from unc_physics_msgs.msg import ObjectState, PredictionRequest, Result, Scene
from unc_physics_msgs.srv import Predict


def main():
    can = ObjectState(id="can", model="can", spheres=500)  # with the mass of its model
    can.pose.pose.position.x, can.pose.pose.position.z = -0.2, 0.01
    can.twist.twist.linear.x = 0.5
    can.pose.covariance = np.diag(
        [0.005**2] * 3 + [0.02**2] * 3
    ).ravel()  # 5 mm and 0.02 rad, about fixed axes
    can.twist.covariance[0] = -1.0  # unknown: the node's default
    brick = ObjectState(id="brick", model="brick", spheres=500, kind=ObjectState.FIXED)
    request = PredictionRequest(
        scene=Scene(objects=[can, brick]),
        horizon=Duration(nanosec=500_000_000),
        trajectory_period=Duration(nanosec=100_000_000),
        propagator="sigma_points",
    )

    rclpy.init()
    node = rclpy.create_node("predict_client")
    client = node.create_client(Predict, "/unc_physics/predict")
    if not client.wait_for_service(timeout_sec=10.0):
        sys.exit("no node answers on /unc_physics/predict")
    future = client.call_async(Predict.Request(request=request))
    rclpy.spin_until_future_complete(node, future)
    response = future.result()
    rclpy.try_shutdown()
    if response.result.error_code != Result.NONE:
        sys.exit(f"error {response.result.error_code}: {response.result.error_msg}")
    for state in response.prediction.objects[0].states:
        time = state.time_from_start.sec + 1e-9 * state.time_from_start.nanosec
        position = state.pose.pose.position
        std = np.sqrt(np.reshape(state.pose.covariance, (6, 6)).diagonal())
        print(
            f"{time:.1f} s: ({position.x:.3f}, {position.y:.3f}, {position.z:.3f}) m "
            f"+- ({std[0]:.3f}, {std[1]:.3f}, {std[2]:.3f}) m"
        )


if __name__ == "__main__":
    main()
