"""``pouring-robot path``: where a robot is along a list of commands."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pouring_robot.cli.shared import heat_options, options, progress
from pouring_robot.exceptions import BadInputError, NoSolutionError, PathPoseError
from pouring_robot.robot.pouring.poses import PlatformPose

if TYPE_CHECKING:
    from pouring_robot.robot.base import Command, Robot
    from pouring_robot.robot.heat_section import HeatSection

PosesFile = Annotated[
    Path,
    typer.Argument(
        metavar="POSES.csv",
        help="Columns x_mm, y_mm, z_mm, tilt_deg; of another robot its drives, or x, y, z and rx, ry, rz.",
    ),
]


def path(
    poses: PosesFile,
    model: options.ModelFile = None,
    robot: options.RobotFile = None,
    layout: options.LayoutName = None,
    as_json: options.AsJson = False,
    html: options.HtmlFile = None,
    png: options.PngFile = None,
    exaggerate: options.Exaggeration = None,
    joints: options.JointsFile = None,
    at_once: options.AtOnce = False,
    melt_degC: heat_options.MeltDegC = None,
    ambient_degC: heat_options.AmbientDegC = None,
    steady: heat_options.Steady = False,
    after_min: heat_options.AfterMin = None,
    cold: heat_options.Cold = False,
) -> None:
    """Say where the ladle, or another robot, is for every command of a table, one row each.

    A warm robot is taken by itself at every pose: held until nothing changes, or so long from cold (--after-min).
    """
    from pouring_robot.cli.shared import locations as lines
    from pouring_robot.mechanism.poses import MM
    from pouring_robot.robot.location import LadleLocation
    from pouring_robot.robot.metrics import location_figures

    options.refuse_unwritable(html, png, joints)
    present = options.robot_of(model, robot, layout, warm=True)
    commanded = present.read_commands(poses)
    heat = heat_options.heat_of(present, melt_degC, ambient_degC, steady, after_min, cold)
    if at_once:
        if html or png:
            raise BadInputError("--at-once draws nothing; leave out --html and --png, or --at-once")
        _at_once(present, heat, commanded, joints, as_json)
        return
    heated = heat_options.heated_of(present, heat)
    found: list[heat_options.Warmth] = []
    rows = []
    with progress.stage_bars() as show:
        for line, command in commanded.items():
            try:
                one = heat_options.Warmth.of(present, heated, command)
                found.append(one)
                if as_json:  # may find a singular pose: before anything is written
                    rows.append(location_figures(one.location, one.robot.dexterity(one.location)) | one.figures())
            except NoSolutionError as error:
                raise PathPoseError(poses, line, error) from error
            show("closing", len(found), len(commanded))
    locations = [one.location for one in found]
    notes = lines.location_notes(present, html, png, model_file=model is not None)
    written = lines.write_drawings(locations, html, png, exaggerate, warm=heated is not None)
    written += lines.write_joints(locations, present.model, joints)
    if as_json:
        options.print_figures({**present.name, "poses": rows, "notes": notes}, written)
        return
    console = options.console()
    console.print(lines.path_table(locations), markup=False, soft_wrap=True)
    if found[0].heated and found[0].state:
        console.print(f"{heat_options.heat_line(found[0].heated, found[0].state)} (first pose)")
        if heat is not None and len(found) > 1:
            console.print(heat_options.alone_line(heat))
    worst = max(location.difference().distance_m for location in locations) / MM
    console.print(f"largest error {worst:.3f} mm{_verdict(worst * MM, present.accuracy_m)}")
    options.print_notes(console, notes)
    outside = [i for i, one in enumerate(locations, start=1) if isinstance(one, LadleLocation) and not one.in_workspace]
    if outside:
        console.print(f"note: outside the workspace box: pose {', '.join(map(str, outside))}")
    options.print_written(console, written)


def _at_once(
    robot: Robot, heat: HeatSection | None, commanded: Mapping[int, Command], joints: Path | None, as_json: bool
) -> None:
    """Say where the ladle is for all poses by the compiled engine."""
    import numpy as np

    from pouring_robot.cli.shared.locations import write_joint_rows
    from pouring_robot.mechanism.poses import MM, MRAD
    from pouring_robot.robot.export.joints import JointRow
    from pouring_robot.robot.robot import PouringRobot
    from pouring_robot.thermal.expansion.heated_robot import HeatedRobot
    from pouring_robot.thermal.expansion.warm_path import locate_path

    if not isinstance(robot, PouringRobot):
        raise BadInputError("--at-once knows the pouring robot only")
    poses = [command for command in commanded.values() if isinstance(command, PlatformPose)]
    wanted = [(*pose.position_m, pose.tilt_rad) for pose in poses]
    with progress.stage_bars() as show:
        found, closed = locate_path(HeatedRobot(robot, heat), wanted, show=show)
    lip = found.sel(frame=robot.model.loops().working_frame)
    columns = {
        **dict(zip(("x_mm", "y_mm", "z_mm", "tilt_deg"), np.transpose([p.to_mm_deg() for p in poses]), strict=True)),
        **{f"error_{a}_mm": lip.error_position.values[:, k] / MM for k, a in enumerate("xyz")},
        **{f"error_r{a}_mrad": lip.error_rotation.values[:, k] / MRAD for k, a in enumerate("xyz")},
    }
    status = found.status.values.tolist()
    numbers = np.transpose(list(columns.values())).tolist()
    if set(status) == {status[0]} and status[0] != "closed":
        raise NoSolutionError(f"no pose has an answer; the first is '{status[0]}'")
    written = write_joint_rows(JointRow.of_many(robot.engine().structure, closed, robot.model), joints)
    if as_json:
        rows = [{n: v for n, v in zip(columns, row, strict=True) if np.isfinite(v)} for row in numbers]
        rows = [row | {"status": one} for row, one in zip(rows, status, strict=True)]
        options.print_figures({**robot.name, "frame": str(lip.frame.values), "poses": rows}, written)
        return
    console = options.console()
    print("".join(f"{name:>15}" for name in columns))
    for row, one in zip(numbers, status, strict=True):
        print("".join(f"{value:15.3f}" for value in row) if one == "closed" else f"{one:>15}")
    worst = float(np.nanmax(np.linalg.norm(lip.error_position.values, axis=1)))
    console.print(f"largest error {worst / MM:.3f} mm{_verdict(worst, robot.accuracy_m)}")
    options.print_written(console, written)


def _verdict(error_m: float, accuracy_m: float | None) -> str:
    if accuracy_m is None:
        return ""
    return f": {'within' if error_m <= accuracy_m else 'BEYOND'} the required {accuracy_m * 1e3:g} mm"
