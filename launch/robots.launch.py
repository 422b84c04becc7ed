"""A prediction node for each of several robots, in the robot's namespace and with its own world frame.

ros2 launch unc_physics robots.launch.py robots:=left,right [params_file:=FILE]
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription

CONFIG = Path(get_package_share_directory("unc_physics")) / "config"


def nodes(context):
    """One for each name."""
    names = LaunchConfiguration("robots").perform(context).split(",")
    return [
        Node(
            package="unc_physics",
            executable="unc_physics_node",
            name="unc_physics",
            namespace=name,
            parameters=[LaunchConfiguration("params_file"), {"world_frame": f"{name}/world"}],
            output="screen",
        )
        for name in names
    ]


def generate_launch_description():
    return LaunchDescription(
        [
            DeclareLaunchArgument("robots", description="names of the robots, separated by commas"),
            DeclareLaunchArgument(
                "params_file",
                default_value=str(CONFIG / "unc_physics.yaml"),
                description="parameters of all nodes",
            ),
            OpaqueFunction(function=nodes),
        ]
    )
