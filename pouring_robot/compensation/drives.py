"""Drive values that bring any robot as built to where the drawing would stand: its place first, then its attitude."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from pouring_robot.exceptions import CompensationError, UnreachablePoseError
from pouring_robot.io.tables import csv_text
from pouring_robot.mechanism.poses import MM, MRAD, PoseDifference
from pouring_robot.mechanism.reach import joint_reach
from pouring_robot.report.result import Result
from pouring_robot.robot.description.command import CommandAxis
from pouring_robot.robot.inverse import Target, bring
from pouring_robot.robot.location import Location, drive_words
from pouring_robot.robot.location_figures import difference_figures, joint_figures
from pouring_robot.robot.robot import Robot


@dataclass(frozen=True, eq=False, repr=False)
class DriveCompensation(Result):
    """What to command, and what it leads to. Differences are actual minus wanted, in the base's axes."""

    wanted: Location  # where the robot should be, and where it is without compensation
    frame: str  # that is brought there
    drives: dict[str, float]  # values to command instead, in m and rad
    columns: dict[str, CommandAxis]  # of a table of commands by drive, each with what it needs for the joint's value
    before: PoseDifference  # of the frame without compensation
    left: PoseDifference  # and with it: what the drives cannot cancel

    @property
    def headline(self) -> str:
        """How far off the frame was and is, and what to command."""
        return (
            f"'{self.frame}' {self.before.distance_m / MM:.3f} mm and {self.before.angle_rad / MRAD:.3f} mrad off "
            f"without compensation, {self.left.distance_m / MM:.1e} mm and {self.left.angle_rad / MRAD:.1e} mrad with "
            f"it: {', '.join(drive_words(self.wanted.nominal.mechanism, self.drives))}"
        )

    def row(self) -> dict[str, float]:
        """Return what to command by column of a table of commands, and how far off the frame was and is."""
        commands = {axis.heading: axis.shown(self.drives[name]) for name, axis in self.columns.items()}
        sizes = {"error_before": self.before, "error_left": self.left}
        figures = {f"{name}_mm": size.distance_m / MM for name, size in sizes.items()}
        return commands | figures | {f"{name}_mrad": size.angle_rad / MRAD for name, size in sizes.items()}

    def _table(self) -> Any:
        return [self.row()]

    def figures(self) -> dict[str, Any]:
        """Return everything known, ready for JSON."""
        mechanism = self.wanted.nominal.mechanism
        return {
            "frame": self.frame,
            "wanted": joint_figures(mechanism, self.wanted.drives),
            "drives": joint_figures(mechanism, self.drives),
            "before": difference_figures(self.before),
            "left": difference_figures(self.left),
        }


def compensate_drives(robot: Robot, wanted: Location, frame: str | None = None) -> DriveCompensation:
    """Return the drive values that bring the actual robot to a location of the drawing.

    ``frame``: that shall be there; by default the one whose error counts.

    Raises:
        UnknownFrameError: there is no such frame.
        NoSolutionError: a joint would pass its limits, no drive values are found, or the loops do not close on the way.
    """
    frame = frame or wanted.loops.working_frame
    nominal, _ = wanted.poses(frame)
    target = Target(nominal.translation, nominal.rotation, frame)
    here, solver = np.array(list(wanted.drives.values())), robot.actual_solver
    ranks = bring(robot.nominal_solver, robot.close_nominal, target, here, wanted.nominal.configuration).ranks
    found = bring(solver, robot.close_actual, target, here, wanted.actual.configuration, ranks)
    drives = dict(zip(wanted.drives, found.drives.tolist(), strict=True))
    left = PoseDifference.between(nominal, found.result.pose(wanted.loops.base_frame, frame))
    if not found.settled:
        raise CompensationError(wanted.command, left.distance_m, left.angle_rad)
    for worst in joint_reach(solver.mechanism, found.result.joint_values | drives)[:1]:
        if worst.margin < 0.0:
            raise UnreachablePoseError(worst.joint, worst.value, worst.lower, worst.upper, worst.unit)
    definition = robot.model.definition
    axes = definition.drive_axes(robot.nominal_solver.mechanism)
    columns = {drive.joint: axis for drive, axis in zip(definition.drives, axes, strict=True)}
    return DriveCompensation(wanted, frame, drives, columns, wanted.difference(frame), left)


def drives_csv(found: Iterable[DriveCompensation]) -> str:
    """Return one row a command as CSV; ``path`` reads the drives of it."""
    rows = [one.row() for one in found]
    return csv_text(list(rows[0]), [[f"{value:.12g}" for value in row.values()] for row in rows])
