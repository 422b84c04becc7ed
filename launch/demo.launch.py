"""The prediction node and a client that streams a can that flies towards a carton, shown in RViz.

ros2 launch unc_physics demo.launch.py [rviz:=false] [view:=true]
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription

CONFIG = Path(get_package_share_directory("unc_physics")) / "config"


def generate_launch_description():
    return LaunchDescription(
        [
            DeclareLaunchArgument("rviz", default_value="true", description="show predictions in RViz"),
            DeclareLaunchArgument(
                "view", default_value="false", description="show the stream on a page in the browser"
            ),
            Node(
                package="unc_physics",
                executable="unc_physics_node",
                name="unc_physics",
                output="screen",
                parameters=[str(CONFIG / "demo.yaml")],
            ),
            Node(package="unc_physics", executable="unc_physics_demo_stream", output="screen"),
            Node(
                package="unc_physics",
                executable="unc_physics_view",
                output="screen",
                parameters=[str(CONFIG / "demo.yaml")],
                condition=IfCondition(LaunchConfiguration("view")),
            ),
            Node(
                package="rviz2",
                executable="rviz2",
                arguments=["-d", str(CONFIG / "predict.rviz")],
                condition=IfCondition(LaunchConfiguration("rviz")),
            ),
        ]
    )
