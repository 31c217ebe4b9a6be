"""The robot as built, closed at one command, for programs that can only handle trees.

A tree carries the platform on one chain. In the robot as built, that chain alone would determine the platform's pose,
and the whole closure residual would appear at the feet of the other chains. So the joint that carries the platform
(``cut_joints``) is placed where the closure, in which all chains count equally, puts it at the chosen command. There
every body of the tree has the package's pose, and each foot is off its seat by its own chain's residual. At other
commands the carrying chain's residual differs; :meth:`ClosedRobot.over_workspace` returns the resulting error.
"""

import functools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
import pinocchio as pin

from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.closure.solver import ClosureResult
from pouring_robot.mechanism.joint_types import NOT_IN_URDF
from pouring_robot.mechanism.pinocchio_model import frame_index, model_of
from pouring_robot.robot.description.urdf import joint_axis, limits_of, parsed, perturb_urdf, xml_text
from pouring_robot.robot.location import frames_of
from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.pouring_robot import robot_of
from pouring_robot.robot.robot import Command, Robot

# Other values that count from a joint's zero: soft limits of its controller, and positions of its reference switch.
_COUNTED = (
    ("safety_controller", "soft_lower_limit"),
    ("safety_controller", "soft_upper_limit"),
    ("calibration", "rising"),
    ("calibration", "falling"),
)


def ball_notes(balls: Sequence[str], zero_here: bool) -> list[str]:
    """Return notes on ball joints, which URDF cannot express; none where there are none."""
    if not balls:
        return []
    where = "only at its zeros" if zero_here else "at no joint values"
    return [f"URDF has no ball joints: {', '.join(balls)} turns about one axis there, so the tree closes {where}"]


def configured(tree: pin.Model, values: Mapping[str, float]) -> FloatArray:
    """Return a tree's configuration (nq,) with single-axis joints at values, in m and rad, of those that it has.

    It is integrated from neutral, because a joint without limits is stored as cosine and sine.
    """
    moved = np.zeros(tree.nv)
    for name, value in values.items():
        if tree.existJointName(name):
            moved[tree.joints[tree.getJointId(name)].idx_v] = value
    return np.asarray(pin.integrate(tree, pin.neutral(tree), moved))


@dataclass(frozen=True, eq=False)
class ClosedRobot:
    """The robot as built, closed at one command."""

    robot: Robot  # its drive offsets are in the joint placements, so the value of a drive's joint is the command
    result: ClosureResult  # the closure at the command
    drives: Mapping[str, float]  # commanded values, by joint in m or rad, including whole turns

    @classmethod
    def of(cls, model: RobotModel, command: Command | None = None) -> Self:
        """Close the robot of a model at a command, by default in the middle of its workspace or at its home.

        Raises BadInputError where it is not a command of this robot, NoSolutionError where no pose solves it.
        """
        robot = robot_of(model.with_offsets_placed())
        location = robot.location_in_the_middle() if command is None else robot.location_of(command)
        return cls(robot, location.actual, location.drives)

    @property
    def mechanism(self) -> ClosedChainMechanism:
        """Mechanism of the robot as built."""
        return self.result.mechanism

    @property
    def joints(self) -> dict[str, float]:
        """Value of every single-axis joint, in m and rad."""
        return self.result.joint_values

    @property
    def balls(self) -> tuple[str, ...]:
        """Its ball joints, which URDF cannot express: there each turns about one axis, and no table has its value."""
        return tuple(name for name, kind in self.mechanism.loops.joint_types.items() if kind in NOT_IN_URDF)

    @functools.cached_property
    def urdf(self) -> str:
        """URDF of the tree, with the platform at its closed pose for the command."""
        model, placed = self.mechanism.shared_model, {}
        for name in self.mechanism.loops.cut_joints:  # displaced by its value as a free joint in the closure
            first = model.joints[self.mechanism.joint_id(name)].idx_q
            placed[name] = pin.XYZQUATToSE3(self.result.configuration[first : first + 7])
        return perturb_urdf(self.mechanism.urdf, placed)

    def urdf_zero_here(self) -> str:
        """Return the tree's URDF with joint zeros moved to the command, for viewers that show joints at zero."""
        axes = {str(joint.get("name")): joint_axis(joint) for joint in parsed(self.urdf).iterfind("joint")}
        moved = {}
        for name, value in self.joints.items():
            way = value * axes[name] / np.linalg.norm(axes[name])
            is_slide = self.mechanism.unit_of(name) == "m"
            moved[name] = pin.SE3(np.eye(3), way) if is_slide else pin.SE3(pin.exp3(way), np.zeros(3))
        for name in self.balls:
            first = self.mechanism.shared_model.joints[self.mechanism.joint_id(name)].idx_q
            turned = pin.Quaternion(self.result.configuration[first : first + 4])
            moved[name] = pin.SE3(turned.matrix(), np.zeros(3))
        root = parsed(perturb_urdf(self.urdf, moved))
        for joint in root.iterfind("joint"):
            value = self.joints.get(str(joint.get("name")), 0.0)
            limit, mimic = joint.find("limit"), joint.find("mimic")
            for bound, stated in zip(("lower", "upper"), limits_of(joint) or (), strict=False):
                limit.set(bound, repr(stated - value))
            for tag, key in _COUNTED:
                for part in joint.iterfind(f"{tag}[@{key}]"):
                    part.set(key, repr(float(part.get(key)) - value))
            if mimic is not None:
                mimic.set("offset", "0")
        return xml_text(root)

    def over_workspace(self) -> FloatArray | None:
        """Return how far the tree's working frame is from the closed robot's at poses of the workspace, (n,), in m.

        The tree gets the joint values of the closed robot, as from a table. None for a robot without cut joints.
        """
        if not self.mechanism.loops.cut_joints:
            return None
        drives, start = self.robot.model.definition.workspace(self.robot.drawing)
        closed = self.robot.close(drives, start)
        good = np.flatnonzero(closed.closed)
        values = self.robot.engine().structure.joint_values(closed.joints)
        expected = frames_of(self.mechanism, closed.position, closed.rotation)[:, -1, :, 3]
        standing = ({name: course[row] for name, course in values.items()} for row in good)
        return np.asarray(np.linalg.norm(self.tips_m(standing) - expected[good], axis=1))

    def tips_m(self, standing: Iterable[Mapping[str, float]]) -> FloatArray:
        """Return the position of the tree's working frame in the base at joint values (m, rad), shape (n, 3), in m."""
        loops, tree = self.mechanism.loops, model_of(self.urdf, self.robot.model.definition.path)
        data, found = tree.createData(), []
        base, tip = (frame_index(tree, name) for name in (loops.base_frame, loops.working_frame))
        for values in standing:
            pin.framesForwardKinematics(tree, data, configured(tree, values))
            found.append(data.oMf[base].actInv(data.oMf[tip]).translation)
        return np.array(found).reshape(-1, 3)
