"""What display and control share: the robot's description, its frames, and all joints closed behind the drives."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import Command, LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

PACKAGE = "pouring_robot_description"
ARGUMENTS = {
    "layout": ("paper", "name in config/layouts.yaml"),
    "model": ("", "model file of the robot as built, which is closed in place of the layout"),
    "ros2_control": ("false", "with tags for ros2_control"),
}


def generate_launch_description():
    layout, model, control = (LaunchConfiguration(name) for name in ARGUMENTS)
    xacro = PathJoinSubstitution([FindPackageShare(PACKAGE), "urdf", "pouring_robot.urdf.xacro"])
    command = Command(["xacro ", xacro, " layout:=", layout, " ros2_control:=", control])
    closing = {name: ParameterValue(value, value_type=str) for name, value in (("layout", layout), ("model", model))}
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=default, description=words)
                for name, (default, words) in ARGUMENTS.items()
            ),
            Node(
                package="robot_state_publisher",
                executable="robot_state_publisher",
                parameters=[{"robot_description": ParameterValue(command, value_type=str)}],
            ),
            Node(package=PACKAGE, executable="closed_joint_states.py", parameters=[closing]),
        ]
    )
