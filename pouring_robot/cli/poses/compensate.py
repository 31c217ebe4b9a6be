"""``pouring-robot compensate``: what to command so that the actual robot reaches the wanted pose."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar

from pouring_robot.cli.shared import bundles, options, progress
from pouring_robot.cli.shared.options import argument, opt, writes, writes_csv
from pouring_robot.cli.shared.tables import print_rows
from pouring_robot.exceptions import BadInputError, NoSolutionError, UnknownFrameError
from pouring_robot.io.units import MM, MRAD

if TYPE_CHECKING:
    from pouring_robot.cli.poses.heat import ThermalLaw
    from pouring_robot.compensation.pose import Compensation, DriveCompensation
    from pouring_robot.effects.robots_under_conditions import RobotUnderConditions
    from pouring_robot.robot.heat_section import HeatSection
    from pouring_robot.robot.pouring_robot import PouringRobot
    from pouring_robot.robot.robot import Command, Robot

Found = TypeVar("Found", "Compensation", "DriveCompensation")


@dataclass(frozen=True)
class Asked:
    """What is to be correct, at which poses, and where the result is written."""

    poses: Annotated[
        Path | None, argument("POSES.csv", "Wanted poses, as 'path' reads them; or use --at-mm or --drives.")
    ] = None
    frame: Annotated[
        str | None,
        opt(
            "Frame to correct: moving_platform (default), ladle or ladle_lip; of another robot its tool.",
            metavar="NAME",
        ),
    ] = None
    out: Annotated[Path | None, writes_csv("Write the commands, one row per pose.")] = None
    at_once: options.AtOnce = False
    header: Annotated[Path | None, writes("Write a C function that compensates any pose.", "FILE.h")] = None
    as_json: options.AsJson = False


def compensate(
    *,
    commanded: bundles.CommandOptions,
    which: bundles.RobotOptions,
    under: bundles.ConditionOptions,
    asked: Asked,
    heat: bundles.Heat,
    thermal_model: options.ThermalModelFile = None,
) -> None:
    """Find drive values that bring the actual ladle, or tool, to wanted poses, and say what they cannot cancel.

    With --after-min each pose is computed on its own, held that long from cold.
    """
    from pouring_robot.cli.poses.heat import thermal_law

    if (asked.poses is not None) == commanded.given and not (asked.at_once or asked.header):
        raise BadInputError("give either a file of poses or one command by options")
    present = which.built(warm=True, under=True)
    from pouring_robot.robot.pouring_robot import PouringRobot

    known = present.nominal_solver.mechanism.loops.reported_frames
    if asked.frame is not None and asked.frame not in known:
        raise UnknownFrameError(asked.frame, known)
    warmth = heat.of(present)
    if asked.at_once or asked.header:
        if not isinstance(present, PouringRobot):
            raise BadInputError("--at-once and --header work for the pouring robot only")
        if commanded.given or thermal_model:
            raise BadInputError("--at-once and --header cannot be used with --at-mm, --drives or --thermal-model")
        under.refuse_with("--at-once" if asked.at_once else "--header", present)
        _in_bulk(asked, present, warmth)
        return
    wanted = {0: commanded.of(present)} if asked.poses is None else under.read_commands(present, asked.poses)
    standing = under.of(present, asked.poses)
    if isinstance(present, PouringRobot):
        law = thermal_law(thermal_model, present, warmth, cold=heat.cold)
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
    from pouring_robot.cli.shared.locations import outside_notes
    from pouring_robot.compensation.pose import commands_csv
    from pouring_robot.compensation.pose import compensate as compensated
    from pouring_robot.robot.pouring.platform_pose import PlatformPose
    from pouring_robot.thermal.expansion.warm_pouring_robot import HeatedRobot

    heated = HeatedRobot(robot, heat)

    def bring(command: Command, standing: Robot) -> Compensation:
        if not isinstance(command, PlatformPose):
            raise BadInputError("the ladle needs a pose: give --at-mm and --tilt-deg")
        built = heated.built_as(options.with_melt(standing))
        return compensated(built, command, asked.frame, law.moves_m(command) if law else None)

    found = _each(asked, robot, wanted, under, bring)
    written = options.write_all(options.wanted(asked.out, lambda: commands_csv(found)))
    if asked.as_json:
        rows = [one.figures() | {"heat": warm.heat_figures(heated, one.state)} for one in found]
        return options.print_figures({**robot.model.named, "poses": rows}, written)
    for k, sentence in enumerate(_sentences(found, closed=law is None)):
        options.say(sentence, style="" if k else "bold")
    if not asked.out:
        _print_commands(found)
    options.say(warm.heat_line(heated, found[0].state) + (" (first pose)" if len(found) > 1 else ""))
    if heat is not None and len(found) > 1:
        options.say(warm.alone_line(heat))
    if law is not None:
        summary = law.words(*(one.wanted for one in found))
        options.say(f"{summary}; the drives follow from the paper's sum, the remaining error from the full closure")
    if robot.model.is_drawing and heat is None and under is None:
        options.print_notes(["the drawing, cold, needs no compensation; give --model, --melt-degC or both"])
    beyond = (robot.outside_workspace(one.wanted) for one in found)
    outside = outside_notes(bool(shift_m.any()) or turn_rad > 0.0 for shift_m, turn_rad in beyond)
    options.print_notes([*(under.notes if under else ()), *warm.twice_lines(robot, heat), *outside])
    options.print_written(written)


def _sentences(found: Sequence[Compensation], *, closed: bool) -> Iterator[str]:
    """Yield sentences: the ladle's error before and after, and what cannot be cancelled; largest over all poses."""
    from pouring_robot.cli.poses.heat import unsettled_words

    word = "" if len(found) == 1 else "largest: "
    before = max(one.before.distance_m for one in found) / MM
    left = max(one.left.distance_m for one in found) / MM
    tilt = max(abs(one.left_tilt_rad) for one in found) / MRAD
    frame = found[0].frame
    yield (
        f"{word}'{frame}' is {before:.3f} mm off without compensation, {left:.3f} mm and {tilt:.3f} mrad of tilt "
        "with it"
    )
    roll, yaw = (max((one.uncontrolled_rad[k] for one in found), key=abs) / MRAD for k in (0, 1))
    lip = max(one.left_at_lip.distance_m for one in found) / MM
    yield (
        f"{word}the drives cannot correct roll {roll:+z.3f} mrad about x, yaw {yaw:+z.3f} mrad about z; the lip stays "
        f"{lip:.3f} mm off"
        + ("; --frame ladle_lip corrects the lip instead" if closed and frame != "ladle_lip" else "")
    )
    moved = max(one.state.unsettled_m for one in found)
    turns = max(one.state.turns for one in found)
    if turns > 1 and closed:
        yield (
            f"{word}temperatures were held in each Newton solve and recomputed at the ladle's new place {turns} "
            f"times; the last change moved it by {moved / MM:.1e} mm{unsettled_words(moved)}"
        )


