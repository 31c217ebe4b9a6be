"""The robot in RViz, closed: sliders move the drives, closed_joint_states finds all other joints.

ros2 launch pouring_robot_description display.launch.py layout:=wide
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import Command, LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

PACKAGE = "pouring_robot_description"


def generate_launch_description():
    here = FindPackageShare(PACKAGE)
    layout = LaunchConfiguration("layout")
    xacro = PathJoinSubstitution([here, "urdf", "pouring_robot.urdf.xacro"])
    urdf = ParameterValue(Command(["xacro ", xacro, " layout:=", layout]), value_type=str)
    view = PathJoinSubstitution([here, "rviz", "display.rviz"])
    return LaunchDescription(
        [
            DeclareLaunchArgument("layout", default_value="paper", description="name in config/layouts.yaml"),
            Node(
                package="robot_state_publisher",
                executable="robot_state_publisher",
                parameters=[{"robot_description": urdf}],
            ),
            # Its sliders of passive joints do nothing: only drives and travels are taken over.
            Node(
                package="joint_state_publisher_gui",
                executable="joint_state_publisher_gui",
                parameters=[PathJoinSubstitution([here, "config", "sliders.yaml"])],
                remappings=[("joint_states", "drive_states")],
            ),
            Node(package=PACKAGE, executable="closed_joint_states.py", parameters=[{"layout": layout}]),
            Node(package="rviz2", executable="rviz2", arguments=["-d", view]),
        ]
    )
