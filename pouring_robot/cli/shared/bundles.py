"""Groups of options that a subcommand gets as one object, and how they are presented to typer one by one."""

from __future__ import annotations

import contextlib
import functools
import inspect
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar, get_type_hints

import typer

from pouring_robot.cli.shared import options, progress
from pouring_robot.cli.shared.options import opt, writes
from pouring_robot.exceptions import BadInputError, NoSolutionError, PathPoseError
from pouring_robot.io.units import MM, UNITS, joint_shown_in

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from pouring_robot.effects.robots_under_conditions import RobotUnderConditions
    from pouring_robot.robot.export.joints import JointRow
    from pouring_robot.robot.heat_section import HeatSection
    from pouring_robot.robot.location import Location
    from pouring_robot.robot.model import RobotModel
    from pouring_robot.robot.robot import Command, Robot

Found = TypeVar("Found")


@dataclass(frozen=True)
class RobotOptions:
    """Options that choose the robot."""

    model: options.ModelFile = None
    robot: options.RobotFile = None
    layout: options.LayoutName = None

    def read(self) -> RobotModel:
        """Return the model of a model file, or the nominal model of a robot file or of a layout.

        A line on standard error warns if a model should not be used.
        """
        from pouring_robot.robot.model import RobotModel

        given = [f"--{name}" for name, value in vars(self).items() if value]
        if len(given) > 1:
            why = "a model file names its robot and its layout" if self.model else "layouts belong to the pouring robot"
            raise BadInputError(f"give {' or '.join(given)}, not both: {why}")
        if self.robot is not None:
            return RobotModel.for_robot(self.robot)
        model = RobotModel(layout=self.layout) if self.layout else RobotModel.of(self.model)
        options.note(*model.cautions(str(self.model)))
        return model

    def built(self, *, warm: bool = False, under: bool = False) -> Robot:
        """Return the robot, cold and without effects that depend on conditions.

        Unless the command applies heat (``warm``) and conditions (``under``), a line says what is left out.
        """
        from pouring_robot.robot.pouring_robot import robot_of

        present = self.read()
        options.note(*present.left_out("this command", str(self.model), warm=warm, under=under))
        return robot_of(present)


@dataclass(frozen=True)
class CommandOptions:
    """Options for the command to a robot."""

    at_mm: options.AtMm = None
    tilt_deg: options.TiltDeg = None
    rotation_deg: options.RotationDeg = None
    drives: options.Drives = None

    @property
    def given(self) -> bool:
        """Whether any of the options is given."""
        return self != CommandOptions()

    def of(self, robot: Robot) -> Command:
        """Return the command for a robot."""
        import numpy as np

        if (self.at_mm is None) == (self.drives is None):
            raise BadInputError("give either a pose by --at-mm or drive values by --drives")
        if self.tilt_deg is not None and self.rotation_deg is not None:
            raise BadInputError("give --tilt-deg or --rotation-deg, not both: a tilt T is the rotation 0 T 0")
        turn = (0.0, self.tilt_deg, 0.0) if self.tilt_deg is not None else self.rotation_deg
        if self.at_mm is not None:
            return robot.pose_command(np.array(self.at_mm) * MM, None if turn is None else np.radians(turn))
        if turn is not None:
            raise BadInputError("--tilt-deg and --rotation-deg belong to --at-mm, not to --drives")
        entries = robot.model.definition.drives
        units = [joint_shown_in(drive.unit) for drive in entries]
        try:
            values = [float(part) for part in (self.drives or "").replace(",", " ").split()]
        except ValueError:
            values = []
        if len(values) != len(entries) or not np.isfinite(values).all():
            wanted = ", ".join(f"{drive.joint} ({unit})" for drive, (unit, _) in zip(entries, units, strict=True))
            raise BadInputError(f"--drives '{self.drives}': give one number for each of {wanted}")
        return np.array(values) * [size for _, size in units]


