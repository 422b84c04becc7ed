"""The demo's two bunnies, and a stream of their states to ``/unc_physics/scene``, as a tracker sends it.

They approach each other again and again.
"""

from __future__ import annotations

import math
import sys

import numpy as np
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data

from unc_physics_msgs.msg import ObjectState, Scene

from .messages.fields import point_message, quaternion_message, vector_message

SCALE = 6.0  # makes the bunnies nearly a metre long
SPHERES = 1000
POSITION_STD = 0.03  # m
RATE = 10.0  # Hz
ROUND = 1.5  # s, after which they start again, shortly before their contact


def bunnies() -> list[ObjectState]:
    """Return two bunnies that rise towards each other, one a little higher than the other."""
    half = math.sqrt(0.5)  # the model's own y axis points up, and it looks along its -x
    left = _bunny("left", (-1.2, 0.0, 0.0), (0.6, 0.0, 0.35), (0.0, half, half, 0.0))
    right = _bunny("right", (1.2, 0.0, 0.1), (-0.6, 0.0, 0.35), (half, 0.0, 0.0, half))
    return [left, right]


def _bunny(name, position, velocity, orientation):
    message = ObjectState(id=name, model="bunny", scale=SCALE, spheres=SPHERES, mass=1.0)
    pose, twist = message.pose.pose, message.twist.twist
    pose.position, pose.orientation = point_message(position), quaternion_message(orientation)
    twist.linear = vector_message(velocity)
    message.pose.covariance = np.diag([POSITION_STD**2] * 3 + [0.0] * 3).ravel()
    return message


class DemoStream(Node):
    """Publishes the present states of the bunnies."""

    def __init__(self):
        super().__init__("unc_physics_demo_stream")
        self._publisher = self.create_publisher(Scene, "/unc_physics/scene", qos_profile_sensor_data)
        self._start = self.get_clock().now()
        self.create_timer(1.0 / RATE, self._publish)

    def _publish(self):
        now = self.get_clock().now()
        elapsed = (1e-9 * (now - self._start).nanoseconds) % ROUND
        message = Scene(objects=bunnies())
        message.header.stamp = now.to_msg()
        for state in message.objects:
            for axis in "xyz":
                velocity = getattr(state.twist.twist.linear, axis)
                place = state.pose.pose.position
                setattr(place, axis, getattr(place, axis) + elapsed * velocity)
        self._publisher.publish(message)


def main(arguments=None) -> int:
    """Publish until SIGINT or SIGTERM."""
    try:
        rclpy.init(args=arguments)
        rclpy.spin(DemoStream())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        rclpy.try_shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())
