"""Follows a falling can that is covered before it lands, and asks the node where it will come to rest.

Start the node first, with its tracker and a table, then run this:

    ros2 run unc_physics unc_physics_node --ros-args -p track:=true \\
        -p environment:=examples/scenes/push_box.yaml -p observed_objects:=[can]

Another name of the node, such as /tracker, is an argument of this program.
"""

import sys
import time

import numpy as np
import rclpy
from geometry_msgs.msg import PoseWithCovariance, PoseWithCovarianceStamped

from unc_physics.ros import Client, make_message, poses_of
from unc_physics_msgs.msg import Event

HEIGHT, GRAVITY = 1.0, 9.81  # m, m/s^2
PERIOD, SEEN_FOR = 1.0 / 30.0, 0.3  # s
STD = np.array([0.002, 0.002, 0.002, 0.02, 0.02, 0.02])  # m, rad


def main(server: str = "/unc_physics") -> None:
    rclpy.init()
    camera, rng = rclpy.create_node("camera"), np.random.default_rng(0)
    publisher = camera.create_publisher(PoseWithCovarianceStamped, f"{server}/observed/can", 20)
    with Client(server=server) as client:
        client.reset()
        while not publisher.get_subscription_count():
            time.sleep(PERIOD)
        start, t = camera.get_clock().now(), 0.0
        while t < SEEN_FOR:  # a pose estimator would do this
            now = camera.get_clock().now()
            t = 1e-9 * (now - start).nanoseconds
            observation = PoseWithCovarianceStamped(pose=seen(t, rng))
            observation.header.stamp = now.to_msg()
            publisher.publish(observation)
            time.sleep(PERIOD)
        (can,) = client.tracked(after=1e-9 * now.nanoseconds - PERIOD).objects
        answer = client.fork(horizon=3.0, return_probabilities=True)
    position, speed = can.pose.pose.position, -can.twist.twist.linear.z
    print(f"tracked at {row([position.x, position.y, position.z])} m, falling at {speed:.1f} m/s")
    poses, covariances = poses_of(answer.prediction)["can"]
    std = np.sqrt(covariances[-1].diagonal())
    print(f"in 3 s at {row(poses[-1, :3])} m +- {row(std[:3])} m")
    (at_rest,) = (event for event in answer.prediction.events if event.kind == Event.AT_REST)
    print(f"at rest then: {at_rest.probability:.2f}")
    rclpy.shutdown()


def seen(t: float, rng: np.random.Generator) -> PoseWithCovariance:
    """The pose of the can's model after a time, as a camera measures it."""
    position = [0.2 * t, 0.0, HEIGHT - 0.5 * GRAVITY * t**2] + STD[:3] * rng.standard_normal(3)
    return make_message(PoseWithCovariance, pose=[*position, 0.0, 0.0, 0.0, 1.0], covariance=np.diag(STD**2))


def row(vector) -> str:
    """Three numbers to the centimetre."""
    return f"({', '.join(f'{value:.2f}' for value in vector)})"


if __name__ == "__main__":
    main(*sys.argv[1:])
