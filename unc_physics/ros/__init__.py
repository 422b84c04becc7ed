"""The ROS 2 node: predictions as services, streams and actions. Only this part of the package
imports rclpy.
"""
