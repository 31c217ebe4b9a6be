"""Drive values that bring the actual ladle, with its geometric errors and its heat, to the wanted pose.

Four drives command four freedoms: x, y, z of a frame on the moving platform and the tilt about y. Newton with the exact
Jacobian of the closed mechanism solves for them at constant temperatures; then temperatures are computed again where
the ladle now is, and so on until that changes nothing (``expansion.warm_pouring_robot``). The two other rotations of
the platform, roll about x and yaw about z, follow from the errors and cannot be commanded. They remain, with their
effect on the lip.

Any other robot is brought to where its drawing would be, its position first, then its attitude.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from pouring_robot.compensation.drives import bring_to
from pouring_robot.exceptions import BadInputError, ClosureError, CompensationError, LockedPoseError
from pouring_robot.io.argument_checks import expect
from pouring_robot.io.tables import csv_text
from pouring_robot.io.units import MM, MRAD
from pouring_robot.mechanism.arrays import FloatArray, finite
from pouring_robot.mechanism.closure.solver import ClosureResult
from pouring_robot.mechanism.joint_limits import joint_reach, refuse_beyond
from pouring_robot.mechanism.local_parameters import drive_parameters
from pouring_robot.mechanism.poses import PoseDifference
from pouring_robot.mechanism.rotations import tilt_rates
from pouring_robot.mechanism.transfer import closed_chain_transfer
from pouring_robot.report.result import Result
from pouring_robot.robot.description.command import CommandAxis
from pouring_robot.robot.inverse import REACHED, Target, limited, longest_steps, settled
from pouring_robot.robot.location import Location, drive_words
from pouring_robot.robot.location_figures import difference_figures, joint_figures
from pouring_robot.robot.pouring.names import DRIVE_COLUMNS
from pouring_robot.robot.pouring.platform_pose import PlatformPose
from pouring_robot.robot.pouring_robot import PouringRobot
from pouring_robot.robot.robot import Robot
from pouring_robot.thermal.expansion.warm_pouring_robot import HeatedRobot, WarmRobot, WarmState

# Drives and commands have 12 decimals so that reading them gives back what was solved.
_FORMATS = {"wanted": "{:.12g}", "command": "{:.12f}"} | dict.fromkeys(DRIVE_COLUMNS, "{:.12f}")
LOCKED = 1e-9
"""Where :func:`least_commanded` does not exceed this, no drives move the frame along some direction."""
MOST_STEPS = 25
_FAR = 0.1
"""Share of Newton's longest step: drives whose effect is larger than this, 10 mm or 0.03 rad, are reported. Over such a
step a Jacobian changes by 3 %; in nine of ten poses of the examples' robots errors within the tolerances need less."""


