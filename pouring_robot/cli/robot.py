"""``pouring-robot robot``: other robots than the pouring robot: their robot files, and where they are."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pouring_robot.cli.shared import options
from pouring_robot.cli.shared.tables import plain_table

Urdf = Annotated[Path, typer.Argument(metavar="URDF", help="The robot's URDF.")]
Out = Annotated[
    Path | None, typer.Option("--out", metavar="FILE", help="Where to write it (default: robot.yaml beside the URDF).")
]


Commands = Annotated[
    Path,
    typer.Argument(metavar="COMMANDS", help="Table (CSV, Parquet, Excel): a column for each drive, with its unit."),
]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace a robot file that is there.")]


def init(urdf: Urdf, out: Out = None, overwrite: Overwrite = False) -> None:
    """Write a first robot file for a URDF, with comments on what to fill in."""
    from pouring_robot.io.files import check_outputs, write_whole
    from pouring_robot.robot.description.definition import RobotDefinition
    from pouring_robot.robot.description.first_file import first_robot_file

    path = out or urdf.parent / "robot.yaml"
    check_outputs([path], overwrite=overwrite)
    write_whole(path, first_robot_file(urdf, path.parent))
    found = RobotDefinition.load(path)
    console = options.console()
    drives = ", ".join(f"{drive.column} ({drive.command})" for drive in found.drives)
    frames = f"{found.loops.base_frame} to {found.loops.end_frame}"
    console.print(f"{found.name}: {frames}, {len(found.drives)} drives: {drives}", markup=False)
    options.print_written(console, (path,))
    console.print(f"next: read its comments, then pouring-robot robots --robot {path}", markup=False)


def locate(
    commands: Commands,
    model: options.ModelFile = None,
    robot: options.RobotFile = None,
    as_json: options.AsJson = False,
) -> None:
    """Say where the robot should be and where it is for every row of drive values of a table."""
    import numpy as np

    from pouring_robot.campaign.columns import drive_columns, drive_values
    from pouring_robot.exceptions import BadInputError
    from pouring_robot.io.quantities import read_quantities
    from pouring_robot.mechanism.poses import MM, MRAD
    from pouring_robot.robot.base import Robot

    built = options.model_of(model, robot)
    options.say_left_out(built, model)
    found = Robot(built)
    wanted = drive_columns(found.model.definition)
    table = read_quantities(commands, wanted, wanted[0].canonical)
    drives = drive_values(table.numbers, found.model.definition)
    empty = np.argwhere(~np.isfinite(drives))
    if empty.size:
        row, column = (int(k) for k in empty[0])
        raise table.fault("the value is missing; a command has all drives", row, wanted[column].name)
    located = found.locate_drives(drives).sel(frame=found.model.loops().working_frame)
    figures = {
        "x_mm y_mm z_mm": located.actual_position.values / MM,
        "error_x_mm error_y_mm error_z_mm": located.error_position.values / MM,
        "error_rx_mrad error_ry_mrad error_rz_mrad": located.error_rotation.values / MRAD,
    }
    head = " ".join(figures).split()
    rows = np.concatenate(list(figures.values()), axis=1)
    if not (located.status == "closed").any():
        raise BadInputError(f"{commands}: no row has a pose; the first is '{located.status.values[0]}'")
    if as_json:
        named = [dict(zip(head, row, strict=True)) if row[0] == row[0] else {} for row in rows.tolist()]
        lines, status = table.table.lines.tolist(), located.status.values.tolist()
        poses = [{"line": k, "status": s, **row} for k, s, row in zip(lines, status, named, strict=True)]
        options.print_json({"robot": found.model.definition.name, "frame": str(located.frame.values), "poses": poses})
        return
    console = options.console()
    cells = [
        [str(line), *([f"{value:.3f}" for value in row] if status == "closed" else [status])]
        for line, row, status in zip(table.table.lines, rows, located.status.values, strict=True)
    ]
    console.print(plain_table(["line", *head], cells))
    distance = np.linalg.norm(figures["error_x_mm error_y_mm error_z_mm"], axis=1)
    console.print(f"{located.frame.values} is off by {np.nanmax(distance):.3f} mm at most", markup=False)


robot = options.group_of("Other robots than the pouring robot: describe one, and say where it is.", [init, locate])
