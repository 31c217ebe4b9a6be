"""``pouring-robot robot``: starter files for a user's own robots."""

from __future__ import annotations

import contextlib
import shlex
import sys
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pouring_robot.cli.shared import bundles, options
from pouring_robot.cli.shared.options import Pair, argument, opt, results_folder, writes
from pouring_robot.exceptions import BadInputError, NoSolutionError
from pouring_robot.io.files import write_whole

if TYPE_CHECKING:
    from pouring_robot.robot.location import LadleLocation
    from pouring_robot.robot.pouring.new_layout import NewLayout


_OWN = ("layouts.yaml", "model.yaml", "robot.html")


def init(
    urdf: Annotated[Path, argument("URDF", "The robot's URDF, or a xacro.")],
    out: Annotated[Path | None, writes("Where to write it (default: robot.yaml beside the URDF).")] = None,
    mapping: Annotated[list[str] | None, opt("An argument of the xacro; repeatable.", metavar="NAME=VALUE")] = None,
) -> None:
    """Write a first robot file for a URDF, with comments on what to fill in.

    Loops of a Gepetto robot.yaml beside it are taken over; the file is then called robot_file.yaml.
    """
    from pouring_robot.robot.description.first_file import first_robot, loops_beside

    path = out or urdf.parent / ("robot_file.yaml" if loops_beside(urdf) else "robot.yaml")
    options.refuse_targets([path])
    mappings = options.by_name("--mapping", mapping, "dof=6")
    text, found = first_robot(urdf, path, mappings)  # a robot that does not load is refused before a file is written
    options.write_all({path: text})
    drives = ", ".join(f"{drive.column} ({drive.command})" for drive in found.drives)
    frames = f"{found.loops.base_frame} to {found.loops.end_frame}"
    options.say(f"{found.name}: {frames}, {len(found.drives)} drives: {drives}")
    options.print_written((path,))
    options.say(f"next: read its comments, then pouring-robot robots --robot {shlex.quote(str(path))}", soft_wrap=True)


def _two(help_: str) -> Any:
    return opt(help_, metavar="A B", show_default=False)


@dataclass(frozen=True)
class Sizes:
    """Sizes of a new machine, as far as given."""

    name: Annotated[str | None, opt("Name of the layout.", show_default=False)] = None
    fixed_mm: Annotated[Pair, _two("Distances of the upper U joints along x and y.")] = None
    moving_mm: Annotated[Pair, _two("Distances of the lower U joints along x and y.")] = None
    x_mm: Annotated[Pair, _two("Workspace of the moving platform along x.")] = None
    y_mm: Annotated[Pair, _two("Workspace along y.")] = None
    z_mm: Annotated[Pair, _two("Workspace along z; negative below the fixed platform.")] = None
    tilt_deg: Annotated[Pair, _two("Smallest and largest tilt.")] = None
    stroke_mm: Annotated[Pair, _two("Shortest and longest leg (default: as needed).")] = None
    payload_kg: Annotated[float | None, opt("Largest mass of melt.", show_default=False)] = None
    tare_kg: Annotated[float | None, opt("Mass of the empty ladle.", show_default=False)] = None


def new(
    *,
    out: Annotated[Path, results_folder(*_OWN)] = Path("my_robot"),
    sizes: Sizes,
    yes: Annotated[bool, opt("Ask nothing; values not given are those of the paper's robot.", "--yes")] = False,
    png: options.PngFile = None,
) -> None:
    """Describe a 4-UPU machine of your own: ask for its sizes, write its files, check its workspace, draw it.

    All else (ladle, truss, parts of the legs) is as in the paper's robot; change it in layouts.yaml.
    """
    from pouring_robot.robot.model import RobotModel
    from pouring_robot.robot.pouring.new_layout import NewLayout, check_lines, checked

    usual = NewLayout.usual()
    answers: dict[str, Any] = {"stroke_mm": sizes.stroke_mm}
    for key, value in vars(sizes).items():
        if key not in answers:
            said = getattr(usual, key) if value is None else value
            answers[key] = said if yes or value is not None else _asked(key, usual)
    layout = replace(usual, **answers)
    for line in check_lines(checked(layout)):
        options.say(line)
    layouts, model, page = (out / name for name in _OWN)
    own = RobotModel(layout=layout.name, layouts_file=str(layouts))
    middle = _in_the_middle(layout)  # a machine that cannot be drawn is refused before a file is written
    drawn, _ = bundles.Drawing(html=page, png=png).files([middle], own)
    options.print_written(options.write_all({layouts: layout.file_text(), model: own.file_text(out)} | drawn))
    options.say(f"next: pouring-robot robots --model {shlex.quote(str(model))}", soft_wrap=True)


def _in_the_middle(layout: NewLayout) -> LadleLocation:
    """Return the location of a new machine in the middle of its workspace, or raise NoSolutionError."""
    from pouring_robot.robot.model import RobotModel
    from pouring_robot.robot.pouring_robot import PouringRobot

    with tempfile.TemporaryDirectory() as scratch:
        layouts = write_whole(Path(scratch) / "layouts.yaml", layout.file_text())
        try:
            return PouringRobot(RobotModel(layout=layout.name, layouts_file=str(layouts))).location_in_the_middle()
        except NoSolutionError as error:
            raise NoSolutionError(f"in the middle of the workspace {error}; nothing is written") from error


def _asked(key: str, layout: NewLayout) -> Any:
    """Ask for a value until it is valid for the layout: a word, a number, or two numbers."""
    from pouring_robot.robot.pouring.new_layout import QUESTIONS

    with contextlib.suppress(ImportError):
        import readline  # noqa: F401  # lets arrow keys edit the input

    usual = getattr(layout, key)

    def parsed(text: str) -> Any:
        answer: Any = text
        if not isinstance(usual, str):
            try:
                numbers = tuple(float(word) for word in text.replace(",", " ").split())
            except ValueError:
                numbers = ()
            wanted = len(usual) if isinstance(usual, tuple) else 1
            if len(numbers) != wanted:
                raise typer.BadParameter("one number" if wanted == 1 else "two numbers separated by a blank")
            answer = numbers if wanted > 1 else numbers[0]
        try:
            replace(layout, **{key: answer})
        except BadInputError as error:
            raise typer.BadParameter(str(error)) from error
        return answer

    numbers = usual if isinstance(usual, tuple) else (usual,)
    shown = usual if isinstance(usual, str) else " ".join(f"{value:g}" for value in numbers)
    try:
        if sys.stdin is not None:  # closed
            return typer.prompt(QUESTIONS[key], default=shown, value_proc=parsed)
    except typer.Abort:
        print()  # after the question
        if sys.stdin.isatty():  # Ctrl-C
            raise
    raise BadInputError("there is no terminal to answer questions; use --yes")


robot = bundles.group_of("Robots of your own: the pouring robot in other sizes, or any other robot.", [init, new])
