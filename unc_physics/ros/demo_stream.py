"""Stream of the demo's scene to ``/unc_physics/scene``, as a tracker sends it.

A can flies towards a carton repeatedly.
"""

from __future__ import annotations

import sys

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data

from unc_physics_msgs.msg import Scene

from ..geometry.library import load_model
from .demo_scene import table_scene
from .messages.scene import write_scene
from .models import packing_info

RATE = 10.0  # Hz
ROUND = 0.15  # s, period of the can's flight, which restarts shortly before it reaches the table
_GRAVITY = 9.81  # m/s^2


class DemoStream(Node):
    """Node that publishes the current poses of can and carton."""

    def __init__(self):
        super().__init__("unc_physics_demo_stream")
        self._publisher = self.create_publisher(Scene, "/unc_physics/scene", qos_profile_sensor_data)
        self._start = self.get_clock().now()
        self._message = write_scene(*table_scene(), lambda name: packing_info(load_model(name), name))
        _, self._can = self._message.objects
        place = self._can.pose.position
        self._height, self._place = place.z, place.x
        self.create_timer(1.0 / RATE, self._publish)

    def _publish(self):
        now = self.get_clock().now()
        elapsed = (1e-9 * (now - self._start).nanoseconds) % ROUND
        self._message.header.stamp = now.to_msg()
        can = self._can
        can.pose.position.x = self._place + elapsed * can.twist.linear.x
        can.pose.position.z = self._height - 0.5 * _GRAVITY * elapsed**2
        can.twist.linear.z = -_GRAVITY * elapsed
        self._publisher.publish(self._message)


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
