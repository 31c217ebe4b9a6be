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

    from pouring_robot.robot.model import RobotModel
    from pouring_robot.robot.robot import PouringRobot

AtMm = Annotated[
    tuple[float, float, float],
    typer.Option("--at-mm", metavar="X Y Z", help="Commanded position of the platform."),
]
TiltDeg = Annotated[float, typer.Option("--tilt-deg", metavar="T", help="Commanded tilt about y.")]
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


def robot_of(model: Path | None, layout: str | None, *, warm: bool = False) -> PouringRobot:
    """Return the robot of a model file, or of the drawing; it is cold.

    Args:
        model: the model file.
        layout: the layout of the drawing.
        warm: whether the command cares for the heat that the model file tells of; if not, a line says so.

    Raises:
        BadInputError: both a model file and a layout are given, or one of them is wrong.
    """
    from pouring_robot.robot.robot import PouringRobot

    found = model_of(model, None, layout)
    if found.robot:
        raise BadInputError(f"{model}: this command knows the pouring robot only, not {found.definition.name}")
    say_left_out(found, model, warm=warm)
    return PouringRobot(found)


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
