"""What is printed of temperatures, at a pose and over a shift."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pouring_robot.cli.shared.tables import plain_table
from pouring_robot.mechanism.poses import MM, MRAD
from pouring_robot.robot.metrics import decimals
from pouring_robot.robot.pouring.names import LEGS

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from pouring_robot.thermal.report import PoseHeat, ShiftHeat


def print_pose_heat(console: Console, found: PoseHeat) -> None:
    """Print temperatures and growth of the parts, what heat moves, the balance, and whether bending matters."""
    # A title of the table would be broken at the table's width.
    console.print("temperatures: degC; across: K from side to side, settled; growth: mm", style="italic")
    rows = []
    for row in found.parts:
        across = "" if row.across_K is None else f"{row.across_K:.1f}"
        growth = "" if row.growth_m is None else f"{row.growth_m / MM:.3f}"
        rows.append((row.part.replace("_", " "), f"{row.mean_degC:.1f}", f"{row.hottest_degC:.1f}", across, growth))
    console.print(plain_table(("part", "mean", "hottest", "across", "grows by"), rows))
    moves = []
    for frame, difference in found.moved.items():
        shift, turn = ([decimals(v, 3, sign=True) for v in part] for part in difference.to_mm_mrad())
        moves.append((frame, *shift, f"{difference.distance_m / MM:.3f}", *turn))
    head = ("frame", "x", "y", "z", "|xyz|", "rx", "ry", "rz")
    console.print(plain_table(head, moves, title="moved by heat alone: mm, mrad"))
    balance = found.field.balance
    gains = balance.melt_radiation_W + balance.melt_conduction_W
    losses = balance.ambient_film_W + balance.ambient_radiation_W
    console.print(
        f"heat: {gains / 1e3:.2f} kW from the melt ({balance.melt_radiation_W / 1e3:.2f} by radiation, "
        f"{balance.melt_conduction_W / 1e3:.2f} through the lining), {losses / 1e3:.2f} kW to the surroundings "
        f"({balance.ambient_film_W / 1e3:.2f} by air), {abs(balance.stored_W) / 1e3:.2f} kW stored"
    )
    bending = found.bending
    matters = "MATTERS" if found.bending_matters else "does not matter"
    at_lip = abs(bending.tilt_error_rad) * found.lever_m / MM
    console.print(
        f"bending: legs bow up to {float(bending.bow_m.max()) / MM:.2f} mm; not in the figures above: leg 4 would tilt "
        f"the ladle by {bending.tilt_error_rad / MRAD:+.2f} mrad, {at_lip:.2f} mm at the lip: {matters} against a "
        f"tenth of the required {found.accuracy_m / MM:g} mm"
    )


def shift_table(found: ShiftHeat) -> Table:
    """Return temperatures and what heat moves, a row a time."""
    end, lip = found.moved
    shown = {
        "min": "time_min",
        "melt": "melt_degC",
        **{f"leg {i}": f"{leg}_degC" for i, leg in enumerate(LEGS, start=1)},
        "platform": "platform_degC",
        "fixed pl.": "fixed_platform_degC",
        "shell": "ladle_shell_degC",
        "x": f"{end}_moved_x_mm",
        "y": f"{end}_moved_y_mm",
        "z": f"{end}_moved_z_mm",
        "|o|": f"{end}_moved_mm",
        "|lip|": f"{lip}_moved_mm",
    }
    digits = {column: 3 if column.endswith("_mm") else 1 for column in shown.values()} | {"melt_degC": 0}
    rows = [
        [decimals(row[name], digits[name]) for name in shown.values()] for row in found.to_frame().to_dict("records")
    ]
    title = "means: degC; the platform's origin o and the lip, moved by heat alone: mm"
    return plain_table(list(shown), rows, (), title=title)
