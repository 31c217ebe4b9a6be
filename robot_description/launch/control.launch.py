"""The drives under ros2_control, with mock hardware: a trajectory controller, and all joints closed behind it.

ros2 launch pouring_robot_description control.launch.py
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
    urdf = ParameterValue(Command(["xacro ", xacro, " ros2_control:=true layout:=", layout]), value_type=str)
    controllers = PathJoinSubstitution([here, "config", "controllers.yaml"])
    spawned = ("joint_state_broadcaster", "drives_controller")
    return LaunchDescription(
        [
            DeclareLaunchArgument("layout", default_value="paper", description="name in config/layouts.yaml"),
            Node(
                package="robot_state_publisher",
                executable="robot_state_publisher",
                parameters=[{"robot_description": urdf}],
            ),
            Node(
                package="controller_manager",
                executable="ros2_control_node",
                parameters=[controllers],
                remappings=[("~/robot_description", "/robot_description"), ("joint_states", "drive_states")],
            ),
            *(Node(package="controller_manager", executable="spawner", arguments=[name]) for name in spawned),
            Node(package=PACKAGE, executable="closed_joint_states.py", parameters=[{"layout": layout}]),
        ]
    )
