"""``pouring-robot path``: where a robot is along a list of commands."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from pouring_robot.cli.shared import bundles, options, progress
from pouring_robot.cli.shared.options import argument, writes_csv
from pouring_robot.exceptions import BadInputError, NoSolutionError
from pouring_robot.io.units import MM, MRAD

if TYPE_CHECKING:
    from pouring_robot.robot.heat_section import HeatSection
    from pouring_robot.robot.location import Location
    from pouring_robot.robot.robot import Command, Robot

Row = dict[str, Any]


def path(
    *,
    poses: Annotated[
        Path,
        argument(
            "POSES.csv", "Columns x_mm, y_mm, z_mm, tilt_deg; for another robot its drives, or x, y, z and rx, ry, rz."
        ),
    ],
    which: bundles.RobotOptions,
    under: bundles.ConditionOptions,
    as_json: options.AsJson = False,
    out: Annotated[Path | None, writes_csv("Write the table.")] = None,
    drawing: bundles.Drawing,
    at_once: options.AtOnce = False,
    heat: bundles.Heat,
) -> None:
    """Compute where the ladle, or another robot, is for every command of a table, one row each.

    Each pose of a warm robot is computed on its own: in the steady state, or after --after-min from cold.
    """
    from pouring_robot.cli.poses import heat as warm
    from pouring_robot.cli.shared import locations as places
    from pouring_robot.io.tables import rows_csv
    from pouring_robot.robot.location import LadleLocation
    from pouring_robot.robot.location_figures import location_figures

    present = which.built(warm=True, under=True)
    commanded = under.read_commands(present, poses)
    warmth = heat.of(present)
    if at_once:
        if drawing.html or drawing.png:
            raise BadInputError("--at-once draws nothing; leave out --html and --png, or --at-once")
        under.refuse_with("--at-once", present)
        _at_once(present, warmth, commanded, drawing, out, as_json)
        return
    robots, conditions = under.robots(present, commanded, poses)
    heated = warm.heated_of(present, warmth)
    figures = []

    def locate(command: Command, robot: Robot) -> warm.Warmth:
        one = warm.Warmth.of(robot, heated and heated.built_as(options.with_melt(robot)), command)
        if as_json:  # may raise at a singular pose: do it before anything is written
            figures.append(location_figures(one.location, one.robot.dexterity(one.location)) | one.figures())
        return one

    found = bundles.each(commanded, robots, poses, "closing", locate)
    locations = [one.location for one in found]
    notes = places.location_notes(present, drawing, which.model)
    notes += (*conditions, *warm.twice_lines(present, warmth))
    drawn, unlike_the_tree = drawing.files(locations, present.model, warm=heated is not None)
    notes += unlike_the_tree
    rows = [_row(location) for location in locations]
    written = options.write_all(options.wanted(out, lambda: rows_csv(rows)) | drawn)
    if as_json:
        return options.print_figures({**present.model.named, "poses": figures, "notes": notes}, written)
    if first := found[0].warm:
        notes.append(f"{warm.heat_line(*first)} (first pose)")
        if warmth is not None and len(found) > 1:
            notes.append(warm.alone_line(warmth))
    notes += places.outside_notes(isinstance(one, LadleLocation) and not one.in_workspace for one in locations)
    _print(present, rows, notes, written, in_file=out is not None)


def _at_once(
    robot: Robot,
    heat: HeatSection | None,
    commanded: Mapping[int, Command],
    drawing: bundles.Drawing,
    out: Path | None,
    as_json: bool,
) -> None:
    """Print where the ladle is for all poses, computed by the compiled engine."""
    import numpy as np

    from pouring_robot.io.tables import rows_csv
    from pouring_robot.mechanism.closure.status import CLOSED, STATUS_NAMES
    from pouring_robot.robot.export.joints import JointRow
    from pouring_robot.robot.pouring.platform_pose import PlatformPose
    from pouring_robot.robot.pouring_robot import PouringRobot
    from pouring_robot.thermal.expansion.warm_pouring_robot import HeatedRobot, locate_path

    if not isinstance(robot, PouringRobot):
        raise BadInputError("--at-once works for the pouring robot only")
    poses = [command for command in commanded.values() if isinstance(command, PlatformPose)]
    wanted = [pose.values for pose in poses]
    with progress.stage_bars() as show:
        found, closed = locate_path(HeatedRobot(robot, heat), wanted, show=show)
    lip = found.sel(frame=robot.model.definition.loops.working_frame)
    status = found.status.values.tolist()
    if set(status) == {status[0]} and status[0] != STATUS_NAMES[CLOSED]:
        raise NoSolutionError(f"no pose has a solution; the first is '{status[0]}'")
    errors = zip(lip.error_position.values / MM, lip.error_rotation.values / MRAD, status, strict=True)
    rows = [
        pose.figures() | (_error(shift, turn) if np.isfinite(shift).all() else {}) | {"status": one}
        for pose, (shift, turn, one) in zip(poses, errors, strict=True)
    ]
    joints = JointRow.of_many(robot.engine().structure, closed, robot.model) if drawing.joints else []
    written = options.write_all(options.wanted(out, lambda: rows_csv(rows)) | drawing.joint_table(joints))
    notes = drawing.tree_notes(joints, lip.actual_position.values, robot.model, warm=heat is not None)
    if as_json:
        return options.print_figures({**robot.model.named, "frame": str(lip.frame.values), "poses": rows}, written)
    _print(robot, rows, notes, written, in_file=out is not None)


def _row(location: Location) -> Row:
    """Return the commanded pose, or the nominal position of the working frame, and the error there."""
    from pouring_robot.robot.location import LadleLocation

    if isinstance(location, LadleLocation):
        posed = dict(location.commanded.figures())
    else:
        nominal, _ = location.poses(location.loops.working_frame)
        posed = dict(zip(("x_mm", "y_mm", "z_mm"), nominal.translation / MM, strict=True))
    opened = {"open_um": location.actual.gap_m * 1e6, "open_mrad": location.actual.gap_rad / MRAD}
    return posed | _error(*location.difference().to_mm_mrad()) | opened


def _error(shift: Any, turn: Any) -> Row:
    return {
        **{f"error_{axis}_mm": float(value) for axis, value in zip("xyz", shift, strict=True)},
        "error_mm": float(sum(shift**2) ** 0.5),
        **{f"error_r{axis}_mrad": float(value) for axis, value in zip("xyz", turn, strict=True)},
    }


def _print(robot: Robot, rows: list[Row], notes: list[str], written: list[Path], *, in_file: bool) -> None:
    from pouring_robot.cli.shared.tables import print_rows
    from pouring_robot.mechanism.closure.status import CLOSED, STATUS_NAMES

    worst = max(row.get("error_mm", 0.0) for row in rows)
    verdict, required = "", robot.accuracy_m
    if required is not None:
        verdict = f": {'within' if worst <= required * 1e3 else 'BEYOND'} the required {required * 1e3:g} mm"
    lost = sum("error_mm" not in row for row in rows)
    verdict += f"; {lost} without a solution" if lost else ""
    options.say(f"largest error {worst:.3f} mm{verdict}", style="bold")
    if not in_file:
        rows = [{name: value for name, value in row.items() if value != STATUS_NAMES[CLOSED]} for row in rows]
        names = list(dict.fromkeys(name for row in rows for name in row))

        def cell(name: str, value: Any) -> str:
            sign = "+" if name.startswith("error_") and name != "error_mm" else ""
            return value if isinstance(value, str) else f"{value:{sign}z.3f}"

        short = [
            name.replace("error_mm", "|Δ| mm").replace("error_", "Δ").replace("_", " ").replace("open um", "open µm")
            for name in names
        ]
        cells = [[cell(name, row[name]) if name in row else "" for name in names] for row in rows]
        tip = robot.model.definition.loops.working_frame
        beside = "" if robot.model.named.get("layout") else ", with its nominal place"
        print_rows(short, cells, f"error of {tip}{beside}: mm, mrad")
    options.print_notes(notes)
    options.print_written(written)
