"""The robot as built with its parts grown by heat: nominal robot, geometric errors and growth in one closure."""

from collections.abc import Mapping

from pouring_robot.mechanism.closure.solver import ClosureResult, ClosureSolver
from pouring_robot.robot.pouring.poses import PlatformPose
from pouring_robot.robot.pouring_robot import PouringRobot
from pouring_robot.thermal.expansion.growth import ThermalExpansion


class WarmRobot(PouringRobot):
    """The robot as built, its parts grown by heat: does what :class:`PouringRobot` does, warm.

    Heat is applied first and the geometric error in the joint's displaced frame, so that a U-joint centre stands at
    its grown nominal place plus its offset. Where the legs that are not driven stand at a pose, their growth displaces
    a joint; so the robot is made for one pose, and elsewhere the value of such a leg's joint (nothing else) is off by
    the change of its growth.

    Args:
        robot: its model holds the geometric errors; its loads act here too.
        expansion: how much the parts have grown.
        pose: that the robot is made for.
        passive_lengths_m: length without heat of each leg that is not driven, by its prismatic joint; by default that
            of the drawing at the pose.
    """

    def __init__(
        self,
        robot: PouringRobot,
        expansion: ThermalExpansion,
        pose: PlatformPose,
        passive_lengths_m: Mapping[str, float] | None = None,
    ) -> None:
        # Not super().__init__: model, nominal solver and kinematics are the given robot's, and building takes time.
        self.__dict__.update(vars(robot))
        self.expansion, self.pose = expansion, pose
        passive = passive_lengths_m or passive_lengths(robot, robot.kinematics.joint_values(pose))
        mechanism = robot.kinematics.mechanism.with_stiffness(robot.actual_solver.mechanism.loops.stiffness)
        for errors in (expansion.placements(robot.kinematics, passive), robot.model.placement_errors()):
            mechanism = mechanism.displaced({joint: error.to_se3() for joint, error in errors.items()})
        self.actual_solver = ClosureSolver(mechanism, robot.actual_solver.energy.loads, robot.actual_solver.options)

    def actual_drives(self, drives: Mapping[str, float]) -> dict[str, float]:
        """Return where the drives stand for commanded values, in m and rad: offset, then grown with the leg."""
        growth = self.expansion.drive_offsets(drives, self._drive_offsets)
        return {name: value + growth.get(name, 0.0) for name, value in super().actual_drives(drives).items()}

    def solve(self) -> ClosureResult:
        """Close the robot at the drive values that a controller commands for its pose.

        Raises:
            UnreachablePoseError: a joint would pass its limits.
            ClosureError: the loops do not close.
        """
        return self.forward(self.kinematics.inverse(self.pose), near=self.pose)


def passive_lengths(robot: PouringRobot, joint_values: Mapping[str, float]) -> dict[str, float]:
    """Return the value of the prismatic joint of each leg that is not driven, in m, by its name."""
    drives = robot.nominal_solver.mechanism.loops.drives
    return {name: value for name, value in joint_values.items() if name.endswith("_s3") and name not in drives}


def drawing_of(robot: PouringRobot) -> PouringRobot:
    """Return the robot of the drawing of the same layout: no geometric errors, no drive offsets, no loads."""
    bare = robot.model.model_copy(update={"joint_placements": {}, "drive_offsets": {}})
    return PouringRobot(bare, options=robot.actual_solver.options)