@dataclass(frozen=True)
class ConditionOptions:
    """Options for the conditions under which a robot works."""

    condition: Annotated[
        list[str] | None,
        opt("Condition for the model's effects, named as in a campaign; repeatable.", metavar="NAME=VALUE"),
    ] = None

    def read_commands(self, robot: Robot, path: Path) -> Mapping[int, Command]:
        """Return the commands of a table by line number; the table may also have columns of conditions.

        A line on standard error says which of these have no effect.
        """
        from pouring_robot.campaign.columns import condition_headings
        from pouring_robot.io.tables import read_table
        from pouring_robot.robot.pouring_robot import PouringRobot

        if path.is_fifo():
            raise BadInputError(f"{path}: is a pipe, but this table is read more than once; save it as a file")
        known = condition_headings(robot.model.definition)
        found = robot.read_commands(path, known)
        unused = [name for name in read_table(path, "").headings if name in known and not robot.model.conditional]
        if unused:
            thermal = any(name.rpartition("_")[2] in UNITS["temperature"] for name in unused)
            warms = "; --melt-degC and --ambient-degC warm the robot, alike at every pose"
            said = warms if thermal and isinstance(robot, PouringRobot) else ""
            options.note(f"{path}: nothing in the model depends on {', '.join(unused)}{said}")
        return found

    def of(self, robot: Robot, beside: Path | Mapping[str, Any] | None = None) -> RobotUnderConditions | None:
        """Return a robot under its conditions; ``beside``: further ones, in a table of commands or by heading.

        None: nothing in the robot depends on conditions.
        """
        if not robot.model.conditional:
            if self.condition:
                raise BadInputError("nothing in the model depends on conditions: leave out --condition")
            return None
        from pouring_robot.effects.robots_under_conditions import RobotUnderConditions, conditions_beside

        given: dict[str, Any] = {**options.by_name("--condition", self.condition, "time_s=3600")}
        columns = conditions_beside(beside, robot.model.definition) if isinstance(beside, Path) else dict(beside or {})
        if twice := given.keys() & columns.keys():
            raise BadInputError(f"'{min(twice)}' is given by --condition and by a column; keep one")
        return RobotUnderConditions(robot, columns | given)

    def refuse_with(self, option: str, robot: Robot) -> None:
        """Refuse effects that depend on conditions, and conditions, with an option that uses one robot for all."""
        if robot.model.conditional:
            effects = ", ".join(robot.model.conditional)
            raise BadInputError(
                f"{option} uses the same robot at every pose, but {effects} depend on conditions; leave {option} out"
            )
        self.of(robot)

    def robots(
        self, robot: Robot, commands: Mapping[int, Command], poses: Path | None = None
    ) -> tuple[list[Robot], tuple[str, ...]]:
        """Return the robot under the conditions of each command, and notes on the conditions.

        Commands are by line number in their table ``poses``, if they are from one; if not, a line on standard error
        says which conditions have no effect.
        """
        under = self.of(robot, poses)
        if under is None:
            return [robot] * len(commands), ()
        drives = []
        for line, command in commands.items():
            with at_line(poses, line):
                drives.append(robot.drives_of(command))
        robots = under.robots(drives)
        if poses is None:
            say_idle(under, drives)
        return robots, under.notes


def say_idle(under: RobotUnderConditions, drives: ArrayLike) -> None:
    """Note on standard error which conditions given by option have no effect at commands (n, drives), m and rad."""
    if under.given and (idle := ", ".join(under.idle(drives))):  # without conditions no second closure is needed
        options.note(f"--condition {idle} changes nothing here")


@contextlib.contextmanager
def at_line(path: Path | None, line: int) -> Iterator[None]:
    """Add the line number in a table, if there is one, to an error."""
    try:
        yield
    except NoSolutionError as error:
        if path is None:
            raise
        raise PathPoseError(path, line, error) from error


def each(
    commands: Mapping[int, Command], robots: Iterable[Robot], path: Path | None, stage: str, find: Callable[..., Found]
) -> list[Found]:
    """Return the result of ``find`` for each command and its robot; an error names the line in their table."""
    found: list[Found] = []
    with progress.stage_bars() as show:
        for (line, command), robot in zip(commands.items(), robots, strict=True):
            with at_line(path, line):
                found.append(find(command, robot))
            show(stage, len(found), len(commands))
    return found


