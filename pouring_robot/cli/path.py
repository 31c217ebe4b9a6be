"""``pouring-robot path``: where the ladle is along a list of commanded poses."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pouring_robot.cli.shared import heat_options, options, progress
from pouring_robot.exceptions import NoSolutionError, PathPoseError

PosesFile = Annotated[
    Path,
    typer.Argument(metavar="POSES.csv", help="Columns x, y, z, tilt with units: x_mm, y_mm, z_mm, tilt_deg."),
]


def path(
    poses: PosesFile,
    model: options.ModelFile = None,
    layout: options.LayoutName = None,
    as_json: options.AsJson = False,
    html: options.HtmlFile = None,
    png: options.PngFile = None,
    exaggerate: options.Exaggeration = None,
    joints: options.JointsFile = None,
    melt_degC: heat_options.MeltDegC = None,
    ambient_degC: heat_options.AmbientDegC = None,
    steady: heat_options.Steady = False,
    after_min: heat_options.AfterMin = None,
    cold: heat_options.Cold = False,
) -> None:
    """Say where the ladle is for every pose of a CSV file, one row each.

    A warm robot is taken by itself at every pose: held until nothing changes, or so long from cold (--after-min).
    """
    from pouring_robot.cli.shared import locations as lines
    from pouring_robot.mechanism.poses import MM
    from pouring_robot.robot.metrics import location_figures
    from pouring_robot.robot.pose_table import read_pose_lines

    options.refuse_unwritable(html, png, joints)
    commanded = read_pose_lines(poses)
    robot = options.robot_of(model, layout, warm=True)
    heat = heat_options.heat_of(robot, melt_degC, ambient_degC, steady, after_min, cold)
    heated = heat_options.heated_of(robot, heat)
    found: list[heat_options.Warmth] = []
    rows = []
    with progress.stage_bars() as show:
        for line, pose in commanded.items():
            try:
                one = heat_options.Warmth.of(robot, heated, pose)
                found.append(one)
                if as_json:  # may find a singular pose: before anything is written
                    rows.append(location_figures(one.location, one.robot.dexterity(one.location)) | one.figures())
            except NoSolutionError as error:
                raise PathPoseError(poses, line, error) from error
            show("closing", len(found), len(commanded))
    locations = [one.location for one in found]
    notes = lines.location_notes(robot, html, png, model_file=model is not None)
    written = lines.write_drawings(locations, html, png, exaggerate, warm=heated is not None)
    written += lines.write_joints(locations, robot.model, joints)
    if as_json:
        options.print_figures({"layout": robot.model.layout, "poses": rows, "notes": notes}, written)
        return
    console = options.console()
    console.print(lines.path_table(locations), markup=False, soft_wrap=True)
    if found[0].heated and found[0].state:
        console.print(f"{heat_options.heat_line(found[0].heated, found[0].state)} (first pose)")
        if heat is not None and len(found) > 1:
            console.print(heat_options.alone_line(heat))
    worst = max(location.difference().distance_m for location in locations) / MM
    accuracy = robot.layout.accuracy_m / MM
    verdict = "within" if worst <= accuracy else "BEYOND"
    console.print(f"largest error {worst:.3f} mm: {verdict} the required {accuracy:g} mm")
    options.print_notes(console, notes)
    outside = [i for i, location in enumerate(locations, start=1) if not location.in_workspace]
    if outside:
        console.print(f"note: outside the workspace box: pose {', '.join(map(str, outside))}")
    options.print_written(console, written)