def _print_commands(found: Sequence[Compensation]) -> None:
    from pouring_robot.robot.pouring.names import DRIVE_JOINTS

    rows = []
    for one in found:
        *lengths, tilt_drive = one.drives.values()
        *place, angle = one.command.to_mm_deg()
        wanted = [f"{value:z.1f}" for value in one.wanted.to_mm_deg()]
        drives = [*(f"{value / MM:.4f}" for value in lengths), f"{math.degrees(tilt_drive):z.6f}"]
        rows.append([*wanted, *drives, *(f"{value:z.3f}" for value in place), f"{angle:z.4f}"])
    drives = [f"{name} {unit}" for name, unit in zip(DRIVE_JOINTS, ("mm", "mm", "mm", "°"), strict=True)]
    options.say("wanted pose, drives to command, pose to command instead (for a controller that uses the drawing)")
    print_rows(["x", "y", "z", "tilt °", *drives, "x'", "y'", "z'", "tilt' °"], rows)


def _in_bulk(asked: Asked, robot: PouringRobot, heat: HeatSection | None) -> None:
    """Compensate a whole path, or make the C function that compensates."""
    from pouring_robot.compensation.path import compensate_path, make_controller
    from pouring_robot.thermal.expansion.warm_pouring_robot import HeatedRobot

    heated, files = HeatedRobot(robot, heat), dict[Path, bytes | str]()
    if (asked.poses is None) == (asked.header is None):
        raise BadInputError("--at-once takes a file of poses; --header takes none, as it is for the whole workspace")
    with progress.stage_bars() as show:
        if asked.poses is None:
            made = make_controller(heated, asked.frame, show)
            headline, table = made.headline, made.to_frame()
            files = options.wanted(asked.header, made.header)
        else:
            poses = robot.read_commands(asked.poses).values()
            wanted = [pose.values for pose in poses]
            found = compensate_path(heated, wanted, asked.frame, show=show)
            headline, table = found.headline, found.to_frame()
            if not found.answered.any():
                raise NoSolutionError(headline)
    written = options.write_all(files | options.wanted(asked.out, lambda: str(table.to_csv(index=False))))
    if asked.as_json:
        rows = table.astype(object).where(table.notna(), None).to_dict(orient="records")
        return options.print_figures({**robot.model.named, "headline": headline, "rows": rows}, written)
    options.say(headline, style="bold")
    options.say(f"heat: {heated.summary()}")
    if not written:
        print_rows(list(table.columns), [_cells(row) for row in table.to_numpy().tolist()])
    options.print_written(written)


