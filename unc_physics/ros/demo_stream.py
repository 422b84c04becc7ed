"""Streams the demo's two bunnies to ``/unc_physics/scene``, as a tracker would: they approach, again and
again.
"""

from __future__ import annotations

import copy
import sys

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data

from unc_physics_msgs.msg import Scene

from .demo_client import scene

RATE = 10.0  # Hz
ROUND = 1.5  # s, after which they start again; short of their contact


class DemoStream(Node):
    """Publishes where the bunnies are now."""

    def __init__(self):
        super().__init__("unc_physics_demo_stream")
        self._publisher = self.create_publisher(Scene, "/unc_physics/scene", qos_profile_sensor_data)
        self._start = self.get_clock().now()
        self.create_timer(1.0 / RATE, self._publish)

    def _publish(self):
        now = self.get_clock().now()
        elapsed = (1e-9 * (now - self._start).nanoseconds) % ROUND
        message = Scene(objects=copy.deepcopy(scene()))
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
