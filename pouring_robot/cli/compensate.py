"""``pouring-robot compensate``: what to command so that the actual robot comes to where it should be."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar

import typer
from rich.table import Table

from pouring_robot.cli.shared import heat_options, options, progress
from pouring_robot.cli.shared.tables import plain_table
from pouring_robot.exceptions import BadInputError, NoSolutionError, PathPoseError, UnknownFrameError
from pouring_robot.mechanism.poses import MM, MRAD
from pouring_robot.robot.metrics import decimals
from pouring_robot.robot.pouring.poses import PlatformPose

if TYPE_CHECKING:
    from pouring_robot.compensation.result import Compensation
    from pouring_robot.robot.base import Command, Robot
    from pouring_robot.robot.heat_section import HeatSection
    from pouring_robot.robot.robot import PouringRobot

Found = TypeVar("Found")
PosesFile = Annotated[
    Path | None,
    typer.Argument(metavar="POSES.csv", help="Wanted poses, as 'path' reads them. Or --at-mm, or --drives."),
]
Frame = Annotated[
    str | None,
    typer.Option(
        "--frame",
        metavar="NAME",
        help="What shall be right: moving_platform (default), ladle or ladle_lip; of another robot its tool.",
    ),
]
OutFile = Annotated[Path | None, typer.Option("--out", metavar="FILE.csv", help="Write the commands, one row a pose.")]
HeaderFile = Annotated[
    Path | None,
    typer.Option("--header", metavar="FILE.h", help="Write a C function that compensates, in place of poses."),
]


def compensate(
    poses: PosesFile = None,
    at_mm: options.AtMm = None,
    tilt_deg: options.TiltDeg = None,
    rotation_deg: options.RotationDeg = None,
    drives: options.Drives = None,
    model: options.ModelFile = None,
    robot: options.RobotFile = None,
    layout: options.LayoutName = None,
    frame: Frame = None,
    out: OutFile = None,
    at_once: options.AtOnce = False,
    header: HeaderFile = None,
    as_json: options.AsJson = False,
    melt_degC: heat_options.MeltDegC = None,
    ambient_degC: heat_options.AmbientDegC = None,
    steady: heat_options.Steady = False,
    after_min: heat_options.AfterMin = None,
    cold: heat_options.Cold = False,
    thermal_model: heat_options.ThermalModelFile = None,
) -> None:
    """Find drive values that bring the actual ladle, or tool, to wanted poses, and say what they cannot cancel.

    With --after-min every pose is taken by itself: held so long from cold.
    """
    options.refuse_unwritable(out, header)
    one = (at_mm, tilt_deg, rotation_deg, drives)
    if poses is not None and any(option is not None for option in one):
        raise BadInputError("give a file of poses or one command by options, one of the two")
    present = options.robot_of(model, robot, layout, warm=True)
    from pouring_robot.robot.robot import PouringRobot

    _check_frame(present.nominal_solver.mechanism.loops.reported_frames, frame)
    heat = heat_options.heat_of(present, melt_degC, ambient_degC, steady, after_min, cold)
    if at_once or header:
        if not isinstance(present, PouringRobot):
            raise BadInputError("--at-once and --header know the pouring robot only")
        _in_bulk(present, heat, frame, poses, out, header, as_json)
        return
    wanted = {0: options.command_of(present, *one)} if poses is None else present.read_commands(poses)
    if isinstance(present, PouringRobot):
        law = heat_options.thermal_law(thermal_model, present, heat)
        _ladle(present, law.heat if law else heat, wanted, frame, poses, out, as_json, law)
    elif thermal_model is not None:
        raise BadInputError("--thermal-model is for the pouring robot")
    else:
        _tool(present, wanted, frame, poses, out, as_json)


def _ladle(
    robot: PouringRobot,
    heat: HeatSection | None,
    wanted: Mapping[int, Command],
    frame: str | None,
    poses: Path | None,
    out: Path | None,
    as_json: bool,
    law: heat_options.ThermalLaw | None,
) -> None:
    from pouring_robot.compensation.result import commands_csv
    from pouring_robot.compensation.search import compensate as compensated
    from pouring_robot.io.files import write_whole
    from pouring_robot.thermal.expansion.heated_robot import HeatedRobot

    heated = HeatedRobot(robot, heat)

    def bring(command: Command) -> Compensation:
        if not isinstance(command, PlatformPose):
            raise BadInputError("a ladle is brought to a pose: give --at-mm and --tilt-deg")
        return compensated(heated, command, frame, law.moves_m(command) if law else None)

    found = _each(wanted, bring, poses)
    written = [write_whole(out, commands_csv(found))] if out else []
    if as_json:
        rows = [one.figures() | {"heat": heat_options.heat_figures(heated, one.state)} for one in found]
        options.print_figures({**robot.name, "poses": rows}, written)
        return
    console = options.console()
    console.print(_commands_table(found))
    console.print(heat_options.heat_line(heated, found[0].state) + (" (first pose)" if len(found) > 1 else ""))
    if heat is not None and len(found) > 1:
        console.print(heat_options.alone_line(heat))
    for sentence in _lines(found, closed=law is None):
        console.print(sentence)
    if law is not None:
        console.print(f"{law.words}; the drives follow from the paper's sum, what is left is that of the full closure")
    if robot.model.is_drawing and heat is None:
        console.print("note: the drawing, cold, needs no compensation; give --model, --melt-degC or both")
    outside = [str(i) for i, one in enumerate(found, start=1) if _is_outside(robot, one.wanted)]
    if outside:
        console.print(f"note: outside the workspace box: pose {', '.join(outside)}")
    options.print_written(console, written)


def _in_bulk(
    robot: PouringRobot,
    heat: HeatSection | None,
    frame: str | None,
    poses: Path | None,
    out: Path | None,
    header: Path | None,
    as_json: bool,
) -> None:
    """Compensate a whole path, or make the function that does it elsewhere."""
    from pouring_robot.compensation.controller import make_controller
    from pouring_robot.compensation.path import compensate_path
    from pouring_robot.io.files import write_whole
    from pouring_robot.robot.pose_table import read_poses
    from pouring_robot.thermal.expansion.heated_robot import HeatedRobot

    heated, found, written = HeatedRobot(robot, heat), None, []
    if (poses is None) == (header is None):
        raise BadInputError("--at-once takes a file of poses; --header takes none, as it is for the whole workspace")
    with progress.stage_bars() as show:
        if header:
            made = make_controller(heated, frame, show)
            headline, table = made.headline, made.to_frame()
            written.append(write_whole(header, made.header()))
        else:
            wanted = [(*pose.position_m, pose.tilt_rad) for pose in read_poses(poses or Path())]
            found = compensate_path(heated, wanted, frame, show=show)
            headline, table = found.headline, found.to_frame()
    if found is not None and not (found.status == "closed").any():
        raise NoSolutionError(headline)
    if out:
        written.append(write_whole(out, table.to_csv(index=False)))
    if as_json:
        rows = table.astype(object).where(table.notna(), None).to_dict(orient="records")
        options.print_figures({**robot.name, "headline": headline, "rows": rows}, written)
        return
    console = options.console()
    if not written:
        console.print(table.to_string(index=False), markup=False, soft_wrap=True)
    console.print(headline, markup=False)
    options.print_written(console, written)


def _tool(
    robot: Robot, wanted: Mapping[int, Command], frame: str | None, poses: Path | None, out: Path | None, as_json: bool
) -> None:
    """Compensate a robot that is commanded by drive values."""
    from pouring_robot.compensation.drives import compensate_drives, drives_csv
    from pouring_robot.io.files import write_whole

    found = _each(wanted, lambda command: compensate_drives(robot, robot.location_of(command), frame), poses)
    written = [write_whole(out, drives_csv(found))] if out else []
    if as_json:
        options.print_figures({**robot.name, "poses": [one.figures() for one in found]}, written)
        return
    console = options.console()
    rows = [[f"{value:.4f}" for value in one.row().values()] for one in found]
    head = [name.replace("_", " ") for name in found[0].row()]
    console.print(plain_table(head, rows, (), title="drives to command; how far off without and with it"))
    if len(found) == 1:
        console.print(found[0].headline, markup=False)
    if robot.model.is_drawing:
        console.print("note: the drawing needs no compensation; give --model")
    options.print_written(console, written)


def _each(wanted: Mapping[int, Command], bring: Callable[[Command], Found], poses: Path | None) -> list[Found]:
    """Return what is found for each command; an error names the line of its table."""
    found: list[Found] = []
    with progress.stage_bars() as show:
        for line, command in wanted.items():
            try:
                found.append(bring(command))
            except NoSolutionError as error:
                if poses is None:
                    raise
                raise PathPoseError(poses, line, error) from error
            show("compensating", len(found), len(wanted))
    return found


def _check_frame(known: Sequence[str], frame: str | None) -> None:
    if frame is not None and frame not in known:
        raise UnknownFrameError(frame, known)


def _is_outside(robot: PouringRobot, pose: PlatformPose) -> bool:
    shift_m, turn_rad = robot.outside_workspace(pose)
    return bool(shift_m.any()) or turn_rad > 0.0


def _commands_table(found: Sequence[Compensation]) -> Table:
    """Return one row a pose: what is wanted, what to command, how far off it was and what is left."""
    rows = []
    for one in found:
        *legs, tilt_drive = one.drives.values()
        *place, angle = one.command.to_mm_deg()
        wanted = [f"{value:.1f}" for value in one.wanted.to_mm_deg()]
        drives = [*(f"{value / MM:.4f}" for value in legs), f"{tilt_drive:.7f}"]
        rows.append([*wanted, *drives, *(f"{value:.3f}" for value in place), f"{angle:.4f}"])
    head = ("x", "y", "z", "tilt °", "q1 mm", "q2 mm", "q3 mm", "q4 rad", "x'", "y'", "z'", "tilt' °")
    title = "wanted pose, drives to command, pose to command instead (to a controller that knows the drawing)"
    return plain_table(head, rows, (), title=title)


def _lines(found: Sequence[Compensation], *, closed: bool) -> Iterator[str]:
    """Say how far off the ladle was, what is left, and what cannot be cancelled; the largest over all poses."""
    word = "" if len(found) == 1 else "largest: "
    before = max(one.before.distance_m for one in found) / MM
    left = max(one.left.distance_m for one in found) / MM
    tilt = max(abs(one.left_tilt_rad) for one in found) / MRAD
    frame = found[0].frame
    yield f"{word}'{frame}' without compensation {before:.3f} mm off, with it {left:.1e} mm and {tilt:.1e} mrad of tilt"
    roll, yaw = (max((one.uncontrolled_rad[k] for one in found), key=abs) / MRAD for k in (0, 1))
    lip = max(one.left_at_lip.distance_m for one in found) / MM
    yield (
        f"{word}not in the drives' power: roll {decimals(roll, 3, sign=True)} mrad about x, yaw "
        f"{decimals(yaw, 3, sign=True)} mrad about z; the lip is left {lip:.3f} mm off"
        + ("" if frame == "ladle_lip" else "; --frame ladle_lip puts the lip right instead")
    )
    moved = max(one.state.unsettled_m for one in found) / MM
    turns = max(one.state.turns for one in found)
    if turns > 1 and closed:
        yield (
            f"{word}temperatures were held inside each Newton solve and taken anew where the ladle then was, {turns} "
            f"times; the last time moved it by {moved:.1e} mm{heat_options.unsettled_words(moved * MM)}"
        )