def _tool(asked: Asked, robot: Robot, wanted: Mapping[int, Command], under: RobotUnderConditions | None) -> None:
    """Compensate a robot that is commanded by drive values."""
    from pouring_robot.compensation.pose import compensate_drives, drive_notes, drives_csv

    def bring(command: Command, standing: Robot) -> DriveCompensation:
        return compensate_drives(standing, standing.location_of(command), asked.frame)

    found = _each(asked, robot, wanted, under, bring)
    written = options.write_all(options.wanted(asked.out, lambda: drives_csv(found)))
    if asked.as_json:
        return options.print_figures({**robot.model.named, "poses": [one.figures() for one in found]}, written)
    options.say(found[0].headline if len(found) == 1 else _largest(found), style="bold")
    if not asked.out:
        head = [name.replace("_", " ") for name in found[0].row()]
        rows = [_cells(one.row().values()) for one in found]
        print_rows(head, rows, "drives to command; error without and with compensation")
    options.print_notes([*(under.notes if under else ()), *drive_notes(found)])
    if robot.model.is_drawing and under is None:
        options.print_notes(["the drawing needs no compensation; give --model"])
    options.print_written(written)


def _cells(row: Iterable[object]) -> list[str]:
    return [f"{value:z.4f}" if isinstance(value, float) else str(value) for value in row]


def _largest(found: Sequence[DriveCompensation]) -> str:
    """Return a tool's errors before and after compensation, in words; the largest over all poses."""
    before, after = [one.before for one in found], [one.left for one in found]
    was, remains = (
        (max(size.distance_m for size in sizes) / MM, max(size.angle_rad for size in sizes) / MRAD)
        for sizes in (before, after)
    )
    off = f"{was[0]:.3f} mm and {was[1]:.3f} mrad off without compensation"
    return f"largest: '{found[0].frame}' {off}, {remains[0]:.3g} mm and {remains[1]:.3g} mrad with it"


def _each(
    asked: Asked,
    robot: Robot,
    wanted: Mapping[int, Command],
    under: RobotUnderConditions | None,
    bring: Callable[[Command, Robot], Found],
) -> list[Found]:
    """Return the result for each command; an error names its line in the table."""
    from pouring_robot.cli.shared.locations import in_its_unit

    def compensated(command: Command, standing: Robot) -> Found:
        with in_its_unit(standing, command):
            return bring(command, standing)

    if under is None:
        return bundles.each(wanted, [robot] * len(wanted), asked.poses, "compensating", compensated)
    from pouring_robot.effects.robots_under_conditions import compensate_under

    lines = list(wanted)

    def at(k: int, standing: Robot) -> Found:
        with bundles.at_line(asked.poses, lines[k]):
            return compensated(wanted[lines[k]], standing)

    with progress.stage_bars() as show:
        found = compensate_under(under, list(wanted.values()), at, show)
    if asked.poses is None:
        bundles.say_idle(under, [list(one.drives.values()) for one in found])
    return found
