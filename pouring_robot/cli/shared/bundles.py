"""Options that go together and reach a subcommand as one object, and how typer gets to see them one by one."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Iterable
from dataclasses import dataclass, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_type_hints

import typer

from pouring_robot.cli.shared import options

if TYPE_CHECKING:
    from pouring_robot.robot.base import Command, Robot
    from pouring_robot.robot.heat_section import HeatSection
    from pouring_robot.robot.location import Location
    from pouring_robot.robot.model import RobotModel


@dataclass(frozen=True)
class Which:
    """The robot that is meant."""

    model: options.ModelFile = None
    robot: options.RobotFile = None
    layout: options.LayoutName = None

    @property
    def given(self) -> bool:
        """Whether any option says."""
        return self != Which()

    def read(self) -> RobotModel:
        """Return its model."""
        return options.model_of(self.model, self.robot, self.layout)

    def built(self, *, warm: bool = False) -> Robot:
        """Return the robot, cold; ``warm``: the command cares for the heat that a model file tells of."""
        return options.robot_of(self.model, self.robot, self.layout, warm=warm)


@dataclass(frozen=True)
class Commanded:
    """What it is sent to."""

    at_mm: options.AtMm = None
    tilt_deg: options.TiltDeg = None
    rotation_deg: options.RotationDeg = None
    drives: options.Drives = None

    @property
    def given(self) -> bool:
        """Whether any option says."""
        return self != Commanded()

    def of(self, robot: Robot) -> Command:
        """Return the command as this robot takes it."""
        return options.command_of(robot, self.at_mm, self.tilt_deg, self.rotation_deg, self.drives)


@dataclass(frozen=True)
class Melt:
    """How warm it is."""

    melt_degC: options.MeltDegC = None  # noqa: N815 - the unit keeps its capital
    ambient_degC: options.AmbientDegC = None  # noqa: N815
    steady: options.Steady = False
    after_min: options.AfterMin = None

    @property
    def left_out(self) -> bool:
        """Whether the heat that a model file tells of is left out."""
        return False

    def of(self, robot: Robot) -> HeatSection | None:
        """Return how warm this robot is, over what its model file says; None: cold."""
        from pouring_robot.cli.shared.heat import heat_of

        return heat_of(robot, self.melt_degC, self.ambient_degC, self.steady, self.after_min, self.left_out)


@dataclass(frozen=True)
class Heat(Melt):
    """How warm it is, if at all."""

    cold: options.Cold = False

    @property
    def left_out(self) -> bool:
        """Whether the heat that a model file tells of is left out."""
        return self.cold


@dataclass(frozen=True)
class Drawing:
    """What is drawn and written of locations."""

    html: options.HtmlFile = None
    png: options.PngFile = None
    exaggerate: options.Exaggeration = None
    joints: options.JointsFile = None

    def write(self, locations: list[Location], model: RobotModel, *, warm: bool) -> list[Path]:
        """Write what was asked for, and return the files."""
        from pouring_robot.cli.shared import locations as places

        written = places.write_drawings(locations, self.html, self.png, self.exaggerate, warm=warm)
        return written + places.write_joints(locations, model, self.joints)


def group_of(about: str, commands: Iterable[Callable[..., None]]) -> typer.Typer:
    """Return subcommands as a group; its help page shows the first sentence of each as a whole."""
    group = typer.Typer(
        help=about, short_help=about, add_completion=False, rich_markup_mode=None, context_settings=HELP_PAGE
    )
    for command in commands:
        summary, *_ = (inspect.getdoc(command) or "").split("\n\n")
        group.command(command.__name__, short_help=" ".join(summary.split()))(_spread(command))
    return group


HELP_PAGE = {"help_option_names": ["-h", "--help"], "max_content_width": 120}
"""What help pages have in common."""


def _spread(command: Callable[..., None]) -> Callable[..., None]:
    """Return a command that typer can read: bundles are single options, and those that all commands have are added."""
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
    added = {"quiet": options.Quiet, "overwrite": options.Overwrite}
    if not any(options.is_output(parameter.annotation) for parameter in flat.values()):
        del added["overwrite"]
    for name, annotation in added.items():
        flat[name] = inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=False, annotation=annotation)

    @functools.wraps(command)
    def spread(**given: Any) -> None:
        for name in added:
            del given[name]
        whole = {name: kind(**{field: given.pop(field) for field in own}) for name, (kind, own) in bundles.items()}
        command(**given, **whole)

    spread.__signature__ = inspect.Signature(list(flat.values()))  # type: ignore[attr-defined]  # as typer reads it
    spread.__annotations__ = {name: parameter.annotation for name, parameter in flat.items()}
    return spread
