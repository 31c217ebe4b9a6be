"""``pouring-robot export``: the robot as built for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pouring_robot.cli.shared import options

OutFolder = Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder for the URDF, its meshes and loops.")]


def export(
    out: OutFolder,
    model: options.ModelFile = None,
    robot: options.RobotFile = None,
    layout: options.LayoutName = None,
) -> None:
    """Write the robot as built: URDF with its meshes, and the file that says how the tree closes."""
    from pouring_robot.robot.description.urdf import write_urdf
    from pouring_robot.robot.pouring.ladle_mesh import stale_mesh_note
    from pouring_robot.robot.robot import PouringRobot, robot_of

    built = options.model_of(model, robot, layout)
    options.say_left_out(built, model)
    found = robot_of(built)
    beside = built.definition.files_beside()
    urdf = write_urdf(built.tree_urdf(), out, beside)
    console = options.console()
    options.print_written(console, (urdf, *(out / name for name in beside)))
    note = stale_mesh_note(found.layout) if isinstance(found, PouringRobot) else None
    options.print_notes(console, [note] if note else [])