@dataclass(frozen=True, eq=False, repr=False)
class Compensation(Result):
    """What to command, and its results. Differences are actual minus wanted, in the fixed platform."""

    wanted: PlatformPose
    frame: str  # whose position is brought to where that pose has it
    drives: dict[str, float]  # drive values to command, in m and rad
    # the pose of the drawing with these drive values: what to command if the controller knows the drawing
    command: PlatformPose
    before: PoseDifference  # of the frame, if the wanted pose itself were commanded
    left: PoseDifference  # and with ``drives``
    left_at_lip: PoseDifference  # of the lip, with ``drives``: the effect of the two rotations there
    left_tilt_rad: float  # remaining error of the tilt
    steps: int  # Newton steps taken in all
    state: WarmState  # temperatures, warm robot and closure with ``drives``

    @property
    def uncontrolled_rad(self) -> tuple[float, float]:
        """The two rotations that cannot be commanded: about x and about z, in rad."""
        return float(self.left.rotation_rad[0]), float(self.left.rotation_rad[2])

    @property
    def headline(self) -> str:
        """How far off the frame was and is, on one line."""
        return (
            f"'{self.frame}' {self.before.distance_m / MM:.3f} mm off without compensation, "
            f"{self.left.distance_m / MM:.1e} mm with it; the lip stays {self.left_at_lip.distance_m / MM:.3f} mm off"
        )

    def row(self) -> dict[str, float]:
        """Return the pose wanted, the drives to command, the pose to command, and the remaining errors."""
        *lengths_m, tilt_drive = self.drives.values()
        roll, yaw = self.uncontrolled_rad
        *lengths, angle = DRIVE_COLUMNS
        return {
            **{f"wanted_{name}": value for name, value in self.wanted.figures().items()},
            **{f"{name}_mm": value / MM for name, value in zip(lengths, lengths_m, strict=True)},
            f"{angle}_rad": tilt_drive,
            **{f"command_{name}": value for name, value in self.command.figures().items()},
            "before_mm": self.before.distance_m / MM,
            "left_mm": self.left.distance_m / MM,
            "left_tilt_mrad": self.left_tilt_rad / MRAD,
            "roll_mrad": roll / MRAD,
            "yaw_mrad": yaw / MRAD,
            "left_at_lip_mm": self.left_at_lip.distance_m / MM,
        }

    def _table(self) -> Any:
        return [self.row()]

    def figures(self) -> dict[str, Any]:
        """Return everything known, ready for JSON."""
        roll, yaw = self.uncontrolled_rad
        result = self.state.result
        return {
            "wanted": self.wanted.figures(),
            "frame": self.frame,
            "drives": joint_figures(result.mechanism, self.drives),
            "command": self.command.figures(),
            "before": difference_figures(self.before),
            "left": difference_figures(self.left) | {"tilt_mrad": self.left_tilt_rad / MRAD},
            "left_at_lip": difference_figures(self.left_at_lip),
            "uncontrolled_mrad": {"roll": roll / MRAD, "yaw": yaw / MRAD},
            "left_open": {"mm": result.gap_m / MM, "mrad": result.gap_rad / MRAD},
            "newton_steps": self.steps,
            "temperatures_taken": self.state.turns,
            "unsettled_mm": self.state.unsettled_m / MM,
        }


def commands_csv(found: Iterable[Compensation]) -> str:
    """Return one row per pose as CSV."""
    rows = [one.row() for one in found]
    formats = [_FORMATS.get(name.split("_")[0], "{:.6g}") for name in rows[0]]
    return csv_text(rows[0], ([f.format(v) for f, v in zip(formats, row.values(), strict=True)] for row in rows))


@dataclass
class _Search:
    """Newton's method for one pose; counts its steps over all iterations of temperature.

    ``target_m``: where the frame's origin is wanted in the fixed platform, (3,); ``start``: configuration near which to
    begin; ``drives``: values found last, in m and rad.
    """

    wanted: PlatformPose
    target_m: FloatArray
    start: FloatArray
    frame: str
    drives: dict[str, float]
    steps: int = 0

    def close(self, warm: WarmRobot) -> list[ClosureResult]:
        """Bring a warm robot to the pose, from the drive values found last; return the closures on the way."""
        start, best, way = self.start, np.inf, []
        for _ in range(MOST_STEPS):
            result = warm.actual_solver.solve(warm.actual_drives(self.drives), start)
            way.append(result)
            left = self.left(result)
            size = float(np.abs(left).max())
            if settled(size, best):
                return way
            best = min(best, size)
            step = limited(self._step(warm, result, left), result.mechanism)
            # The actual drive is the commanded one, grown with its leg: its derivative is 1 + strain, taken as 1.
            self.drives = {name: value + float(d) for (name, value), d in zip(self.drives.items(), step, strict=True)}
            start = result.configuration
            self.steps += 1
        x, y, z, tilt = self.wanted.to_mm_deg()
        command = f"x {x:g}, y {y:g}, z {z:g} mm, tilt {tilt:g} deg"
        raise CompensationError(command, float(np.linalg.norm(left[:3])), abs(float(left[3])))

    def left(self, result: ClosureResult) -> FloatArray:
        """Return the remaining error: x, y, z of the frame in m and the platform's tilt in rad, actual minus wanted."""
        place = result.pose(result.mechanism.loops.base_frame, self.frame).translation
        tilt = PlatformPose.from_se3(result.pose_base_to_end).tilt_rad - self.wanted.tilt_rad
        return np.array([*(place - self.target_m), tilt])

    def _step(self, warm: WarmRobot, result: ClosureResult, left: FloatArray) -> FloatArray:
        """Return the step of the drives that cancels what is left, (4,); raises LockedPoseError if none does."""
        drives = drive_parameters(result.mechanism)
        twists = closed_chain_transfer(warm.actual_solver, result, drives, self.frame).matrix
        matrix = np.vstack([twists[:3], tilt_rates(result.pose_base_to_end.rotation, twists[3:])])
        if not (ratio := float(least_commanded(matrix))) > LOCKED:
            raise LockedPoseError(ratio)
        return np.asarray(-np.linalg.solve(matrix, left))


