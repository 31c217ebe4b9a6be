"""The actual pose with heat: nominal robot, geometric errors and thermal growth in one closure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.closure import ClosureResult, ClosureSolver
from pouring_robot.mechanism.poses import PoseDifference
from pouring_robot.robot.model import loops_file
from pouring_robot.robot.pouring.description import PlacementError, perturb_urdf
from pouring_robot.robot.pouring.poses import PlatformPose
from pouring_robot.robot.robot import PouringRobot
from pouring_robot.thermal.expansion.growth import ThermalExpansion


def heated_mechanism(
    robot: PouringRobot, placements: Mapping[str, PlacementError], *, geometry: bool = True
) -> ClosedChainMechanism:
    """Return the robot with joints displaced by heat, and by its geometric errors if wanted.

    Heat is applied first and the geometric error in the joint's displaced frame, so that a U-joint centre stands at
    its grown nominal place plus its offset.

    Raises:
        UnknownJointError: the robot has no such joint.
    """
    urdf = perturb_urdf(robot.model.nominal_urdf(), placements)
    if geometry:
        urdf = perturb_urdf(urdf, robot.model.placement_errors())
    return ClosedChainMechanism(urdf, robot.kinematics.mechanism.loops, loops_file())


class WarmRobot(PouringRobot):
    """The robot as built, its parts grown by heat: does what :class:`PouringRobot` does, warm.

    Where the legs that are not driven stand at a pose, their growth displaces a joint; so the robot is made for one
    pose, and elsewhere the value of such a leg's joint (nothing else) is off by the change of its growth.

    Args:
        robot: its model holds the geometric errors; its loads act here too.
        expansion: how much the parts have grown.
        pose: the pose the robot is made for.
        geometry: with the geometric errors, drive offsets and loads, or the drawing with heat alone.
        drive_offsets: errors of the drives besides heat, in m and rad, by joint; by default those of the model.
        passive_lengths_m: length without heat of each leg that is not driven, by its prismatic joint; by default that
            of the drawing at the pose.
    """

    def __init__(
        self,
        robot: PouringRobot,
        expansion: ThermalExpansion,
        pose: PlatformPose,
        *,
        geometry: bool = True,
        drive_offsets: Mapping[str, float] | None = None,
        passive_lengths_m: Mapping[str, float] | None = None,
    ) -> None:
        """Take over the nominal side and build the warm mechanism."""
        # Not super().__init__: model, nominal solver and kinematics are the given robot's, and building takes time.
        self.__dict__.update(vars(robot))
        self.expansion = expansion
        if drive_offsets is not None:
            self._drive_offsets = dict(drive_offsets)
        elif not geometry:
            self._drive_offsets = {}
        passive = passive_lengths_m or passive_lengths(robot, robot.kinematics.joint_values(pose))
        self.actual_solver = ClosureSolver(
            heated_mechanism(robot, expansion.placements(robot.kinematics, passive), geometry=geometry),
            (robot.actual_solver if geometry else robot.nominal_solver).energy.loads,
            robot.actual_solver.options,
        )

    def actual_drives(self, drives: dict[str, float]) -> dict[str, float]:
        """Return where the drives stand for commanded values, in m and rad: offset, then grown with the leg."""
        growth = self.expansion.drive_offsets(drives, self._drive_offsets)
        return {name: value + growth.get(name, 0.0) for name, value in super().actual_drives(drives).items()}


def passive_lengths(robot: PouringRobot, joint_values: Mapping[str, float]) -> dict[str, float]:
    """Return the value of the prismatic joint of each leg that is not driven, in m, by its name."""
    drives = robot.nominal_solver.mechanism.loops.drives
    return {name: joint_values[name] for name in joint_values if name.endswith("_s3") and name not in drives}


def solve_heated(
    robot: PouringRobot,
    expansion: ThermalExpansion,
    pose: PlatformPose,
    *,
    geometry: bool = True,
    drive_offsets: Mapping[str, float] | None = None,
) -> ClosureResult:
    """Close the robot as built and as warm as it is, at the drive values a controller commands for a pose.

    Args:
        robot: its model holds the geometric errors; its loads act here too.
        expansion: how much the parts have grown.
        pose: the commanded pose.
        geometry: with the geometric errors, or with heat alone.
        drive_offsets: errors of the drives besides heat, in m and rad, by joint; by default those of the model.

    Raises:
        UnreachablePoseError: a joint would pass its limits.
        ClosureError: the loops do not close.
    """
    warm = WarmRobot(robot, expansion, pose, geometry=geometry, drive_offsets=drive_offsets)
    return warm.forward(robot.kinematics.inverse(pose), near=pose)


@dataclass(frozen=True)
class PoseShares:
    """What geometry and heat do to a frame, alone and together; differences to the nominal pose in the fixed platform.

    Attributes:
        geometry: geometric errors, drive offsets and loads alone.
        heat: heat alone, on the drawing.
        together: both in one closure: the actual pose.
    """

    geometry: PoseDifference
    heat: PoseDifference
    together: PoseDifference

    @property
    def remainder_m(self) -> FloatArray:
        """What the shares leave of the whole: together - geometry - heat, shape (3,), in m. Not zero."""
        return np.asarray(self.together.translation_m - self.geometry.translation_m - self.heat.translation_m)

    @property
    def remainder_rad(self) -> FloatArray:
        """The same of the rotation vectors, shape (3,), in rad; of second order even for small turns."""
        return np.asarray(self.together.rotation_rad - self.geometry.rotation_rad - self.heat.rotation_rad)


def pose_shares(
    robot: PouringRobot, expansion: ThermalExpansion, pose: PlatformPose, frame: str | None = None
) -> PoseShares:
    """Return how geometry and heat move a frame (default: the pouring lip) at a commanded pose.

    Raises:
        UnreachablePoseError: a joint would pass its limits.
        ClosureError: the loops do not close.
        UnknownFrameError: there is no such frame.
    """
    location = robot.locate(pose)
    base, frame = location.loops.base_frame, frame or location.loops.working_frame
    nominal = location.nominal.pose(base, frame)
    heat, both = (solve_heated(robot, expansion, pose, geometry=geometry) for geometry in (False, True))
    return PoseShares(
        location.difference(frame),
        PoseDifference.between(nominal, heat.pose(base, frame)),
        PoseDifference.between(nominal, both.pose(base, frame)),
    )
