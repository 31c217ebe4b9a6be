"""The robot in RViz, closed: sliders move the drives, closed_joint_states finds all other joints.

ros2 launch pouring_robot_description display.launch.py layout:=wide
"""

from launch import LaunchDescription
from launch.actions import IncludeLaunchDescription
from launch.substitutions import PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare


def generate_launch_description():
    here = FindPackageShare("pouring_robot_description")
    return LaunchDescription(
        [
            IncludeLaunchDescription(PathJoinSubstitution([here, "launch", "description.launch.py"])),
            # Its sliders of passive joints do nothing: only drives and travels are taken over.
            Node(
                package="joint_state_publisher_gui",
                executable="joint_state_publisher_gui",
                parameters=[PathJoinSubstitution([here, "config", "sliders.yaml"])],
                remappings=[("joint_states", "drive_states")],
            ),
            Node(
                package="rviz2",
                executable="rviz2",
                arguments=["-d", PathJoinSubstitution([here, "rviz", "display.rviz"])],
            ),
        ]
    )
