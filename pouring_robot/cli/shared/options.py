"""Options that subcommands share, and printing.

While the command line is parsed, before anything is imported for the work, input files are checked for existence, and
output files and folders are refused if they would be replaced.
"""

from __future__ import annotations

import contextlib
import errno
import json
import math
import os
import sys
import textwrap
from collections.abc import Callable, Iterable, Mapping
from contextvars import ContextVar
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from pouring_robot.exceptions import BadInputError, OutputError
from pouring_robot.io.files import (
    CSV_SUFFIXES,
    EXCEL_SUFFIXES,
    PARQUET_SUFFIXES,
    check_ending,
    check_folder,
    check_outputs,
    write_together,
)
from pouring_robot.io.units import size_fault

if TYPE_CHECKING:
    from rich.console import Console

    from pouring_robot.robot.pouring_robot import PouringRobot
    from pouring_robot.robot.robot import Robot

Pair = tuple[float, float] | None
Point = tuple[float, float, float]
QUIET, OVERWRITE = ContextVar("quiet", default=False), ContextVar("overwrite", default=False)
INPUTS = ContextVar("inputs", default=frozenset[Path]())
"""Files that the command reads through its options, as resolved paths."""
_WIDTH = 120
_OUTPUTS = f"{__name__}.outputs"


def _may_overwrite(wanted: bool) -> bool:
    OVERWRITE.set(wanted)
    return wanted


def there(path: Path | None) -> Path | None:
    """Return the path of an input file, which must exist."""
    if path is not None and not path.exists():
        ours = path.parts[0] == "examples" and not Path("examples").exists()
        hint = "; 'pouring-robot examples copy examples' puts those of the package here" if ours else ""
        raise BadInputError(f"{path}: cannot be read: {os.strerror(errno.ENOENT)}{hint}")
    return path


def _check_png(path: Path) -> None:
    """Refuse a picture with the suffix of another format."""
    if path.suffix.lower() not in ("", ".png"):
        raise BadInputError(f"--png {path}: pictures are PNG; call it {path.with_suffix('.png')}")


def _check_csv(path: Path) -> None:
    """Refuse a CSV with a suffix by which it would be read as another format."""
    if path.suffix.lower() in PARQUET_SUFFIXES + EXCEL_SUFFIXES:
        check_ending(path, CSV_SUFFIXES)


def check_joints(path: Path) -> None:
    """Refuse a table of joints whose suffix is neither that of CSV nor of JSON."""
    check_ending(path, (".csv", ".json"))


_WRITES: dict[Callable[..., Path | None], tuple[str, ...]] = {}  # the options that write, and what: see written_by


def opt(help: str, *name: str, **more: Any) -> Any:
    """Return an option, which has the name of its parameter unless another is given."""
    return typer.Option(*name, help=help, **more)


def reads(help: str, metavar: str = "FILE") -> Any:
    """Return the option for an input file, which must exist."""
    return opt(help, metavar=metavar, callback=there)


def writes(help: str, metavar: str = "FILE", check: Callable[[Path], None] = lambda _: None) -> Any:
    """Return the option for an output file, whose name must pass a check.

    An existing file is only replaced with ``--overwrite``.
    """

    def new(context: typer.Context, path: Path | None) -> Path | None:
        if path is not None:
            check(path)
            files = context.meta.setdefault(_OUTPUTS, [])
            files.append(path)
            refuse_targets(files)
        return path

    _WRITES[new] = ("",)
    return opt(help, metavar=metavar, callback=new)


def writes_csv(help: str) -> Any:
    """Return the option for a CSV output file, like :func:`writes`."""
    return writes(help, "FILE.csv", _check_csv)


def argument(metavar: str, help: str) -> Any:
    """Return the argument for an input file, which must exist."""
    return typer.Argument(metavar=metavar, help=help, callback=there)


def results_folder(*files: str, what: str = "") -> Any:
    """Return the option ``--out`` for an output folder; existing files are only replaced with ``--overwrite``.

    ``files`` are known before the work; ``what`` describes further output.
    """

    def fresh(folder: Path | None) -> Path | None:
        if folder is not None:
            check_folder(folder)
            refuse_targets([folder / name for name in files] if folder.exists() else [])
        return folder

    _WRITES[fresh] = ("", *files)
    named = ", ".join([*([what] if what else []), *files])
    return opt(f"Folder, created if needed, for {named}.", "--out", metavar="DIR", callback=fresh)


def written_by(annotation: Any) -> tuple[str, ...]:
    """Return what an option with this annotation writes, as names beside its path ("": that itself); (): it reads."""
    callbacks = (getattr(info, "callback", None) for info in getattr(annotation, "__metadata__", ()))
    return next((_WRITES[callback] for callback in callbacks if callback in _WRITES), ())


def _of_size(parameter: typer.CallbackParam, value: Any) -> Any:
    """Return the value of an option after a check that its numbers are finite and of a plausible size."""
    if value is None:
        return None
    for number in value if isinstance(value, tuple) else str(value).replace(",", " ").split():
        with contextlib.suppress(ValueError):  # other text is refused where the number of values is known
            size = float(number)
            if fault := size_fault(size) if math.isfinite(size) else f"{size} is not a finite number":
                raise BadInputError(f"{parameter.opts[0]}: {fault}")
    return value


def refuse_targets(files: Iterable[Path]) -> None:
    """Check before the work that the outputs can be written and, without ``--overwrite``, that none exists."""
    check_outputs(list(files), overwrite=OVERWRITE.get())


