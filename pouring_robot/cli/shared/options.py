"""Options that several subcommands share, and printing."""

from __future__ import annotations

import itertools
import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TaskID, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.progress import Progress as Bars

from pouring_robot.exceptions import BadInputError
from pouring_robot.io.files import check_writable
from pouring_robot.io.progress import Progress, Status, say_nothing
from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.robot import PouringRobot

Result = TypeVar("Result")

AtMm = Annotated[
    tuple[float, float, float],
    typer.Option("--at-mm", metavar="X Y Z", help="Commanded position of the platform."),
]
TiltDeg = Annotated[float, typer.Option("--tilt-deg", metavar="T", help="Commanded tilt about y.")]
ModelFile = Annotated[
    Path | None,
    typer.Option("--model", metavar="FILE", help="Model file of the robot as built (default: the drawing)."),
]
LayoutName = Annotated[
    str | None,
    typer.Option("--layout", metavar="NAME", help="Layout of the dimensions file (default: paper)."),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")]
CampaignFile = Annotated[
    Path, typer.Argument(metavar="CAMPAIGN", help="CSV or Parquet table; the YAML of the same stem lies beside it.")
]
HtmlFile = Annotated[Path | None, typer.Option("--html", metavar="FILE", help="Write a self-contained meshcat page.")]
PngFile = Annotated[Path | None, typer.Option("--png", metavar="FILE", help="Write a picture; no screen is needed.")]
Exaggeration = Annotated[
    float | None, typer.Option("--exaggerate", metavar="FACTOR", help="Draw errors this many times larger.")
]


def robot_of(model: Path | None, layout: str | None, *, warm: bool = False) -> PouringRobot:
    """Return the robot of a model file, or of the drawing; it is cold.

    Args:
        model: the model file.
        layout: the layout of the drawing.
        warm: whether the command cares for the heat that the model file tells of; if not, a line says so.

    Raises:
        BadInputError: both a model file and a layout are given, or one of them is wrong.
    """
    if model is not None and layout is not None:
        raise BadInputError("give --model or --layout, not both: the model file names its layout")
    if model is not None:
        found = RobotModel.load(model)
        if not warm:
            say_taken_cold(found, model)
        say_left_out(found, model)
        return PouringRobot(found)
    return PouringRobot(RobotModel(layout=layout) if layout else None)


def say_taken_cold(model: RobotModel, file: Path | str) -> None:
    """Say on standard error that a command leaves out the heat that a model file tells of."""
    if model.heat is not None:
        print(f"note: this command takes the robot cold; the heat section of {file} is left out", file=sys.stderr)


def say_left_out(model: RobotModel, file: Path) -> None:
    """Say on standard error which effects of a model depend on conditions that only a campaign tells of."""
    effects = dict.fromkeys(entry.effect for entry in model.effects if not entry.placed)
    if effects:
        print(
            f"note: this command does not apply the effects of {file} that depend on conditions: {', '.join(effects)}",
            file=sys.stderr,
        )


def refuse_unwritable(*paths: Path | None) -> None:
    """Find out before the work whether the outputs can be written.

    Raises:
        OutputError: one of the places cannot be written to.
        BadInputError: two outputs have the same place.
    """
    given = [path for path in paths if path is not None]
    for path in given:
        check_writable(path)
    if len({path.resolve() for path in given}) < len(given):
        raise BadInputError("two outputs have the same file name; give each its own")


@contextmanager
def progress_bars() -> Iterator[Progress]:
    """Show a bar for each stage on standard error, if that is a terminal, and take them away at the end."""
    errors = Console(stderr=True)
    times = (TimeElapsedColumn(), TextColumn("gone,"), TimeRemainingColumn(), TextColumn("left"))
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), *times)
    with Bars(*columns, console=errors, transient=True, disable=not errors.is_terminal) as bars:
        tasks: dict[str, TaskID] = {}

        def show(stage: str, done: int, total: int) -> None:
            if stage not in tasks:
                tasks[stage] = bars.add_task(stage, total=total, completed=done)
            bars.update(tasks[stage], completed=done, total=total)

        yield show


@contextmanager
def progress_bar(what: str, total: int) -> Iterator[Callable[[Result], Result]]:
    """Show the bar of one stage.

    Yields:
        A function that counts one step done and returns what it is given.
    """
    with progress_bars() as show:
        done = itertools.count(1)
        show(what, 0, total)

        def step(result: Result) -> Result:
            show(what, next(done), total)
            return result

        yield step


@contextmanager
def status() -> Iterator[Status]:
    """Show what is being done on a terminal's error stream; elsewhere nothing.

    Yields:
        A function that says what is being done now.
    """
    if not sys.stderr.isatty():
        yield say_nothing
        return
    with Console(stderr=True, highlight=False).status("reading") as shown:
        yield lambda text: shown.update(text[:100])


def print_json(content: Any) -> None:
    """Print JSON on standard output."""
    json.dump(content, sys.stdout, indent=2, allow_nan=False)
    sys.stdout.write("\n")


def console() -> Console:
    """Return the console that tables and notes are printed on."""
    # A figure must never be cut: on a narrow terminal long rows wrap instead.
    found = Console(highlight=False, soft_wrap=False)
    return Console(width=max(found.width, 120), highlight=False, soft_wrap=False)
