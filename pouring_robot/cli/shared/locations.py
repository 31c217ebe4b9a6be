"""Output on a ladle's location on the terminal, and in pictures."""

import contextlib
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pouring_robot.cli.shared.bundles import Drawing
from pouring_robot.cli.shared.options import print_indented, print_notes, say
from pouring_robot.cli.shared.tables import print_table
from pouring_robot.exceptions import BadInputError, NoSolutionError, UnreachablePoseError
from pouring_robot.io.units import MM, MRAD
from pouring_robot.mechanism.conditioning import AxisWeakness, Dexterity
from pouring_robot.robot.inverse import Target
from pouring_robot.robot.location import LadleLocation, Location, drive_words
from pouring_robot.robot.location_figures import rotation_deg
from pouring_robot.robot.pouring.platform_pose import PlatformPose
from pouring_robot.robot.pouring_robot import PouringRobot
from pouring_robot.robot.robot import Command, Robot


def _cells(values: Iterable[float], *, sign: bool = False) -> list[str]:
    return [f"{value:{'+' if sign else ''}z.3f}" for value in values]


def print_location(location: Location) -> None:
    """Print the commanded drives, nominal and actual pose of the end body and its tools, such as ladle and lip.

    Attitudes are rotation vectors, those of poses in degrees, as in input, those of errors in mrad.
    """
    say(location.headline, style="bold")
    say(f"drives: {'  '.join(drive_words(location.nominal.mechanism, location.drives))}")
    rows: list[list[str]] = []
    for frame in location.loops.reported_frames:
        nominal, actual = location.poses(frame)
        translation, rotation = location.difference(frame).to_mm_mrad()
        rows += [
            [frame, "nominal", *_cells(nominal.translation / MM), *_cells(rotation_deg(nominal))],
            ["", "actual", *_cells(actual.translation / MM), *_cells(rotation_deg(actual))],
            ["", "error", *_cells(translation, sign=True), *_cells(rotation, sign=True)],
        ]
    head = ("frame", "", "x", "y", "z", "rx", "ry", "rz")
    seen = "the fixed platform" if isinstance(location, LadleLocation) else location.loops.base_frame
    errors = range(2, len(rows), 3)
    print_table(head, rows, (0, 1), title=f"in {seen}'s frame: mm, deg; errors: mm, mrad", bold=errors)


@contextlib.contextmanager
def in_its_unit(robot: Robot, command: Command) -> Iterator[None]:
    """Add to an error whether the commanded position would be in reach in another unit, or else the workspace."""
    try:
        yield
    except NoSolutionError as error:
        hints = [*_in_another_unit(robot, command), *_workspace(robot, command, error)]
        error.args = ("; ".join([str(error), *hints[:1]]),)
        raise


def _in_another_unit(robot: Robot, command: Command) -> Iterator[str]:
    posed: Any = command if isinstance(command, PlatformPose | Target) else None
    for factor in (1e3, 1e-3) if posed else ():
        other = replace(posed, position_m=factor * np.asarray(posed.position_m))
        with contextlib.suppress(NoSolutionError):
            with contextlib.suppress(BadInputError):  # a position in reach that leaves other freedoms undetermined
                robot.drives_of(other)
            yield f"with x, y, z {factor:g} times as large it is in reach: mm or m?"


def _workspace(robot: Robot, command: Command, error: NoSolutionError) -> Iterator[str]:
    """Yield the workspace of the pouring robot if the pose is outside it and out of reach."""
    if (
        isinstance(error, UnreachablePoseError)
        and isinstance(robot, PouringRobot)
        and isinstance(command, PlatformPose)
    ):
        outside_m, outside_rad = robot.outside_workspace(command)
        if outside_m.any() or outside_rad:
            axes = (f"{a.heading} {a.shown(a.lower):g} to {a.shown(a.upper):g}" for a in robot.command_axes)
            yield f"the workspace is {', '.join(axes)}"


def location_notes(robot: Robot, drawing: Drawing, model_file: Path | None) -> list[str]:
    """Return notes on model and picture that a user should know before reading the figures, one line each."""
    notes = []
    if robot.model.is_drawing and not robot.model.conditional:
        reason = "the model file holds no errors" if model_file else "no model file was given"
        notes.append(f"{reason}, so the robot as built is the drawing{'' if model_file else '; see --model'}")
    notes += [unseen_note(joint) for joint in robot.unseen_displacements]
    return [*notes, *robot.picture_notes] if drawing.html or drawing.png else notes


def unseen_note(joint: str) -> str:
    """Return a line about a displaced joint that carries the whole robot, or is not in the measured chain."""
    return f"displacing '{joint}' moves nothing between base and end body, so poses do not show it"


def outside_notes(poses_outside: Iterable[bool]) -> list[str]:
    """Return a line about the poses of a list that are outside the workspace box, if there are any."""
    outside = [str(i) for i, one in enumerate(poses_outside, start=1) if one]
    return [f"outside the workspace box: pose {', '.join(outside)}"] if outside else []


def print_closure_note(
    location: Location, dexterity: Dexterity, weakness: AxisWeakness | None, notes: Sequence[str]
) -> None:
    """Print results of the closure besides the pose: fit of the parts, rank, load, reach, sideways weakness."""
    nominal, actual = location.nominal, location.actual
    if location.loops.loops:
        say(
            f"closure: rank {nominal.rank} nominal, {actual.rank} as built; left open {actual.gap_m * 1e6:.3f} µm and "
            f"{actual.gap_rad / MRAD:.3f} mrad after {actual.iterations} iterations"
        )
        if actual.rank > nominal.rank:
            print_indented(
                f"the chains over-constrain the platform: {actual.rank - nominal.rank} equations more than rigid "
                "parts can satisfy, so the open gap loads the joints"
            )
        if location.loops.redundant_drives:  # joint stiffness would convert it to loads that no line carries
            print_indented("the open gap is the disagreement of redundant drives, not a load")
        else:
            say(
                f"internal load: up to {actual.internal_force_n:.1f} N and {actual.internal_torque_nm:.1f} Nm in a "
                "chain (by the assumed joint stiffness)"
            )
    if weakness is not None:
        say(
            f"sideways: {weakness.m_per_rad:.1f} mm at the lip per mrad of axis tilt, at the worst axis "
            f"({weakness.parameter})"
        )
    limits = "reach: no joint has limits"
    if location.reach:
        limiting = location.reach[0]
        limits = f"reach: '{limiting.joint}' limits, {limiting.relative_margin:.0%} of its range left"
    say(
        f"{limits}; condition {dexterity.condition:.1f}, {dexterity.distance:.3f} from a {dexterity.singularity} "
        "singularity"
    )
    print_notes(notes)
    if isinstance(location, LadleLocation) and not location.in_workspace:
        outside = zip("xyz", location.outside_workspace_m, strict=True)
        beyond = [f"{axis} by {value / MM:.1f} mm" for axis, value in outside if value]
        if location.outside_workspace_rad:
            beyond.append(f"tilt by {math.degrees(location.outside_workspace_rad):.2f} deg")
        say(f"note: the pose is outside the workspace box: {', '.join(beyond)}")