def refuse_inputs(files: Iterable[Path]) -> None:
    """Refuse to write to an input file: ``--overwrite`` is for earlier outputs."""
    for path in files:
        if path.resolve() in INPUTS.get() and path.is_file():
            raise OutputError(path, "this command reads it; choose another name for the output")


AtMm = Annotated[
    Point | None,
    opt("Commanded position of the platform, or of a robot's end frame.", metavar="X Y Z", callback=_of_size),
]
TiltDeg = Annotated[float | None, opt("Commanded tilt about y (default: 0).", metavar="T", callback=_of_size)]
RotationDeg = Annotated[
    Point | None,
    opt("Commanded orientation of an end frame: a rotation vector.", metavar="RX RY RZ", callback=_of_size),
]
Drives = Annotated[
    str | None,
    opt("Commanded joint values of the drives, in the robot's order: mm, deg.", metavar='"V V ..."', callback=_of_size),
]
ModelFile = Annotated[Path | None, reads("Model file of the robot as built (default: the drawing).")]
RobotFile = Annotated[Path | None, reads("Robot file, robot.yaml, of a robot other than the pouring robot.")]
LayoutName = Annotated[str | None, opt("Layout of the dimensions file (default: paper).", metavar="NAME")]
AsJson = Annotated[bool, opt("Print JSON instead of a table.", "--json")]
CampaignFile = Annotated[
    Path, argument("CAMPAIGN", "Table, such as a CSV, with a YAML file of the same name beside it.")
]
TolerancesFile = Annotated[
    Path | None, reads("Tolerances of the parts (default: the robot's own, or the shipped ones).")
]
HoldOutBy = Annotated[Literal["auto", "session", "time", "region"], opt("How rows are grouped into held-out blocks.")]
ReportFile = Annotated[Path | None, writes("Write the output, with plots, as an HTML page.")]
PngFile = Annotated[Path | None, writes("Write a picture; no screen is needed.", check=_check_png)]
AtOnce = Annotated[
    bool, opt("All poses at once, hundreds of times faster; temperatures are not iterated to the end.", "--at-once")
]
Exaggeration = Annotated[float | None, opt("Enlarge drawn errors this many times.", metavar="FACTOR")]
ThermalModelFile = Annotated[Path | None, reads("Thermal model from 'regress --out'.")]
Overwrite = Annotated[bool, opt("Replace existing files.", "--overwrite", is_eager=True, callback=_may_overwrite)]
Quiet = Annotated[bool, opt("Print nothing but errors and JSON.", "--quiet", "-q")]


def with_melt(robot: Robot) -> PouringRobot:
    """Return a robot that its melt warms, and refuse any but the pouring robot."""
    from pouring_robot.robot.pouring_robot import PouringRobot

    if isinstance(robot, PouringRobot):
        return robot
    name = robot.model.definition.name
    raise BadInputError(
        f"temperatures are computed from the pouring robot's melt, which {name} does not have; its growth with "
        f"measured ones is found by 'diagnose', see pouring-robot effects --robot FILE"
    )


def by_name(option: str, texts: Iterable[str] | None, such_as: str) -> dict[str, str]:
    """Return the values, by name, of a repeated option NAME=VALUE; raises BadInputError for any other form."""
    values = dict[str, str]()
    for text in texts or ():
        name, equals, value = (part.strip() for part in text.partition("="))
        if not name or not equals or not value:
            raise BadInputError(f"{option} '{text}': write NAME=VALUE, such as {such_as}")
        if name in values:
            raise BadInputError(f"{option} '{text}': '{name}' is given twice")
        values[name] = value
    return values


def note(*lines: str) -> None:
    """Print notes on standard error, unless only errors and JSON are to be printed."""
    if not QUIET.get():
        for line in lines:
            print(f"note: {line}", file=sys.stderr)


def print_json(content: Any) -> None:
    """Print JSON on standard output."""
    json.dump(content, sys.stdout, indent=2, allow_nan=False)
    sys.stdout.write("\n")


def print_figures(figures: Mapping[str, Any], written: Iterable[Path] = ()) -> None:
    """Print figures as JSON, followed by the written files."""
    print_json({**figures, "written": [str(path) for path in written]})


def wanted(path: Path | None, content: Callable[[], bytes | str]) -> dict[Path, bytes | str]:
    """Return the content of a requested file by its path; {} if no file was requested."""
    return {} if path is None else {path: content()}


def write_all(files: Mapping[Path, bytes | str]) -> list[Path]:
    """Write several files, all or none, and return them; without ``--overwrite`` no existing file is replaced."""
    refuse_inputs(files)
    return write_together(files, overwrite=OVERWRITE.get())


def say(what: Any, style: str | None = None, *, soft_wrap: bool | None = None) -> None:
    """Print a text or a table, unless only errors and JSON are to be printed."""
    terminal().print(what, style=style, soft_wrap=soft_wrap)


def terminal() -> Console:
    """Return the console for standard output: a terminal, file or pipe."""
    from rich.console import Console

    console = Console(markup=False, highlight=False, quiet=QUIET.get())
    if not console.is_terminal:  # its width is unknown
        console.width = max(console.width, _WIDTH)
    return console


def print_notes(notes: Iterable[str]) -> None:
    """Print notes, one line each."""
    for note in notes:
        say(f"note: {note}")


def print_written(written: Iterable[Path]) -> None:
    """Print which files were written, one line each."""
    for path in written:
        say(f"wrote {path}", soft_wrap=True)


def print_indented(line: str, by: int = 2) -> None:
    """Print a line indented, including its continuation lines."""
    width, space = terminal().width, " " * by
    say(textwrap.fill(line, width, initial_indent=space, subsequent_indent=space, break_on_hyphens=False))
