"""Where the ladle is: the nominal robot and the robot as built, side by side.

The controller knows only the drawing. It turns a wanted pose into drive values by the nominal inverse kinematics; the
robot as built takes these drive values and closes its own loops. The difference between the two is the ladle's error.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from pouring_robot.batch.records import BatchClosure, BatchCommand, BatchStart
from pouring_robot.exceptions import BadInputError, NoSolutionError, UnreachablePoseError
from pouring_robot.io.argument_checks import expect
from pouring_robot.mechanism.arrays import BoolArray, FloatArray
from pouring_robot.mechanism.closure.energy import Loads
from pouring_robot.mechanism.closure.solver import ClosureOptions, ClosureResult
from pouring_robot.mechanism.closure.status import CLOSED, NOT_CONVERGED, STATUS_NAMES
from pouring_robot.mechanism.conditioning import AxisWeakness, axis_weakness
from pouring_robot.mechanism.joint_limits import ROUND_OFF, joint_reach, refuse_beyond
from pouring_robot.robot.command_table import read_pose_lines
from pouring_robot.robot.location import OUT_OF_REACH, LadleLocation, Location, as_poses, error_dataset
from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.pouring.kinematics import TASK_ROWS, FourUPUKinematics
from pouring_robot.robot.pouring.layout import load_layout, stale_mesh_note
from pouring_robot.robot.pouring.layout_schema import Layout
from pouring_robot.robot.pouring.platform_pose import PlatformPose
from pouring_robot.robot.robot import LOCATED, Command, Robot

if TYPE_CHECKING:
    import xarray as xr


class PouringRobot(Robot):
    """The pouring robot (default: its drawing), a :class:`Robot` commanded by poses; BadInputError for another one."""

    def _make(self, model: RobotModel, loads: Loads, options: ClosureOptions) -> None:
        super()._make(model, loads, options)
        if not isinstance(self.drawing, FourUPUKinematics):
            raise BadInputError(f"the model is one of {self.model.definition.name}: load it with Robot.load")
        self.kinematics = self.drawing

    @functools.cached_property
    def layout(self) -> Layout:
        """Sizes of every part, as the dimensions file has them."""
        return load_layout(self.model.layout, self.model.layouts_path)

    def forward(self, drives: dict[str, float], near: PlatformPose | None = None) -> ClosureResult:
        """Close the robot as built for drives l1, l2, l3 (m) and theta46 (rad), by joint name.

        The closure starts at the pose ``near``, by default the nominal pose for these drives.
        """
        return self._closed_as_built(drives, self.kinematics.configuration(near or self.kinematics.forward(drives)))

    def _closed_as_built(self, drives: dict[str, float], start: FloatArray) -> ClosureResult:
        """Close the robot as built for commanded drive values, and check its own joints against their limits."""
        result = self.actual_solver.solve(self.actual_drives(drives), start)
        # Far from the start the loops may close in another assembly mode, whose joints are then beyond their limits.
        refuse_beyond(joint_reach(self.kinematics.mechanism, result.joint_values))
        return result

    @overload
    def locate(self, pose: PlatformPose) -> LadleLocation: ...
    @overload
    def locate(self, pose: Sequence[PlatformPose] | ArrayLike) -> xr.Dataset: ...
    def locate(self, pose: PlatformPose | Sequence[PlatformPose] | ArrayLike) -> LadleLocation | xr.Dataset:
        """Return where the ladle should be and where it is for a commanded pose, or for many.

        Args:
            pose: one pose; or a sequence of poses, or an array of x, y, z in m and the tilt in rad, shape (n, 4).

        Returns:
            For one pose its location. For many a dataset with the dimensions ``pose``, ``frame`` and ``axis``: nominal
            and actual positions (m), rotation vectors (rad) and their differences, and a ``status``. A pose without a
            solution is NaN, and its status says why; no error is raised for it.

        Raises:
            BadInputError: the input is not a pose or poses, as in :meth:`locate_drives`.
        """
        if isinstance(pose, pin.SE3):
            raise BadInputError("an SE3 has six freedoms, the platform four: give PlatformPose.from_se3(pose)")
        if not isinstance(pose, PlatformPose):
            return self._located_many(as_poses(pose))
        drives = self.kinematics.inverse(pose)
        start = self.kinematics.configuration(pose)
        outside_m, outside_rad = self.outside_workspace(pose)
        return LadleLocation(
            commanded=pose,
            drives=drives,
            nominal=self.nominal_solver.solve(drives, start),
            actual=self._closed_as_built(drives, start),
            reach=joint_reach(self.kinematics.mechanism, self.kinematics.joint_values(pose)),
            outside_workspace_m=outside_m,
            outside_workspace_rad=outside_rad,
        )

    def _located_many(self, poses: FloatArray) -> xr.Dataset:
        if not self.loaded:
            command = self.kinematics.commands(poses)
            return self.path_dataset(command, self.close(command.drives, command.start))
        loops, status = self.drawing.mechanism.loops, []
        both = np.full((2, len(poses), len(loops.reported_frames), 3, 4), np.nan)
        for k, pose in enumerate(poses):
            try:
                location = self.locate(self.command_at(pose))
            except NoSolutionError as problem:
                status.append(
                    OUT_OF_REACH if isinstance(problem, UnreachablePoseError) else STATUS_NAMES[NOT_CONVERGED]
                )
                continue
            status.append(STATUS_NAMES[CLOSED])
            for i, frame in enumerate(loops.reported_frames):
                both[:, k, i] = [found.homogeneous[:3] for found in location.poses(frame)]
        return error_dataset(loops, np.array(status), both[0], both[1], _commanded(poses))

    def path_dataset(self, command: BatchCommand, closed: BatchClosure) -> xr.Dataset:
        """Return nominal and actual ladle poses as a dataset, from commands and the closures of the robot as built."""
        return self._dataset(command.start, closed, self._in_reach(command.start, closed), _commanded(command.poses))

    def _in_reach(self, start: BatchStart, closed: BatchClosure) -> BoolArray:
        return super()._in_reach(start, closed) & (~closed.closed | self.drawing.in_reach(closed.as_start()))

    def _located(self, drives: FloatArray, nominal: ClosureResult) -> LadleLocation:
        return self.locate(self.kinematics.forward(self.kinematics.mechanism.named_drives(drives)))

    @property
    def accuracy_m(self) -> float:
        """Required accuracy of the pouring lip, in m."""
        return self.layout.workspace.accuracy.metres

    @property
    def picture_notes(self) -> tuple[str, ...]:
        """A note if the ladle's mesh is not that of the layout."""
        note = stale_mesh_note(self.model.layout, self.model.layouts_path)
        return (note,) if note else ()

    def read_commands(self, path: Path, beside: Iterable[str] = ()) -> dict[int, PlatformPose]:
        """Read poses from a table, by line number, like :meth:`Robot.read_commands`."""
        return read_pose_lines(path, beside, self.model.definition.drive_columns)

    def pose_command(self, position_m: FloatArray, turn_rad: FloatArray | None) -> PlatformPose:
        """Return the pose with a position and a rotation about y."""
        turn = np.zeros(3) if turn_rad is None else turn_rad
        if turn[0] or turn[2]:
            raise BadInputError("the platform turns about y only: give a tilt")
        return self.command_at(np.append(position_m, turn[1]))

    def location_in_the_middle(self) -> LadleLocation:
        """Return the ladle's location in the middle of the workspace box."""
        return self.locate(self.command_at(np.mean(self.layout.box, axis=0)))

    def command_at(self, values: FloatArray) -> PlatformPose:
        """Return the pose with x, y, z in m and the tilt in rad, (4,)."""
        return PlatformPose.of_values(values)

    def drives_of(self, command: Command) -> FloatArray:
        """Return the drive values, (4,), in m and rad, for a pose, a target or drive values."""
        if not isinstance(command, PlatformPose):
            return super().drives_of(command)
        return np.array(list(self.kinematics.inverse(command).values()))

    def location_of(self, command: Command) -> Location:
        """Return the ladle's location for a pose, a target or drive values (4,), in m and rad."""
        return self.locate(command) if isinstance(command, PlatformPose) else super().location_of(command)

    def actual_of(self, command: Command) -> ClosureResult:
        """Return the closed robot as built at a pose, a target or drive values: the ``actual`` of its location."""
        if not isinstance(command, PlatformPose):
            return super().actual_of(command)
        return self.forward(self.kinematics.inverse(command), near=command)

    def outside_workspace(self, pose: PlatformPose) -> tuple[FloatArray, float]:
        """Return how far a pose is outside the workspace box: per axis, shape (3,), in m, and in tilt, in rad."""
        expect(pose, PlatformPose, "a pose is a PlatformPose")
        (lower, upper), values = self.layout.box, np.array(pose.values)
        outside = np.maximum(lower - values, 0.0) + np.maximum(values - upper, 0.0)
        outside[outside < ROUND_OFF] = 0.0  # a box limit typed in mm or degrees must not count as outside by round-off
        return outside[:3], float(outside[3])

    _task_rows = TASK_ROWS

    def _length_m(self, location: Location) -> float:
        return float(np.linalg.norm(self.kinematics.moving_centres_m, axis=1).mean())

    def axis_weakness(self, location: Location) -> AxisWeakness:
        """Return how far the tilt of one joint axis moves the pouring lip sideways, for the worst joint."""
        expect(location, Location, LOCATED)
        return axis_weakness(self.actual_solver, location.actual, location.loops.working_frame)


def _commanded(poses: FloatArray) -> dict[str, Any]:
    return {
        "commanded_position": (("pose", "axis"), poses[:, :3], {"units": "m"}),
        "commanded_tilt": ("pose", poses[:, 3], {"units": "rad"}),
    }


def robot_of(model: RobotModel) -> Robot:
    """Return the robot of a model, of the class that suits it; see :meth:`Robot.without_warning`."""
    return (Robot if model.robot else PouringRobot).without_warning(model)


def load_robot(model: RobotModel | Path | str | None = None) -> PouringRobot:
    """Load a robot from a model, its file, or (default) the drawing of the default layout; raises like ``Robot.load``.

    Heat and effects that depend on conditions are not applied; a warning says so where the model has them.
    ``HeatedRobot(robot, robot.model.heat)`` applies the heat, ``robots_under`` the effects.
    """
    return PouringRobot.load(model)