@dataclass(frozen=True)
class Melt:
    """Options for the heat of a robot."""

    melt_degC: Annotated[
        float | None,
        opt(
            "Temperature of the melt (default: the model file's or 1700); warms the robot.",
            "--melt-degC",
            metavar="T",
        ),
    ] = None
    ambient_degC: Annotated[
        float | None,
        opt(
            "Temperature of the surroundings (default: the model file's or 20); warms the robot.",
            "--ambient-degC",
            metavar="T",
        ),
    ] = None
    steady: Annotated[bool, opt("Warm, in the steady state.", "--steady")] = False
    after_min: Annotated[float | None, opt("Warm, this long after the melt came to the cold robot.", metavar="MIN")] = (
        None
    )

    def of(self, robot: Robot) -> HeatSection | None:
        """Return the heat of a robot, with options overriding its model file; None: cold."""
        from pouring_robot.robot.heat_section import HeatSection

        if self.steady and self.after_min is not None:
            raise BadInputError("give --steady or --after-min, not both")
        names = ("melt_degC", "ambient_degC", "after_min")
        given: dict[str, Any] = {name: getattr(self, name) for name in names if getattr(self, name) is not None}
        if isinstance(self, Heat) and self.cold:
            if given or self.steady:
                raise BadInputError("--cold leaves heat out; give it without other options of heat")
            return None
        if robot.model.heat is None and not given and not self.steady:
            return None
        options.with_melt(robot)
        if self.steady:
            given["after_min"] = None
        stated = robot.model.heat or HeatSection()
        section = stated.with_values(**given)
        options.note(*section.cautions)
        if stated.measured_degC and not section.measured_degC:
            parts = ", ".join(stated.measured_degC)
            options.note(f"measured temperatures of the model file are of another time and not used: {parts}")
        return section


@dataclass(frozen=True)
class Heat(Melt):
    """Options for the heat of a robot, including none."""

    cold: Annotated[bool, opt("Leave out the heat that the model file states.", "--cold")] = False


@dataclass(frozen=True)
class Drawing:
    """Options for pictures and files of locations."""

    html: Annotated[Path | None, writes("Write a self-contained meshcat page.")] = None
    png: options.PngFile = None
    exaggerate: options.Exaggeration = None
    joints: Annotated[
        Path | None, writes("Write the values of all joints, m and rad, as .csv or .json.", check=options.check_joints)
    ] = None

    def __post_init__(self) -> None:
        if self.exaggerate is not None and not (self.html or self.png):
            raise BadInputError("--exaggerate enlarges the errors in a picture; ask for one with --html or --png")

    def files(
        self, locations: list[Location], model: RobotModel, *, warm: bool = False
    ) -> tuple[dict[Path, bytes | str], list[str]]:
        """Return the requested content by the file to which it is to be written, and :meth:`tree_notes`."""
        rows: list[JointRow] = []
        if self.joints is not None:
            from pouring_robot.robot.export.joints import JointRow

            offsets = model.drive_offset_values()
            rows = [JointRow.of(one.actual, offsets, one.drives) for one in locations]
        tips_m = [one.poses(one.loops.working_frame)[1].translation for one in locations]
        drawn, notes = self.joint_table(rows), self.tree_notes(rows, tips_m, model, warm=warm)
        if self.html or self.png:
            # The drawing libraries take half a second to import; only commands that draw need them.
            from pouring_robot.robot.view.nominal_and_actual import pose_scene
            from pouring_robot.viewer.page import page
            from pouring_robot.viewer.picture import png

            scene = pose_scene(locations, self.exaggerate, "as built, warm" if warm else "as built")
            drawn |= options.wanted(self.html, lambda: page(scene)) | options.wanted(self.png, lambda: png(scene))
        return drawn, notes

    def joint_table(self, rows: Sequence[JointRow]) -> dict[Path, bytes | str]:
        """Return the table of joint values as built, for the exported tree, by its file; {} if none is requested."""
        from pouring_robot.robot.export.joints import joints_text

        return options.wanted(self.joints, lambda: joints_text(rows, self.joints or Path()))

    def tree_notes(self, rows: Sequence[JointRow], tips_m: ArrayLike, model: RobotModel, *, warm: bool) -> list[str]:
        """Return a line on the distance of the exported tree from a robot that is warm or under conditions.

        It is computed from rows of joint values, if requested, and the robot's tip positions, (n, 3), in m.
        """
        if not rows or not (warm or model.conditional):
            return []
        import numpy as np

        from pouring_robot.robot.export.tree_at_closed_pose import ClosedRobot

        tree = ClosedRobot.of(model)
        off = np.linalg.norm(tree.tips_m(row.values for row in rows) - np.asarray(tips_m), axis=1)
        words = "robot under conditions", "leaves them out"
        robot, does = words if model.conditional else ("warm robot", "is cold")
        return [
            f"{self.joints} is for the {robot}, but the tree that 'export' writes {does}: with these joint values its "
            f"{model.definition.loops.working_frame} is up to {np.nanmax(off) / MM:.3f} mm off"
        ]


