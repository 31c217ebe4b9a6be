"""Options that several subcommands share, the robot they name, and printing."""

from __future__ import annotations

import inspect
import json
import sys
import textwrap
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from pouring_robot.exceptions import BadInputError

if TYPE_CHECKING:
    from rich.console import Console

    from pouring_robot.robot.base import Command, Robot
    from pouring_robot.robot.model import RobotModel
    from pouring_robot.robot.robot import PouringRobot

AtMm = Annotated[
    tuple[float, float, float] | None,
    typer.Option("--at-mm", metavar="X Y Z", help="Commanded position of the platform, or of a robot's end frame."),
]
TiltDeg = Annotated[float | None, typer.Option("--tilt-deg", metavar="T", help="Commanded tilt about y.")]
RotationDeg = Annotated[
    tuple[float, float, float] | None,
    typer.Option("--rotation-deg", metavar="RX RY RZ", help="Commanded attitude of an end frame: a rotation vector."),
]
Drives = Annotated[
    str | None,
    typer.Option(
        "--drives", metavar='"V V ..."', help="Commanded joint values of the drives, in the robot's order: mm, deg."
    ),
]
ModelFile = Annotated[
    Path | None,
    typer.Option("--model", metavar="FILE", help="Model file of the robot as built (default: the drawing)."),
]
RobotFile = Annotated[
    Path | None,
    typer.Option("--robot", metavar="FILE", help="Robot file, robot.yaml, of another robot than the pouring robot."),
]
LayoutName = Annotated[
    str | None,
    typer.Option("--layout", metavar="NAME", help="Layout of the dimensions file (default: paper)."),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")]
CampaignFile = Annotated[
    Path, typer.Argument(metavar="CAMPAIGN", help="CSV or Parquet table; the YAML of the same stem lies beside it.")
]
TolerancesFile = Annotated[
    Path | None, typer.Option("--tolerances", metavar="FILE", help="Tolerances of the parts (default: the shipped).")
]
HoldOutBy = Annotated[
    Literal["auto", "session", "time", "region"],
    typer.Option("--hold-out", help="What block takes no part in the fit."),
]
HtmlFile = Annotated[Path | None, typer.Option("--html", metavar="FILE", help="Write a self-contained meshcat page.")]
PngFile = Annotated[Path | None, typer.Option("--png", metavar="FILE", help="Write a picture; no screen is needed.")]
AtOnce = Annotated[
    bool, typer.Option("--at-once", help="All poses at once, hundreds of times faster; temperatures are taken once.")
]
JointsFile = Annotated[
    Path | None,
    typer.Option("--joints", metavar="FILE", help="Write the values of all joints, m and rad, as .csv or .json."),
]
Exaggeration = Annotated[
    float | None, typer.Option("--exaggerate", metavar="FACTOR", help="Draw errors this many times larger.")
]


def group_of(about: str, commands: Iterable[Callable[..., None]]) -> typer.Typer:
    """Return subcommands as a group; its help page shows the first sentence of each as a whole."""
    group = typer.Typer(help=about, short_help=about, add_completion=False, rich_markup_mode=None)
    for command in commands:
        summary, *_ = (inspect.getdoc(command) or "").split("\n\n")
        group.command(command.__name__, short_help=" ".join(summary.split()))(command)
    return group


def robot_of(model: Path | None, robot: Path | None, layout: str | None, *, warm: bool = False) -> Robot:
    """Return the robot of a model file, or the drawing of a robot file or a layout; it is cold.

    Args:
        model: the model file.
        robot: the robot file.
        layout: the layout of the drawing.
        warm: whether the command cares for the heat that the model file tells of; if not, a line says so.

    Raises:
        BadInputError: more than one is given, or a file is wrong.
    """
    from pouring_robot.robot.robot import robot_of as built

    found = model_of(model, robot, layout)
    say_left_out(found, model, warm=warm)
    return built(found)


def with_melt(robot: Robot) -> PouringRobot:
    """Return a robot whose melt warms it.

    Raises:
        BadInputError: it is another than the pouring robot.
    """
    from pouring_robot.robot.robot import PouringRobot

    if isinstance(robot, PouringRobot):
        return robot
    name = robot.model.definition.name
    raise BadInputError(
        f"temperatures are computed from the pouring robot's melt, which {name} does not have; how it grows with "
        f"measured ones is found by 'diagnose', see pouring-robot effects --robot FILE"
    )


def command_of(
    robot: Robot,
    at_mm: tuple[float, float, float] | None,
    tilt_deg: float | None,
    rotation_deg: tuple[float, float, float] | None,
    drives: str | None,
) -> Command:
    """Return the command that options give: a pose of the end body, or drive values.

    Raises:
        BadInputError: they say nothing, contradict each other, or are no command of this robot.
    """
    import numpy as np

    from pouring_robot.mechanism.poses import MM

    if (at_mm is None) == (drives is None):
        raise BadInputError("give a pose by --at-mm or drive values by --drives, one of the two")
    if tilt_deg is not None and rotation_deg is not None:
        raise BadInputError("give --tilt-deg or --rotation-deg, not both: a tilt T is the rotation 0 T 0")
    turn = (0.0, tilt_deg, 0.0) if tilt_deg is not None else rotation_deg
    if at_mm is not None:
        return robot.pose_command(np.array(at_mm) * MM, None if turn is None else np.radians(turn))
    if turn is not None:
        raise BadInputError("--tilt-deg and --rotation-deg belong to --at-mm, not to --drives")
    entries = robot.model.definition.drives
    units = [(MM, "mm") if drive.unit == "m" else (np.radians(1.0), "deg") for drive in entries]
    try:
        values = [float(part) for part in (drives or "").replace(",", " ").split()]
    except ValueError:
        values = []
    if len(values) != len(entries) or not np.isfinite(values).all():
        wanted = ", ".join(f"{drive.joint} ({unit})" for drive, (_, unit) in zip(entries, units, strict=True))
        raise BadInputError(f"--drives '{drives}': give one number for each of {wanted}")
    return np.array(values) * [factor for factor, _ in units]


def model_of(model: Path | None, robot: Path | None, layout: str | None = None) -> RobotModel:
    """Return the model of a model file, or the drawing of a robot file or of a layout.

    Raises:
        BadInputError: more than one is given, or a file is wrong.
    """
    from pouring_robot.robot.model import RobotModel

    given = [name for name, value in (("--model", model), ("--robot", robot), ("--layout", layout)) if value]
    if len(given) > 1:
        raise BadInputError(f"give {' or '.join(given)}, not both: a model file names its robot and its layout")
    if robot is not None:
        return RobotModel.for_robot(robot)
    return RobotModel(layout=layout) if layout else RobotModel.of(model)


def say_left_out(model: RobotModel, file: Path | str | None, *, warm: bool = False) -> None:
    """Say on standard error what a command leaves out of a model: heat, and effects that only a campaign tells of.

    A drawing (no file) has neither.
    """
    for line in model.left_out("this command", str(file), warm=warm):
        print(f"note: {line}", file=sys.stderr)


def refuse_unwritable(*paths: Path | None) -> None:
    """Find out before the work whether the outputs can be written.

    Raises:
        OutputError: one of the places cannot be written to, or two outputs have the same place.
    """
    from pouring_robot.io.files import check_outputs

    check_outputs([path for path in paths if path is not None])


def print_json(content: Any) -> None:
    """Print JSON on standard output."""
    json.dump(content, sys.stdout, indent=2, allow_nan=False)
    sys.stdout.write("\n")


def print_figures(figures: Mapping[str, Any], written: Iterable[Path] = ()) -> None:
    """Print figures as JSON, with the files that were written at their end."""
    print_json({**figures, "written": [str(path) for path in written]})


def console() -> Console:
    """Return the console that tables and notes are printed on."""
    from rich.console import Console

    # A figure must never be cut: on a narrow terminal long rows wrap instead.
    found = Console(highlight=False, soft_wrap=False)
    return Console(width=max(found.width, 120), highlight=False, soft_wrap=False)


def print_notes(console: Console, notes: Iterable[str]) -> None:
    """Print notes, one line each."""
    for note in notes:
        console.print(f"note: {note}", markup=False)


def print_written(console: Console, written: Iterable[Path]) -> None:
    """Say which files were written, one line each."""
    for path in written:
        console.print(f"wrote {path}", markup=False)


def print_indented(console: Console, line: str, by: int = 2) -> None:
    """Print a line indented, and as far as it wraps too."""
    space = " " * by
    folded = textwrap.fill(line, console.width, initial_indent=space, subsequent_indent=space, break_on_hyphens=False)
    console.print(folded, markup=False)
