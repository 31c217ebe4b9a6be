"""``pouring-robot path``: where the ladle is along a list of commanded poses."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pouring_robot.cli.shared import heat_options, options
from pouring_robot.cli.shared.drawing import drawing_notes, write_drawings
from pouring_robot.cli.shared.heat_options import Warmth
from pouring_robot.cli.shared.tables import model_notes, path_table
from pouring_robot.exceptions import NoSolutionError, PathPoseError
from pouring_robot.mechanism.poses import MM
from pouring_robot.robot.metrics import location_figures
from pouring_robot.robot.pose_table import read_pose_lines
from pouring_robot.robot.pouring.poses import PlatformPose
from pouring_robot.robot.robot import PouringRobot

if TYPE_CHECKING:
    from pouring_robot.thermal.expansion.heated_robot import HeatedRobot

PosesFile = Annotated[
    Path,
    typer.Argument(metavar="POSES.csv", help="Columns x, y, z, tilt with units: x_mm, y_mm, z_mm, tilt_deg."),
]


def _locate(robot: PouringRobot, heated: HeatedRobot | None, pose: PlatformPose, file: Path, line: int) -> Warmth:
    try:
        return Warmth.of(robot, heated, pose)
    except NoSolutionError as error:
        raise PathPoseError(file, line, error) from error


def _figures(warmth: Warmth, file: Path, line: int) -> dict[str, Any]:
    try:
        return location_figures(warmth.location, warmth.robot.dexterity(warmth.location)) | warmth.figures()
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
    melt_degC: heat_options.MeltDegC = None,
    ambient_degC: heat_options.AmbientDegC = None,
    steady: heat_options.Steady = False,
    after_min: heat_options.AfterMin = None,
    cold: heat_options.Cold = False,
) -> None:
    """Say where the ladle is for every pose of a CSV file, one row each.

    A warm robot is taken by itself at every pose: held until nothing changes, or so long from cold (--after-min).
    """
    options.refuse_unwritable(html, png)
    commanded = read_pose_lines(poses)
    robot = options.robot_of(model, layout, warm=True)
    heat = heat_options.heat_of(robot, melt_degC, ambient_degC, steady, after_min, cold)
    heated = heat_options.heated_of(robot, heat)
    with options.progress_bar("closing", len(commanded)) as step:
        found = [step(_locate(robot, heated, pose, poses, line)) for line, pose in commanded.items()]
    locations = [one.location for one in found]
    rows = []
    if as_json:  # may find a singular pose: before anything is written
        with options.progress_bar("figures", len(commanded)) as step:
            rows = [step(_figures(one, poses, line)) for line, one in zip(commanded, found, strict=True)]
    notes = [*model_notes(robot, model_file=model is not None), *drawing_notes(robot, html, png)]
    written = write_drawings(locations, html, png, exaggerate, warm=heated is not None)
    if as_json:
        content = {"layout": robot.model.layout, "poses": rows, "notes": notes}
        options.print_json(content | {"written": [str(file) for file in written]})
        return
    console = options.console()
    console.print(path_table(locations), markup=False, soft_wrap=True)
    if found[0].heated and found[0].state:
        console.print(f"{heat_options.heat_line(found[0].heated, found[0].state)} (first pose)")
        if heat is not None and len(found) > 1:
            console.print(heat_options.alone_line(heat))
    worst = max(location.difference().distance_m for location in locations) / MM
    accuracy = robot.layout.accuracy_m / MM
    verdict = "within" if worst <= accuracy else "BEYOND"
    console.print(f"largest error {worst:.3f} mm: {verdict} the required {accuracy:g} mm")
    for note in notes:
        console.print(f"note: {note}", markup=False)
    outside = [i for i, location in enumerate(locations, start=1) if not location.in_workspace]
    if outside:
        console.print(f"note: outside the workspace box: pose {', '.join(map(str, outside))}")
    for file in written:
        console.print(f"wrote {file}")