def least_commanded(matrix: FloatArray) -> FloatArray:
    """Return least over largest singular value, (...), of derivatives by the drives of what is wanted, (..., 4, 4)."""
    factors = np.linalg.svd(matrix, compute_uv=False)
    return np.asarray(factors[..., -1] / factors[..., 0])


def compensate(
    heated: HeatedRobot | PouringRobot,
    wanted: PlatformPose,
    frame: str | None = None,
    heat_moves_m: ArrayLike | None = None,
) -> Compensation:
    """Return the drive values that bring the actual ladle to a pose.

    Args:
        heated: the robot as built and how warm it is; a PouringRobot is cold.
        wanted: x, y, z and tilt of the moving platform, as for a robot of the drawing.
        frame: the frame whose position shall be where that pose has it in the drawing; by default the moving platform.
            With the lip, the platform moves so that the lip is right.
        heat_moves_m: what heat adds to the position by a thermal model, shape (3,). The drives are then found by the
            paper's sum: for the cold robot, sent as far the opposite way. What is left is that of the full closure.

    Raises:
        BadInputError: the robot or the pose is not one, or ``heat_moves_m`` is no displacement.
        UnreachablePoseError: a joint of the actual robot, or a commanded drive, would pass its limits.
        CompensationError: no drive values are found.
        SingularPoseError: the drives do not determine the platform at this pose.
        LockedPoseError: they do not command its four freedoms there.
        ClosureError: the loops do not close.
        ThermalSolutionError: no temperatures are found.
        UnknownFrameError: there is no such frame.
    """
    heated = heated if isinstance(heated, HeatedRobot) else HeatedRobot(heated)
    kinematics = heated.robot.kinematics
    loops = kinematics.mechanism.loops
    frame = frame or loops.end_frame or ""
    values = kinematics.joint_values(wanted)
    commanded = {name: values[name] for name in loops.drives}
    start = kinematics.configuration(wanted)

    def nominal(name: str) -> pin.SE3:
        return wanted.to_se3() * kinematics.mechanism.placement_on_end(name)

    def held(drives: dict[str, float]) -> WarmState:
        return heated.settle(wanted, lambda warm: [warm.actual_solver.solve(warm.actual_drives(drives), start)])

    try:
        search = _Search(wanted, nominal(frame).translation, start, frame, dict(commanded))
        if heat_moves_m is None:
            state = heated.settle(wanted, search.close)
        else:
            said = "the displacement by heat is three finite numbers (x, y, z), in m"
            search.target_m = search.target_m - finite(heat_moves_m, (3,), said)
            HeatedRobot(heated.robot).settle(wanted, search.close)
            state = held(search.drives)
        result = state.result
        refuse_beyond(joint_reach(kinematics.mechanism, search.drives))
        refuse_beyond(joint_reach(kinematics.mechanism, result.joint_values))
    except (ClosureError, CompensationError, LockedPoseError):
        # A pose beyond the limits also does not close; a user can understand and mend the limit.
        refuse_beyond(joint_reach(kinematics.mechanism, values))
        raise

    def difference(closed: ClosureResult, name: str) -> PoseDifference:
        return PoseDifference.between(nominal(name), closed.pose(loops.base_frame, name))

    command, before = kinematics.forward(search.drives, near=wanted), difference(held(commanded).result, frame)
    left, at_lip, tilt = difference(result, frame), difference(result, loops.working_frame), search.left(result)[3]
    return Compensation(wanted, frame, search.drives, command, before, left, at_lip, float(tilt), search.steps, state)


