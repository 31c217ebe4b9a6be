"""The actual pose with heat: nominal robot, geometric errors and thermal growth in one closure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pouring_robot.closure import ClosureResult, ClosureSolver
from pouring_robot.description import PlacementError, perturb_urdf
from pouring_robot.mechanism import ClosedChainMechanism, FloatArray
from pouring_robot.model import loops_file
from pouring_robot.poses import PlatformPose, PoseDifference
from pouring_robot.robot import PouringRobot
from pouring_robot.thermal.expansion import ThermalExpansion


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
    return ClosedChainMechanism(urdf, robot.model.loops(), loops_file())


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
        drive_offsets: errors of the drives besides heat, in m and rad, by joint.

    Raises:
        UnreachablePoseError: a joint would pass its limits.
        ClosureError: the loops do not close.
    """
    offsets = drive_offsets or {}
    drives = robot.kinematics.inverse(pose)
    nominal = robot.kinematics.joint_values(pose)
    passive = {joint: nominal[joint] for joint in nominal if joint.endswith("_s3") and joint not in drives}
    placements = expansion.placements(robot.kinematics, passive)
    solver = ClosureSolver(
        heated_mechanism(robot, placements, geometry=geometry),
        (robot.actual_solver if geometry else robot.nominal_solver).energy.loads,
        robot.actual_solver.options,
    )
    growth = expansion.drive_offsets(drives, offsets)
    actual = {name: value + offsets.get(name, 0.0) + growth.get(name, 0.0) for name, value in drives.items()}
    return solver.solve(actual, robot.kinematics.configuration(pose))


@dataclass(frozen=True)
class PoseShares:
    """What geometry and heat do to a frame, alone and together; differences to the nominal pose in the fixed platform.

    Attributes:
        geometry: geometric errors (and loads) alone.
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


def pose_shares(
    robot: PouringRobot, expansion: ThermalExpansion, pose: PlatformPose, frame: str = "ladle_lip"
) -> PoseShares:
    """Return how geometry and heat move a frame at a commanded pose.

    Raises:
        UnreachablePoseError: a joint would pass its limits.
        ClosureError: the loops do not close.
        UnknownFrameError: there is no such frame.
    """
    location = robot.locate(pose)
    nominal = location.nominal.pose("fixed_platform", frame)
    heat = solve_heated(robot, expansion, pose, geometry=False).pose("fixed_platform", frame)
    both = solve_heated(robot, expansion, pose).pose("fixed_platform", frame)
    return PoseShares(
        location.difference(frame), PoseDifference.between(nominal, heat), PoseDifference.between(nominal, both)
    )
