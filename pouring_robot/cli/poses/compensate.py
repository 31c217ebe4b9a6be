"""``pouring-robot compensate``: what to command so that the actual robot comes to where it should be."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar

from pouring_robot.cli.shared import bundles, options, progress
from pouring_robot.exceptions import BadInputError, NoSolutionError, UnknownFrameError

if TYPE_CHECKING:
    from pouring_robot.cli.poses.heat import ThermalLaw
    from pouring_robot.compensation.pose import Compensation, DriveCompensation
    from pouring_robot.effects.under import RobotUnderConditions
    from pouring_robot.robot.heat_section import HeatSection
    from pouring_robot.robot.pouring.poses import PlatformPose
    from pouring_robot.robot.pouring_robot import PouringRobot
    from pouring_robot.robot.robot import Command, Robot

Found = TypeVar("Found", "Compensation", "DriveCompensation")
_REST = "--out FILE.csv writes all"


@dataclass(frozen=True)
class Asked:
    """What shall be right, where, and what becomes of the answer."""

    poses: Annotated[
        Path | None, options.argument("POSES.csv", "Wanted poses, as 'path' reads them. Or --at-mm, or --drives.")
    ] = None
    frame: Annotated[
        str | None,
        options.opt(
            "--frame",
            "What shall be right: moving_platform (default), ladle or ladle_lip; of another robot its tool.",
            metavar="NAME",
        ),
    ] = None
    out: Annotated[Path | None, options.writes("--out", "Write the commands, one row a pose.", metavar="FILE.csv")] = (
        None
    )
    at_once: options.AtOnce = False
    header: Annotated[
        Path | None,
        options.writes("--header", "Write a C function that compensates, in place of poses.", metavar="FILE.h"),
    ] = None
    as_json: options.AsJson = False


def compensate(
    *,
    commanded: bundles.Commanded,
    which: bundles.Which,
    under: bundles.Under,
    asked: Asked,
    heat: bundles.Heat,
    thermal_model: options.ThermalModelFile = None,
) -> None:
    """Find drive values that bring the actual ladle, or tool, to wanted poses, and say what they cannot cancel.

    With --after-min every pose is taken by itself: held so long from cold.
    """
    from pouring_robot.cli.poses.heat import thermal_law

    if asked.poses is not None and commanded.given:
        raise BadInputError("give a file of poses or one command by options, one of the two")
    present = which.built(warm=True, under=True)
    from pouring_robot.robot.pouring_robot import PouringRobot

    known = present.nominal_solver.mechanism.loops.reported_frames
    if asked.frame is not None and asked.frame not in known:
        raise UnknownFrameError(asked.frame, known)
    warmth = heat.of(present)
    if asked.at_once or asked.header:
        if not isinstance(present, PouringRobot):
            raise BadInputError("--at-once and --header know the pouring robot only")
        if commanded.given or thermal_model:
            raise BadInputError("--at-once and --header go without --at-mm, --drives and --thermal-model")
        options.refuse_conditional(present, "--at-once" if asked.at_once else "--header")
        _in_bulk(asked, present, warmth)
        return
    wanted = {0: commanded.of(present)} if asked.poses is None else under.read_commands(present, asked.poses)
    standing = under.of(present, asked.poses)
    if isinstance(present, PouringRobot):
        law = thermal_law(thermal_model, present, warmth)
        _ladle(asked, present, wanted, standing, law.heat if law else warmth, law)
    elif thermal_model is not None:
        raise BadInputError("--thermal-model is for the pouring robot")
    else:
        _tool(asked, present, wanted, standing)


def _ladle(
    asked: Asked,
    robot: PouringRobot,
    wanted: Mapping[int, Command],
    under: RobotUnderConditions | None,
    heat: HeatSection | None,
    law: ThermalLaw | None,
) -> None:
    from pouring_robot.cli.poses import heat as warm
    from pouring_robot.cli.poses.compensated import commands_table, compensation_lines
    from pouring_robot.compensation.pose import commands_csv
    from pouring_robot.compensation.pose import compensate as compensated
    from pouring_robot.robot.pouring.poses import PlatformPose
    from pouring_robot.robot.pouring_robot import PouringRobot
    from pouring_robot.thermal.expansion.heated_robot import HeatedRobot

    heated = HeatedRobot(robot, heat)

    def bring(command: Command, standing: Robot) -> Compensation:
        if not isinstance(command, PlatformPose) or not isinstance(standing, PouringRobot):
            raise BadInputError("a ladle is brought to a pose: give --at-mm and --tilt-deg")
        return compensated(heated.built_as(standing), command, asked.frame, law.moves_m(command) if law else None)

    found = _each(asked, robot, wanted, under, bring)
    written = options.written(asked.out, lambda: commands_csv(found))
    if asked.as_json:
        rows = [one.figures() | {"heat": warm.heat_figures(heated, one.state)} for one in found]
        options.print_figures({**robot.model.named, "poses": rows}, written)
        return
    console = options.console()
    for k, sentence in enumerate(compensation_lines(found, closed=law is None)):
        console.print(sentence, style="" if k else "bold")
    if not asked.out:
        console.print(commands_table(found), soft_wrap=True)
    console.print(warm.heat_line(heated, found[0].state) + (" (first pose)" if len(found) > 1 else ""))
    if heat is not None and len(found) > 1:
        console.print(warm.alone_line(heat))
    if law is not None:
        console.print(f"{law.words}; the drives follow from the paper's sum, what is left is that of the full closure")
    notes = [*(under.notes if under else ()), *warm.twice_lines(robot, heat)]
    if robot.model.is_drawing and heat is None and under is None:
        notes.insert(0, "the drawing, cold, needs no compensation; give --model, --melt-degC or both")
    outside = [str(i) for i, one in enumerate(found, start=1) if _is_outside(robot, one.wanted)]
    if outside:
        notes.append(f"outside the workspace box: pose {', '.join(outside)}")
    options.print_notes(console, notes)
    options.print_written(console, written)


def _in_bulk(asked: Asked, robot: PouringRobot, heat: HeatSection | None) -> None:
    """Compensate a whole path, or make the function that does it elsewhere."""
    from pouring_robot.cli.shared.tables import few_rows
    from pouring_robot.compensation.path import compensate_path, make_controller
    from pouring_robot.robot.pose_table import read_poses
    from pouring_robot.thermal.expansion.heated_robot import HeatedRobot

    heated, written = HeatedRobot(robot, heat), []
    if (asked.poses is None) == (asked.header is None):
        raise BadInputError("--at-once takes a file of poses; --header takes none, as it is for the whole workspace")
    with progress.stage_bars() as show:
        if asked.poses is None:
            made = make_controller(heated, asked.frame, show)
            headline, table = made.headline, made.to_frame()
            written = options.written(asked.header, made.header)
        else:
            wanted = [(*pose.position_m, pose.tilt_rad) for pose in read_poses(asked.poses)]
            found = compensate_path(heated, wanted, asked.frame, show=show)
            headline, table = found.headline, found.to_frame()
            if not (found.status == "closed").any():
                raise NoSolutionError(headline)
    written += options.written(asked.out, lambda: str(table.to_csv(index=False)))
    if asked.as_json:
        rows = table.astype(object).where(table.notna(), None).to_dict(orient="records")
        options.print_figures({**robot.model.named, "headline": headline, "rows": rows}, written)
        return
    console = options.console()
    console.print(headline, style="bold")
    if not written:
        cells = [
            [f"{value:.4f}" if isinstance(value, float) else str(value) for value in row]
            for row in table.to_numpy().tolist()
        ]
        console.print(few_rows(list(table.columns), cells, _REST), soft_wrap=True)
    options.print_written(console, written)


def _tool(asked: Asked, robot: Robot, wanted: Mapping[int, Command], under: RobotUnderConditions | None) -> None:
    """Compensate a robot that is commanded by drive values."""
    from pouring_robot.cli.shared.tables import few_rows
    from pouring_robot.compensation.pose import compensate_drives, drives_csv

    def bring(command: Command, standing: Robot) -> DriveCompensation:
        return compensate_drives(standing, standing.location_of(command), asked.frame)

    found = _each(asked, robot, wanted, under, bring)
    written = options.written(asked.out, lambda: drives_csv(found))
    if asked.as_json:
        options.print_figures({**robot.model.named, "poses": [one.figures() for one in found]}, written)
        return
    console = options.console()
    if len(found) == 1:
        console.print(found[0].headline, style="bold")
    if not asked.out:
        head = [name.replace("_", " ") for name in found[0].row()]
        rows = [[f"{value:.4f}" for value in one.row().values()] for one in found]
        console.print("drives to command; how far off without and with it", style="italic")
        console.print(few_rows(head, rows, _REST), soft_wrap=True)
    options.print_notes(console, under.notes if under else ())
    if robot.model.is_drawing and under is None:
        options.print_notes(console, ["the drawing needs no compensation; give --model"])
    options.print_written(console, written)


def _each(
    asked: Asked,
    robot: Robot,
    wanted: Mapping[int, Command],
    under: RobotUnderConditions | None,
    bring: Callable[[Command, Robot], Found],
) -> list[Found]:
    """Return what is found for each command; an error names the line of its table."""
    if under is None:
        return bundles.each(wanted, [robot] * len(wanted), asked.poses, "compensating", bring)
    from pouring_robot.effects.under import compensate_under

    lines = list(wanted)

    def at(k: int, standing: Robot) -> Found:
        with bundles.at_line(asked.poses, lines[k]):
            return bring(wanted[lines[k]], standing)

    with progress.stage_bars() as show:
        return compensate_under(under, list(wanted.values()), at, show)


def _is_outside(robot: PouringRobot, pose: PlatformPose) -> bool:
    shift_m, turn_rad = robot.outside_workspace(pose)
    return bool(shift_m.any()) or turn_rad > 0.0
