"""The prediction node with a parameter file; RViz and the lifecycle on request.

ros2 launch unc_physics predict.launch.py [params_file:=FILE] [namespace:=NAME] [lifecycle:=true] [rviz:=true]
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition, UnlessCondition
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import LifecycleNode, Node

from launch import LaunchDescription

CONFIG = Path(get_package_share_directory("unc_physics")) / "config"


def generate_launch_description():
    params_file, namespace = LaunchConfiguration("params_file"), LaunchConfiguration("namespace")
    common = {
        "package": "unc_physics",
        "name": "unc_physics",
        "namespace": namespace,
        "parameters": [params_file],
        "output": "screen",
    }
    lifecycle = LaunchConfiguration("lifecycle")
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "params_file",
                default_value=str(CONFIG / "unc_physics.yaml"),
                description="parameters of the node",
            ),
            DeclareLaunchArgument("namespace", default_value="", description="namespace of the node"),
            DeclareLaunchArgument(
                "lifecycle",
                default_value="false",
                description="true: a lifecycle node, which someone else activates",
            ),
            DeclareLaunchArgument(
                "rviz", default_value="false", description="true: show predictions in RViz"
            ),
            Node(executable="unc_physics_node", condition=UnlessCondition(lifecycle), **common),
            LifecycleNode(
                executable="unc_physics_lifecycle_node", condition=IfCondition(lifecycle), **common
            ),
            Node(
                package="rviz2",
                executable="rviz2",
                arguments=["-d", str(CONFIG / "predict.rviz")],
                condition=IfCondition(LaunchConfiguration("rviz")),
            ),
        ]
    )
