"""What is printed of a compensation."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from pouring_robot.cli.poses.heat import unsettled_words
from pouring_robot.cli.shared.tables import few_rows
from pouring_robot.mechanism.poses import MM, MRAD
from pouring_robot.robot.location_figures import decimals
from pouring_robot.robot.pouring.names import DRIVE_JOINTS

if TYPE_CHECKING:
    from pouring_robot.compensation.pose import Compensation


def commands_table(found: Sequence[Compensation]) -> str:
    """Return one row a pose: what is wanted, what to command, how far off it was and what is left."""
    rows = []
    for one in found:
        *legs, tilt_drive = one.drives.values()
        *place, angle = one.command.to_mm_deg()
        wanted = [f"{value:.1f}" for value in one.wanted.to_mm_deg()]
        drives = [*(f"{value / MM:.4f}" for value in legs), f"{math.degrees(tilt_drive):.6f}"]
        rows.append([*wanted, *drives, *(f"{value:.3f}" for value in place), f"{angle:.4f}"])
    head = (
        "x",
        "y",
        "z",
        "tilt °",
        *(f"{name} {unit}" for name, unit in zip(DRIVE_JOINTS, ("mm", "mm", "mm", "°"), strict=True)),
        "x'",
        "y'",
        "z'",
        "tilt' °",
    )
    title = "wanted pose, drives to command, pose to command instead (to a controller that knows the drawing)"
    return f"{title}\n{few_rows(head, rows, '--out FILE.csv writes all')}"


def compensation_lines(found: Sequence[Compensation], *, closed: bool) -> Iterator[str]:
    """Say how far off the ladle was, what is left, and what cannot be cancelled; the largest over all poses."""
    word = "" if len(found) == 1 else "largest: "
    before = max(one.before.distance_m for one in found) / MM
    left = max(one.left.distance_m for one in found) / MM
    tilt = max(abs(one.left_tilt_rad) for one in found) / MRAD
    frame = found[0].frame
    yield f"{word}'{frame}' without compensation {before:.3f} mm off, with it {left:.3f} mm and {tilt:.3f} mrad of tilt"
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
            f"times; the last time moved it by {moved:.1e} mm{unsettled_words(moved * MM)}"
        )
