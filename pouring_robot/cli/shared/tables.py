"""Tables of ladle locations for the terminal."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Sequence

from rich.console import Console
from rich.table import Table

from pouring_robot.mechanism.jacobians import AxisWeakness, Dexterity
from pouring_robot.mechanism.poses import MM, MRAD
from pouring_robot.robot.metrics import decimals
from pouring_robot.robot.robot import LadleLocation, PouringRobot


def _row(values: Iterable[float], digits: int, *, sign: bool = False) -> list[str]:
    return [decimals(value, digits, sign=sign) for value in values]


def plain_table(
    head: Sequence[str],
    rows: Iterable[Sequence[str]],
    left: Collection[int],
    *,
    title: str | None = None,
    wrap: bool = False,
) -> Table:
    """Return a table of plain texts without a frame.

    Args:
        head: headings.
        rows: one text a column.
        left: columns set to the left; the others, figures, to the right.
        title: above it.
        wrap: whether long cells may go on in the next line.
    """
    table = Table(title=title, title_justify="left", box=None, pad_edge=False)
    for k, name in enumerate(head):
        table.add_column(name, justify="left" if k in left else "right", no_wrap=not wrap)
    for row in rows:
        table.add_row(*row)
    return table


def location_table(location: LadleLocation) -> Table:
    """Return nominal and actual pose of the platform, the ladle and its lip."""
    table = Table(title="in the fixed platform's frame: mm, mrad", title_justify="left", box=None, pad_edge=False)
    table.add_column("frame")
    table.add_column("")
    for name in ("x", "y", "z", "rx", "ry", "rz"):
        table.add_column(name, justify="right")
    for frame in location.loops.reported_frames:
        nominal, actual = location.poses(frame)
        translation, rotation = location.difference(frame).to_mm_mrad()
        table.add_row(frame, "nominal", *_row(nominal.translation / MM, 3))
        table.add_row("", "actual", *_row(actual.translation / MM, 3))
        table.add_row("", "error", *_row(translation, 3, sign=True), *_row(rotation, 3, sign=True), style="bold")
    return table


def path_table(locations: Sequence[LadleLocation]) -> str:
    """Return one line a pose, with a heading: the command, and the error at the lip.

    Text and no rich table: that would take twice as long to set as thousands of poses take to close.
    """
    rows: list[tuple[str, ...]] = [
        ("x", "y", "z", "tilt °", "Δx", "Δy", "Δz", "|Δ|", "rx", "ry", "rz", "open µm", "open mrad")
    ]
    for location in locations:
        x, y, z, tilt = location.commanded.to_mm_deg()
        difference = location.difference()
        translation, rotation = difference.to_mm_mrad()
        rows.append(
            (
                *_row((x, y, z, tilt), 1),
                *_row(translation, 3, sign=True),
                f"{difference.distance_m / MM:.3f}",
                *_row(rotation, 3, sign=True),
                f"{location.actual.gap_m * 1e6:.3f}",
                f"{location.actual.gap_rad / MRAD:.3f}",
            )
        )
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = ["  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)) for row in rows]
    return "\n".join(["error of the pouring lip: mm, mrad", *lines])


def drives_line(location: LadleLocation) -> str:
    """Return the commanded drives, in mm and degrees, as in the JSON output."""
    mechanism = location.nominal.mechanism
    shown = (
        f"{name} {value / MM:.4f} mm" if mechanism.unit_of(name) == "m" else f"{name} {math.degrees(value):.5f} deg"
        for name, value in location.drives.items()
    )
    return f"drives: {'  '.join(shown)}"


def model_notes(robot: PouringRobot, *, model_file: bool) -> list[str]:
    """Return what a user should know of the model before reading its figures, one line each."""
    notes = []
    if robot.model.is_drawing:
        reason = "the model file holds no errors" if model_file else "no model file was given"
        notes.append(f"{reason}, so the robot as built is the drawing{'' if model_file else '; see --model'}")
    return notes + [unseen_note(joint) for joint in robot.unseen_displacements]


def unseen_note(joint: str) -> str:
    """Return a line about a displaced joint that carries the fixed platform."""
    return f"displacing '{joint}' moves the fixed platform as a whole, so poses seen from it do not show it"


def print_closure_note(
    console: Console, location: LadleLocation, dexterity: Dexterity, weakness: AxisWeakness, notes: Sequence[str]
) -> None:
    """Say what the closure found besides the pose: fit of the parts, rank, load, reach, sideways weakness."""
    nominal, actual = location.nominal, location.actual
    console.print(
        f"closure: rank {nominal.rank} nominal, {actual.rank} as built; left open {actual.gap_m * 1e6:.3f} µm and "
        f"{actual.gap_rad / MRAD:.3f} mrad after {actual.iterations} iterations"
    )
    if actual.rank > nominal.rank:
        console.print(
            f"  the chains over-constrain the platform: {actual.rank - nominal.rank} equations more than rigid parts "
            "could meet, so the joints are forced by what is left open"
        )
    console.print(
        f"internal load: up to {actual.internal_force_n:.1f} N and {actual.internal_torque_nm:.1f} Nm in a chain "
        "(by the assumed joint stiffness)"
    )
    console.print(
        f"sideways: {weakness.m_per_rad:.1f} mm at the lip per mrad of axis tilt, at the worst axis "
        f"({weakness.parameter})"
    )
    limiting = location.reach[0]
    console.print(
        f"reach: '{limiting.joint}' limits, {limiting.relative_margin:.0%} of its range left; condition "
        f"{dexterity.condition:.1f}, {dexterity.distance:.3f} from a {dexterity.singularity} singularity"
    )
    for note in notes:
        console.print(f"note: {note}", markup=False)
    if not location.in_workspace:
        beyond = [
            f"{axis} by {value / MM:.1f} mm"
            for axis, value in zip("xyz", location.outside_workspace_m, strict=True)
            if value
        ]
        if location.outside_workspace_rad:
            beyond.append(f"tilt by {math.degrees(location.outside_workspace_rad):.2f} deg")
        console.print(f"note: the pose is outside the workspace box: {', '.join(beyond)}")
