"""The prediction node with a parameter file; RViz and the lifecycle on request.

ros2 launch unc_physics predict.launch.py [params_file:=FILE] [namespace:=NAME] [use_sim_time:=true]
    [lifecycle:=true [autostart:=false]] [rviz:=true]
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument, EmitEvent, GroupAction, RegisterEventHandler
from launch.conditions import IfCondition, UnlessCondition
from launch.events import matches_action
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import LifecycleNode, Node
from launch_ros.event_handlers import OnStateTransition
from launch_ros.events.lifecycle import ChangeState
from launch_ros.parameter_descriptions import ParameterValue
from lifecycle_msgs.msg import Transition

from launch import LaunchDescription

CONFIG = Path(get_package_share_directory("unc_physics")) / "config"
ARGUMENTS = {
    "params_file": (str(CONFIG / "unc_physics.yaml"), "parameters of the node"),
    "namespace": ("", "namespace of the node"),
    "use_sim_time": ("false", "true: time comes from /clock, as of a simulator or a bag"),
    "lifecycle": ("false", "true: a lifecycle node"),
    "autostart": (
        "true",
        "true: the lifecycle node is configured and activated; false: someone else does it",
    ),
    "rviz": ("false", "true: show predictions in RViz"),
}


def generate_launch_description():
    arguments = {name: LaunchConfiguration(name) for name in ARGUMENTS}
    sim_time = {"use_sim_time": ParameterValue(arguments["use_sim_time"], value_type=bool)}
    common = {
        "package": "unc_physics",
        "name": "unc_physics",
        "namespace": arguments["namespace"],
        "parameters": [arguments["params_file"], sim_time],
        "output": "screen",
    }
    managed = LifecycleNode(executable="unc_physics_lifecycle_node", **common)

    def change(transition):
        return EmitEvent(
            event=ChangeState(lifecycle_node_matcher=matches_action(managed), transition_id=transition)
        )

    start = GroupAction(
        [
            # first, so that it is there when the node has changed
            RegisterEventHandler(
                OnStateTransition(
                    target_lifecycle_node=managed,
                    start_state="configuring",
                    goal_state="inactive",
                    entities=[change(Transition.TRANSITION_ACTIVATE)],
                )
            ),
            change(Transition.TRANSITION_CONFIGURE),
        ],
        condition=IfCondition(arguments["autostart"]),
    )
    return LaunchDescription(
        [
            *[
                DeclareLaunchArgument(name, default_value=default, description=description)
                for name, (default, description) in ARGUMENTS.items()
            ],
            Node(executable="unc_physics_node", condition=UnlessCondition(arguments["lifecycle"]), **common),
            GroupAction([managed, start], condition=IfCondition(arguments["lifecycle"])),
            Node(
                package="rviz2",
                executable="rviz2",
                arguments=["-d", str(CONFIG / "predict.rviz")],
                parameters=[sim_time],
                condition=IfCondition(arguments["rviz"]),
            ),
        ]
    )
