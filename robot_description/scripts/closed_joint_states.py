#!/usr/bin/env python3
"""Publishes all joints of the closed robot: takes the drives of ``drive_states``, finds the passive joints.

Needs the Python package ``pouring_robot`` in the environment of ROS. Parameters: ``layout``, or ``model``, a model file
of the robot as built.
"""

import rclpy
from rclpy.node import Node
from sensor_msgs.msg import JointState

from pouring_robot import RobotModel
from pouring_robot.exceptions import PouringRobotError
from pouring_robot.robot.robot import Robot


class ClosedJointStates(Node):
    """Closes the robot for every message of drive values."""

    def __init__(self) -> None:
        """Read the parameters and build the robot."""
        super().__init__("closed_joint_states")
        model, layout = (self.declare_parameter(name, "").value for name in ("model", "layout"))
        built = RobotModel.of(model) if model else RobotModel(layout=layout or "paper")
        self.robot = Robot(built.with_offsets_placed())
        self.drives = self.robot.nominal_solver.mechanism.loops.drives
        self.travels = self.robot.nominal_solver.mechanism.loops.locked_joints
        self.publisher = self.create_publisher(JointState, "joint_states", 10)
        self.create_subscription(JointState, "drive_states", self.close, 10)

    def close(self, message: JointState) -> None:
        """Publish the joints for a message; one without all drives, or that nothing closes, is left out with a line."""
        given = dict(zip(message.name, message.position, strict=False))  # it may hold velocities alone
        try:
            closed = self.robot.location_at([given[name] for name in self.drives]).actual
        except (KeyError, PouringRobotError) as problem:
            self.get_logger().warning(f"not closed: {problem}", throttle_duration_sec=2.0)
            return
        joints = closed.joint_values | {name: given[name] for name in self.travels if name in given}
        answer = JointState(name=list(joints), position=list(joints.values()))
        answer.header.stamp = message.header.stamp
        self.publisher.publish(answer)


def main() -> None:
    """Run until it is stopped."""
    rclpy.init()
    node = ClosedJointStates()
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        node.get_logger().info("stopped")


if __name__ == "__main__":
    main()
