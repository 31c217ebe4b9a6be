"""What to command, what it leads to, and the table of commands; units ride on the names."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from pouring_robot.io.tables import csv_text
from pouring_robot.mechanism.poses import MM, MRAD, PoseDifference
from pouring_robot.report.result import Result
from pouring_robot.robot.location_figures import difference_figures, joint_figures
from pouring_robot.robot.pouring.names import DRIVE_COLUMNS
from pouring_robot.robot.pouring.poses import PlatformPose
from pouring_robot.thermal.expansion.heated_robot import WarmState

if TYPE_CHECKING:
    import pandas as pd

_POSE = ("x_mm", "y_mm", "z_mm", "tilt_deg")
# Drives and commands have 12 decimals so that a reader gets back what was solved.
_FORMATS = {"wanted": "{:.12g}", "command": "{:.12f}"} | dict.fromkeys(DRIVE_COLUMNS, "{:.12f}")


@dataclass(frozen=True, eq=False, repr=False)
class Compensation(Result):
    """What to command, and what it leads to. Differences are actual minus wanted, in the fixed platform."""

    wanted: PlatformPose
    frame: str  # whose position is brought to where that pose has it
    drives: dict[str, float]  # drive values to command, in m and rad
    # the pose of the drawing with these drive values: what to ask a controller for that knows the drawing
    command: PlatformPose
    before: PoseDifference  # of the frame, if the wanted pose itself were commanded
    left: PoseDifference  # and with ``drives``
    left_at_lip: PoseDifference  # of the lip, with ``drives``: what the two rotations do there
    left_tilt_rad: float  # what is left of the tilt
    steps: int  # Newton steps taken in all
    state: WarmState  # temperatures, warm robot and closure with ``drives``

    @property
    def uncontrolled_rad(self) -> tuple[float, float]:
        """The two rotations that cannot be commanded: about x and about z, in rad."""
        return float(self.left.rotation_rad[0]), float(self.left.rotation_rad[2])

    @property
    def headline(self) -> str:
        """How far off the frame was and is, on one line."""
        return (
            f"'{self.frame}' {self.before.distance_m / MM:.3f} mm off without compensation, "
            f"{self.left.distance_m / MM:.1e} mm with it; the lip is left {self.left_at_lip.distance_m / MM:.3f} mm off"
        )

    def row(self) -> dict[str, float]:
        """Return the pose wanted, the drives to command, the pose to command, and what is left."""
        *legs, tilt_drive = self.drives.values()
        roll, yaw = self.uncontrolled_rad
        *lengths, angle = DRIVE_COLUMNS
        return {
            **{f"wanted_{name}": value for name, value in zip(_POSE, self.wanted.to_mm_deg(), strict=True)},
            **{f"{name}_mm": value / MM for name, value in zip(lengths, legs, strict=True)},
            f"{angle}_rad": tilt_drive,
            **{f"command_{name}": value for name, value in zip(_POSE, self.command.to_mm_deg(), strict=True)},
            "before_mm": self.before.distance_m / MM,
            "left_mm": self.left.distance_m / MM,
            "left_tilt_mrad": self.left_tilt_rad / MRAD,
            "roll_mrad": roll / MRAD,
            "yaw_mrad": yaw / MRAD,
            "left_at_lip_mm": self.left_at_lip.distance_m / MM,
        }

    def to_frame(self) -> pd.DataFrame:
        """Return its :meth:`row`."""
        import pandas as pd

        return pd.DataFrame([self.row()])

    def figures(self) -> dict[str, Any]:
        """Return everything known, ready for JSON."""
        roll, yaw = self.uncontrolled_rad
        result = self.state.result
        return {
            "wanted": dict(zip(_POSE, self.wanted.to_mm_deg(), strict=True)),
            "frame": self.frame,
            "drives": joint_figures(result.mechanism, self.drives),
            "command": dict(zip(_POSE, self.command.to_mm_deg(), strict=True)),
            "before": difference_figures(self.before),
            "left": difference_figures(self.left) | {"tilt_mrad": self.left_tilt_rad / MRAD},
            "left_at_lip": difference_figures(self.left_at_lip),
            "uncontrolled_mrad": {"roll": roll / MRAD, "yaw": yaw / MRAD},
            "left_open": {"mm": result.gap_m / MM, "mrad": result.gap_rad / MRAD},
            "newton_steps": self.steps,
            "temperatures_taken": self.state.turns,
            "unsettled_mm": self.state.unsettled_m / MM,
        }


def commands_csv(found: Iterable[Compensation]) -> str:
    """Return one row a pose as CSV."""
    rows = [one.row() for one in found]
    formats = [_FORMATS.get(name.split("_")[0], "{:.6g}") for name in rows[0]]
    return csv_text(rows[0], ([f.format(v) for f, v in zip(formats, row.values(), strict=True)] for row in rows))
