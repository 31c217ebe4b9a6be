"""The robot as built, closed at one command, for programs that know trees only.

A tree carries the platform on one chain. As built, it would stand where that chain alone puts it, and what the loops
leave open would all show at the feet of the others. So the joint that carries it (``cut_joints``) is placed where the
closure, in which all chains count alike, has the platform at the chosen command: there every body of the tree stands
where the package says, and each foot is off its seat by that chain's own share. Elsewhere the carrier's share is
another one; :meth:`ClosedRobot.over_workspace` says how much that does.
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

# What else of a joint counts from its zero: where a controller holds it back, and at which places a switch says so.
_COUNTED = (
    ("safety_controller", "soft_lower_limit"),
    ("safety_controller", "soft_upper_limit"),
    ("calibration", "rising"),
    ("calibration", "falling"),
)


def ball_notes(balls: Sequence[str], zero_here: bool) -> list[str]:
    """Return what a URDF cannot say of ball joints: none where there is none."""
    if not balls:
        return []
    where = "only at its zeros" if zero_here else "at no joint values"
    return [f"URDF has no ball joints: {', '.join(balls)} turns about one axis there, so the tree closes {where}"]


def configured(tree: pin.Model, values: Mapping[str, float]) -> FloatArray:
    """Return a tree's configuration (nq,) with joints of one freedom at values, in m and rad, as far as it has them.

    From neutral on: a joint without limits is stored as cosine and sine.
    """
    moved = np.zeros(tree.nv)
    for name, value in values.items():
        if tree.existJointName(name):
            moved[tree.joints[tree.getJointId(name)].idx_v] = value
    return np.asarray(pin.integrate(tree, pin.neutral(tree), moved))


@dataclass(frozen=True, eq=False)
class ClosedRobot:
    """The robot as built, closed at one command."""

    robot: Robot  # its drives' offsets stand in the joints, so that the value of a drive's joint is the command
    result: ClosureResult  # the closure at the command
    drives: Mapping[str, float]  # commanded values, by joint in m or rad, whole turns too

    @classmethod
    def of(cls, model: RobotModel, command: Command | None = None) -> Self:
        """Close the robot of a model at a command, by default in the middle of its workspace or at its home.

        Raises BadInputError where it is no command of this robot, NoSolutionError where no pose has it.
        """
        robot = robot_of(model.with_offsets_placed())
        location = robot.location_in_the_middle() if command is None else robot.location_of(command)
        return cls(robot, location.actual, location.drives)

    @property
    def mechanism(self) -> ClosedChainMechanism:
        """The mechanism as built."""
        return self.result.mechanism

    @property
    def joints(self) -> dict[str, float]:
        """Value of every joint of one freedom, in m and rad."""
        return self.result.joint_values

    @property
    def balls(self) -> tuple[str, ...]:
        """Its ball joints, which a URDF cannot say: there each turns about one axis, and no table has its value."""
        return tuple(name for name, kind in self.mechanism.loops.joint_types.items() if kind in NOT_IN_URDF)

    @functools.cached_property
    def urdf(self) -> str:
        """The tree, the platform standing at the command where the closure puts it."""
        model, placed = self.mechanism.shared_model, {}
        for name in self.mechanism.loops.cut_joints:  # off by the value of the free joint it is in the closure
            first = model.joints[self.mechanism.joint_id(name)].idx_q
            placed[name] = pin.XYZQUATToSE3(self.result.configuration[first : first + 7])
        return perturb_urdf(self.mechanism.urdf, placed)

    def urdf_zero_here(self) -> str:
        """Return the tree with the zeros of its joints moved to the command, for viewers that show zeros."""
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
            for bound, said in zip(("lower", "upper"), limits_of(joint) or (), strict=False):
                limit.set(bound, repr(said - value))
            for tag, key in _COUNTED:
                for part in joint.iterfind(f"{tag}[@{key}]"):
                    part.set(key, repr(float(part.get(key)) - value))
            if mimic is not None:
                mimic.set("offset", "0")
        return xml_text(root)

    def over_workspace(self) -> FloatArray | None:
        """Return how far the tree's working frame is from the closed robot's at poses of the workspace, (n,), in m.

        The tree gets the joint values of the closed robot, as a table of them would give. None where the tree is all
        there is.
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
        """Return where the tree has its working frame at joint values (m, rad), seen from the base, shape (n, 3), m."""
        loops, tree = self.mechanism.loops, model_of(self.urdf, self.robot.model.definition.path)
        data, found = tree.createData(), []
        base, tip = (frame_index(tree, name) for name in (loops.base_frame, loops.working_frame))
        for values in standing:
            pin.framesForwardKinematics(tree, data, configured(tree, values))
            found.append(data.oMf[base].actInv(data.oMf[tip]).translation)
        return np.array(found).reshape(-1, 3)
