"""``pouring-robot robot``: other robots than the pouring robot."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pouring_robot.cli.shared import options
from pouring_robot.cli.shared.bundles import group_of

Urdf = Annotated[Path, typer.Argument(metavar="URDF", callback=options.there, help="The robot's URDF, or a xacro.")]
Out = Annotated[Path | None, options.output("--out", help="Where to write it (default: robot.yaml beside the URDF).")]


def init(urdf: Urdf, out: Out = None) -> None:
    """Write a first robot file for a URDF, with comments on what to fill in.

    What a Gepetto robot.yaml beside it closes is taken over; the file is then called robot_file.yaml.
    """
    from pouring_robot.io.files import write_whole
    from pouring_robot.robot.description.definition import RobotDefinition
    from pouring_robot.robot.description.first_file import first_robot_file, loops_beside

    path = out or urdf.parent / ("robot_file.yaml" if loops_beside(urdf) else "robot.yaml")
    options.refuse_present([path])
    write_whole(path, first_robot_file(urdf, path.parent))
    found = RobotDefinition.load(path)
    console = options.console()
    drives = ", ".join(f"{drive.column} ({drive.command})" for drive in found.drives)
    frames = f"{found.loops.base_frame} to {found.loops.end_frame}"
    console.print(f"{found.name}: {frames}, {len(found.drives)} drives: {drives}", markup=False)
    options.print_written(console, (path,))
    console.print(f"next: read its comments, then pouring-robot robots --robot {path}", markup=False)


robot = group_of("Other robots than the pouring robot.", [init])