@dataclass(frozen=True, eq=False, repr=False)
class DriveCompensation(Result):
    """What to command, and its results. Differences are actual minus wanted, in the base's axes."""

    wanted: Location  # where the robot should be, and where it is without compensation
    frame: str  # that is brought there
    drives: dict[str, float]  # values to command instead, in m and rad
    columns: dict[str, CommandAxis]  # of a table of commands by drive, each with what it needs for the joint's value
    before: PoseDifference  # of the frame without compensation
    left: PoseDifference  # and with it: what the drives cannot cancel
    # whether the drives command more beside the wanted pose than in it: those found then move further than elsewhere
    singular: bool = False
    kept: bool = False  # whether nothing better was found there, so that ``drives`` are those of the wanted pose

    @property
    def worse(self) -> dict[str, float]:
        """What has a larger error with compensation than without, and by how much: position (m), attitude (rad)."""
        more = {
            "position": self.left.distance_m - self.before.distance_m,
            "attitude": self.left.angle_rad - self.before.angle_rad,
        }
        return {name: size for name, size in more.items() if size > REACHED}

    @property
    def status(self) -> str:
        """``reached``, ``nearest`` (not all is cancelled) or ``kept`` (if singular); ``singular``; what is worse."""
        met = max(self.left.distance_m, self.left.angle_rad) < REACHED
        words = ["kept" if self.kept else "reached" if met else "nearest"]
        return " + ".join([*words, *["singular"] * self.singular, *(f"{name} worse" for name in self.worse)])

    @property
    def headline(self) -> str:
        """How far off the frame was and is, and what to command."""
        off = f"'{self.frame}' {self.before.distance_m / MM:.3f} mm and {self.before.angle_rad / MRAD:.3f} mrad off"
        left = f"{self.left.distance_m / MM:.3g} mm and {self.left.angle_rad / MRAD:.3g} mrad with it"
        said = f"{off} without compensation, {left}"
        if self.kept:
            why = "the pose is (nearly) singular and nothing better was found; the drives are kept"
            said = f"{off}, not compensated: {why}"
        return f"{said}: {', '.join(drive_words(self.wanted.nominal.mechanism, self.drives))}"

    def row(self) -> dict[str, float | str]:
        """Return what to command by column of a table of commands, how far off the frame was and is, and the status."""
        commands = {axis.heading: axis.shown(self.drives[name]) for name, axis in self.columns.items()}
        sizes = {"error_before": self.before, "error_left": self.left}
        figures = {f"{name}_mm": size.distance_m / MM for name, size in sizes.items()}
        figures |= {f"{name}_mrad": size.angle_rad / MRAD for name, size in sizes.items()}
        return {**commands, **figures, "status": self.status}

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
            "status": self.status,
        }


