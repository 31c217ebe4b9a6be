"""Options that several subcommands share, and printing."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from pouring_robot.exceptions import BadInputError
from pouring_robot.files import check_writable
from pouring_robot.model import RobotModel
from pouring_robot.robot import PouringRobot

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
HtmlFile = Annotated[Path | None, typer.Option("--html", metavar="FILE", help="Write a self-contained meshcat page.")]
PngFile = Annotated[Path | None, typer.Option("--png", metavar="FILE", help="Write a picture; no screen is needed.")]
Exaggeration = Annotated[
    float | None, typer.Option("--exaggerate", metavar="FACTOR", help="Draw errors this many times larger.")
]


def robot_of(model: Path | None, layout: str | None) -> PouringRobot:
    """Return the robot of a model file, or of the drawing.

    Raises:
        BadInputError: both a model file and a layout are given, or one of them is wrong.
    """
    if model is not None and layout is not None:
        raise BadInputError("give --model or --layout, not both: the model file names its layout")
    if model is not None:
        return PouringRobot(RobotModel.load(model))
    return PouringRobot(RobotModel(layout=layout) if layout else None)


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


def print_json(content: Any) -> None:
    """Print JSON on standard output."""
    json.dump(content, sys.stdout, indent=2, allow_nan=False)
    sys.stdout.write("\n")


def console() -> Console:
    """Return the console that tables and notes are printed on."""
    # A figure must never be cut: on a narrow terminal long rows wrap instead.
    found = Console(highlight=False, soft_wrap=False)
    return Console(width=max(found.width, 120), highlight=False, soft_wrap=False)
