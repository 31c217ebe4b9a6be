"""Compensations as CSV and as figures for JSON; units ride on the names."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from pouring_robot.compensation.compensate import Compensation
from pouring_robot.mechanism.poses import MM, MRAD
from pouring_robot.robot.metrics import difference_figures, joint_figures
from pouring_robot.robot.pouring.layout import Layout
from pouring_robot.robot.pouring.poses import PlatformPose

DRIVE_COLUMNS = ("q1_mm", "q2_mm", "q3_mm", "q4_rad")
"""Commanded drives, named as in campaign files: three legs, and the tilt drive."""


def commands_csv(found: Sequence[Compensation]) -> str:
    """Return one row a pose: the pose wanted, the drives to command, the pose to command, and what is left.

    Drives have 12 decimals (q in mm) so that a reader gets back what was solved.
    """
    stream = io.StringIO()
    pose = ("x_mm", "y_mm", "z_mm", "tilt_deg")
    left = ("before_mm", "left_mm", "left_tilt_mrad", "roll_mrad", "yaw_mrad", "left_at_lip_mm")
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(
        [*(f"wanted_{name}" for name in pose), *DRIVE_COLUMNS, *(f"command_{name}" for name in pose), *left]
    )
    for one in found:
        roll, yaw = one.uncontrolled_rad
        legs = [value / MM for value in list(one.drives.values())[:3]]
        figures = [one.before.distance_m / MM, one.left.distance_m / MM, one.left_tilt_rad / MRAD]
        figures += [roll / MRAD, yaw / MRAD, one.left_at_lip.distance_m / MM]
        writer.writerow(
            [
                *(f"{value:.12g}" for value in one.wanted.to_mm_deg()),
                *(f"{value:.12f}" for value in [*legs, list(one.drives.values())[3]]),
                *(f"{value:.12f}" for value in one.command.to_mm_deg()),
                *(f"{value:.6g}" for value in figures),
            ]
        )
    return stream.getvalue()


def compensation_figures(one: Compensation) -> dict[str, Any]:
    """Return everything known of one compensation, ready for JSON."""
    roll, yaw = one.uncontrolled_rad
    pose = ("x_mm", "y_mm", "z_mm", "tilt_deg")
    result = one.state.result
    return {
        "wanted": dict(zip(pose, one.wanted.to_mm_deg(), strict=True)),
        "frame": one.frame,
        "drives": joint_figures(result.mechanism, one.drives),
        "command": dict(zip(pose, one.command.to_mm_deg(), strict=True)),
        "before": difference_figures(one.before),
        "left": difference_figures(one.left) | {"tilt_mrad": one.left_tilt_rad / MRAD},
        "left_at_lip": difference_figures(one.left_at_lip),
        "uncontrolled_mrad": {"roll": roll / MRAD, "yaw": yaw / MRAD},
        "left_open": {"mm": result.gap_m / MM, "mrad": result.gap_rad / MRAD},
        "newton_steps": one.steps,
        "temperatures_taken": one.state.turns,
        "unsettled_mm": one.state.unsettled_m / MM,
    }


def is_outside(layout: Layout, pose: PlatformPose) -> bool:
    """Return whether a pose lies outside the workspace box by more than round-off."""
    position = np.array(pose.position_m)
    beyond = max(
        float(np.max(layout.position_lower_m - position)),
        float(np.max(position - layout.position_upper_m)),
        layout.tilt_lower_rad - pose.tilt_rad,
        pose.tilt_rad - layout.tilt_upper_rad,
    )
    return math.isfinite(beyond) and beyond > 1e-9