def compensate_drives(robot: Robot, wanted: Location, frame: str | None = None) -> DriveCompensation:
    """Return the drive values that bring the actual robot to a location of the drawing.

    Errors that the drives command there are cancelled, the position first. In or near a singular location the drives
    may have to move far for that; where nothing better is found, those of the location are kept. ``status`` states
    both. A drive that is beyond a limit by round-off is put on the limit.

    ``frame``: the one to bring there; by default the one whose error counts.

    Raises:
        BadInputError: it is no location, or one of another drawing.
        UnknownFrameError: there is no such frame.
        NoSolutionError: a joint would pass its limits, or the loops do not close on the way.
    """
    expect(wanted, Location, "the wanted location is a Location, as robot.location_at(drives) returns")
    if wanted.nominal.mechanism.urdf != robot.nominal_solver.mechanism.urdf:
        raise BadInputError("the wanted location belongs to another drawing than this robot's")
    if wanted.actual.mechanism is not robot.actual_solver.mechanism:  # of the drawing, or of another robot built by it
        here = np.array(list(wanted.drives.values()))
        wanted = replace(wanted, actual=robot.close_actual(here, wanted.nominal.configuration))
    frame = frame or wanted.loops.working_frame
    nominal, actual = wanted.poses(frame)
    found, singular = bring_to(robot, wanted, Target(nominal.translation, nominal.rotation, frame))
    definition, before = robot.model.definition, PoseDifference.between(nominal, actual)
    axes = definition.drive_axes(robot.nominal_solver.mechanism)
    columns = {drive.joint: axis for drive, axis in zip(definition.drives, axes, strict=True)}
    drives, result = dict(wanted.drives), wanted.actual
    if found is not None:
        drives, result = dict(zip(drives, found.drives.tolist(), strict=True)), found.result
    reach = joint_reach(robot.actual_solver.mechanism, result.joint_values | drives)
    refuse_beyond(reach)
    inside = {one.joint: min(max(one.value, one.lower), one.upper) for one in reach if one.margin < 0.0}
    if over := {joint: value for joint, value in inside.items() if joint in drives}:
        # By round-off, also of kept drives: a controller accepts a value on the limit; the error left is that of this.
        drives |= over
        result = robot.close_actual(np.array(list(drives.values())), result.configuration)
    left = PoseDifference.between(nominal, result.pose(wanted.loops.base_frame, frame))
    return DriveCompensation(wanted, frame, drives, columns, before, left, singular, kept=found is None)


def drives_csv(found: Iterable[DriveCompensation]) -> str:
    """Return one row per command as CSV; ``path`` reads its drives."""
    rows = [one.row() for one in found]
    shown = ([one if isinstance(one, str) else f"{one:.12g}" for one in row.values()] for row in rows)
    return csv_text(list(rows[0]), shown)


def drive_notes(found: Sequence[DriveCompensation]) -> list[str]:
    """Return what to know about commands before they are sent to a robot, a line each."""
    notes, many = [], f"of {len(found)} poses"

    def far(one: DriveCompensation) -> list[tuple[float, str]]:
        """Return how far drives move that move far from what was wanted, in m or rad, and which these are."""
        steps = zip(one.drives, longest_steps(one.wanted.nominal.mechanism), strict=True)
        moved = [(abs(one.drives[name] - one.wanted.drives[name]), name, step) for name, step in steps]
        return [(way, name) for way, name, step in moved if way > _FAR * step]

    if ways := [way for one in found if (way := far(one))]:
        mechanism = found[0].wanted.nominal.mechanism
        ascending = sorted(pair for way in ways for pair in way)
        furthest = {mechanism.unit_of(name): (name, way) for way, name in ascending}  # the last of each unit
        by = " and ".join(drive_words(mechanism, dict(furthest.values())))
        notes.append(
            f"compensated drives are far from the given ones: {len(ways)} {many}, by up to {by}; errors are large, or "
            "poses are (nearly) singular (arm stretched, axes aligned): check this before the robot moves"
        )
    if kept := sum(one.kept for one in found):
        notes.append(
            f"not compensated, as (nearly) singular with nothing better found: {kept} {many}; their drives are kept"
        )
    for what, unit, scale, why in (
        ("position", "mm", MM, "command the uncompensated drives there"),
        ("attitude", "mrad", MRAD, "the drives cannot cancel everything, and position comes first"),
    ):
        if worse := [one.worse[what] for one in found if what in one.worse]:
            notes.append(
                f"{what} further off with compensation than without: {len(worse)} {many}, by up to "
                f"{max(worse) / scale:.2g} {unit}; {why}"
            )
    return notes
