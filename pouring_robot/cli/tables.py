"""Tables of ladle locations for the terminal."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from rich.console import Console
from rich.table import Table

from pouring_robot.poses import MM, MRAD
from pouring_robot.robot import REPORTED_FRAMES, LadleLocation, PouringRobot


def _row(values: Iterable[float], digits: int, *, sign: bool = False) -> list[str]:
    return [f"{value + 0.0:{'+' if sign else ''}.{digits}f}" for value in values]


def location_table(location: LadleLocation) -> Table:
    """Return nominal and actual pose of the platform, the ladle and its lip."""
    table = Table(title="in the fixed platform's frame: mm, mrad", title_justify="left", box=None, pad_edge=False)
    table.add_column("frame")
    table.add_column("")
    for name in ("x", "y", "z", "rx", "ry", "rz"):
        table.add_column(name, justify="right")
    for frame in REPORTED_FRAMES:
        nominal, actual = location.poses(frame)
        translation, rotation = location.difference(frame).to_mm_mrad()
        table.add_row(frame, "nominal", *_row(nominal.translation / MM, 3))
        table.add_row("", "actual", *_row(actual.translation / MM, 3))
        table.add_row("", "error", *_row(translation, 3, sign=True), *_row(rotation, 3, sign=True), style="bold")
    return table


def path_table(locations: Sequence[LadleLocation]) -> Table:
    """Return one row a pose: the command, and the error at the lip."""
    table = Table(title="error of the pouring lip: mm, mrad", title_justify="left", box=None, pad_edge=False)
    for name in ("x", "y", "z", "tilt °", "Δx", "Δy", "Δz", "|Δ|", "rx", "ry", "rz", "open µm", "open mrad"):
        table.add_column(name, justify="right")
    for location in locations:
        x, y, z, tilt = location.commanded.to_mm_deg()
        difference = location.difference("ladle_lip")
        translation, rotation = difference.to_mm_mrad()
        table.add_row(
            *_row((x, y, z, tilt), 1),
            *_row(translation, 3, sign=True),
            f"{difference.distance_m / MM:.3f}",
            *_row(rotation, 3, sign=True),
            f"{location.actual.gap_m * 1e6:.3f}",
            f"{location.actual.gap_rad / MRAD:.3f}",
        )
    return table


def print_closure_note(console: Console, robot: PouringRobot, location: LadleLocation) -> None:
    """Say what the closure found besides the pose: fit of the parts, rank, reach, sideways weakness."""
    nominal, actual = location.nominal, location.actual
    dexterity = robot.dexterity(location)
    console.print(
        f"closure: rank {nominal.rank} nominal, {actual.rank} as built; left open {actual.gap_m * 1e6:.3f} µm and "
        f"{actual.gap_rad / MRAD:.3f} mrad after {actual.iterations} iterations"
    )
    if actual.rank > nominal.rank:
        console.print(
            f"  the chains over-constrain the platform: {actual.rank - nominal.rank} equations more than rigid parts "
            "could meet, so the joints are forced by what is left open"
        )
    if not robot.model.joint_placements:
        console.print("note: no model file was given, so the robot as built is the drawing; see --model")
    limiting = location.reach[0]
    console.print(
        f"reach: '{limiting.joint}' limits, {limiting.relative_margin:.0%} of its range left; condition "
        f"{dexterity.condition:.1f}, {dexterity.distance:.3f} from a {dexterity.singularity} singularity"
    )
    if not location.in_workspace:
        beyond = [
            f"{axis} by {value / MM:.1f} mm"
            for axis, value in zip("xyz", location.outside_workspace_m, strict=True)
            if value
        ]
        if location.outside_workspace_rad:
            beyond.append(f"tilt by {location.outside_workspace_rad:.4f} rad")
        console.print(f"note: the pose is outside the workspace box: {', '.join(beyond)}")
