"""``pouring-robot path``: where the ladle is along a list of commanded poses."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pouring_robot.cli import options
from pouring_robot.cli.drawing import write_drawings
from pouring_robot.cli.tables import path_table
from pouring_robot.exceptions import NoSolutionError, PathPoseError
from pouring_robot.pose_table import read_pose_lines
from pouring_robot.poses import MM, PlatformPose
from pouring_robot.report import location_figures
from pouring_robot.robot import LadleLocation, PouringRobot

PosesFile = Annotated[
    Path,
    typer.Argument(metavar="POSES.csv", help="Columns x, y, z, tilt with units: x_mm, y_mm, z_mm, tilt_deg."),
]


def _locate(robot: PouringRobot, pose: PlatformPose, file: Path, line: int) -> LadleLocation:
    try:
        return robot.locate(pose)
    except NoSolutionError as error:
        raise PathPoseError(file, line, error) from error


def path(
    poses: PosesFile,
    model: options.ModelFile = None,
    layout: options.LayoutName = None,
    as_json: options.AsJson = False,
    html: options.HtmlFile = None,
    png: options.PngFile = None,
    exaggerate: options.Exaggeration = None,
) -> None:
    """Say where the ladle is for every pose of a CSV file, one row each."""
    options.refuse_unwritable(html, png)
    commanded = read_pose_lines(poses)
    robot = options.robot_of(model, layout)
    locations = [_locate(robot, pose, poses, line) for line, pose in commanded.items()]
    written = write_drawings(locations, html, png, exaggerate)
    if as_json:
        rows = [location_figures(location, robot.dexterity(location)) for location in locations]
        options.print_json({"layout": robot.model.layout, "poses": rows, "written": [str(file) for file in written]})
        return
    console = options.console()
    console.print(path_table(locations))
    worst = max(location.difference("ladle_lip").distance_m for location in locations) / MM
    accuracy = robot.layout.accuracy_m / MM
    verdict = "within" if worst <= accuracy else "BEYOND"
    console.print(f"largest error {worst:.3f} mm: {verdict} the required {accuracy:g} mm")
    outside = [i for i, location in enumerate(locations, start=1) if not location.in_workspace]
    if outside:
        console.print(f"note: outside the workspace box: pose {', '.join(map(str, outside))}")
    for file in written:
        console.print(f"wrote {file}")
