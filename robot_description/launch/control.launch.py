"""The drives under ros2_control, with mock hardware: a trajectory controller, and all joints closed behind it.

ros2 launch pouring_robot_description control.launch.py
"""

from launch import LaunchDescription
from launch.actions import IncludeLaunchDescription
from launch.substitutions import PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare


def generate_launch_description():
    here = FindPackageShare("pouring_robot_description")
    spawned = ("joint_state_broadcaster", "drives_controller")
    return LaunchDescription(
        [
            IncludeLaunchDescription(
                PathJoinSubstitution([here, "launch", "description.launch.py"]),
                launch_arguments={"ros2_control": "true"}.items(),
            ),
            Node(
                package="controller_manager",
                executable="ros2_control_node",
                parameters=[PathJoinSubstitution([here, "config", "controllers.yaml"])],
                remappings=[("~/robot_description", "/robot_description"), ("joint_states", "drive_states")],
            ),
            *(Node(package="controller_manager", executable="spawner", arguments=[name]) for name in spawned),
        ]
    )