def group_of(about: str, commands: Iterable[Callable[..., None]]) -> typer.Typer:
    """Return subcommands as a group, whose help page shows the first paragraph of each unabridged."""
    group = typer.Typer(
        help=about, short_help=about, add_completion=False, rich_markup_mode=None, context_settings=HELP_PAGE
    )
    for command in commands:
        summary, *_ = (inspect.getdoc(command) or "").split("\n\n")
        group.command(command.__name__, short_help=" ".join(summary.split()))(_spread(command))
    return group


HELP_PAGE = {"help_option_names": ["-h", "--help"], "max_content_width": 120}  # settings of all help pages


def _spread(command: Callable[..., None]) -> Callable[..., None]:
    """Return a command that typer can read: bundles become single options, and common options are added."""
    hints = get_type_hints(command, include_extras=True)
    flat: dict[str, inspect.Parameter] = {}
    bundles: dict[str, tuple[Any, list[str]]] = {}
    for name, parameter in inspect.signature(command).parameters.items():
        if not is_dataclass(hints[name]):
            flat[name] = parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY, annotation=hints[name])
            continue
        own, annotations = inspect.signature(hints[name]).parameters, get_type_hints(hints[name], include_extras=True)
        flat |= {n: p.replace(kind=inspect.Parameter.KEYWORD_ONLY, annotation=annotations[n]) for n, p in own.items()}
        bundles[name] = (hints[name], list(own))
    written = {name: options.written_by(parameter.annotation) for name, parameter in flat.items()}
    outputs = {name: files for name, files in written.items() if files}
    added = {"quiet": options.Quiet} | ({"overwrite": options.Overwrite} if outputs else {})
    for name, annotation in added.items():
        flat[name] = inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=False, annotation=annotation)

    @functools.wraps(command)
    def spread(**given: Any) -> None:
        options.QUIET.set(given.pop("quiet"))
        if outputs:
            del given["overwrite"]
        paths = {name: value for name, value in given.items() if isinstance(value, Path)}
        read = [path for name, path in paths.items() if name not in outputs]
        read += [path.with_suffix(".yaml") for name, path in paths.items() if name == "campaign"]  # it lies beside
        options.INPUTS.set(frozenset(path.resolve() for path in read))
        options.refuse_inputs(path / file for name, path in paths.items() for file in outputs.get(name, ()))
        whole = {name: kind(**{field: given.pop(field) for field in own}) for name, (kind, own) in bundles.items()}
        command(**given, **whole)

    spread.__signature__ = inspect.Signature(list(flat.values()))  # type: ignore[attr-defined]  # as typer reads it
    spread.__annotations__ = {name: parameter.annotation for name, parameter in flat.items()}
    return spread
