"""Ladle locations as plain figures in mm, mrad and degrees: what the command line prints and writes as JSON."""

from __future__ import annotations

import math
from typing import Any

from pouring_robot.jacobians import Dexterity
from pouring_robot.mechanism import ClosedChainMechanism
from pouring_robot.poses import MM, MRAD, PoseDifference
from pouring_robot.robot import REPORTED_FRAMES, LadleLocation

Figures = dict[str, Any]


def joint_figures(mechanism: ClosedChainMechanism, values: dict[str, float]) -> Figures:
    """Return joint values with their unit in the name: mm for prismatic, degrees for revolute joints."""
    figures = {}
    for joint, value in values.items():
        if mechanism.unit_of(joint) == "m":
            figures[f"{joint}_mm"] = value / MM
        else:
            figures[f"{joint}_deg"] = math.degrees(value)
    return figures


def difference_figures(difference: PoseDifference) -> Figures:
    """Return a pose difference in mm and mrad."""
    translation, rotation = difference.to_mm_mrad()
    return {
        "translation_mm": translation.tolist(),
        "rotation_mrad": rotation.tolist(),
        "distance_mm": difference.distance_m / MM,
        "angle_mrad": difference.angle_rad / MRAD,
    }


def _frame_figures(location: LadleLocation, frame: str) -> Figures:
    nominal, actual = location.poses(frame)
    return {
        "nominal_mm": (nominal.translation / MM).tolist(),
        "actual_mm": (actual.translation / MM).tolist(),
        "error": difference_figures(location.difference(frame)),
    }


def location_figures(location: LadleLocation, dexterity: Dexterity) -> Figures:
    """Return everything known of one location, ready for JSON; units are in the names."""
    x, y, z, tilt = location.commanded.to_mm_deg()
    limiting = location.reach[0]
    scale, unit = (MM, "mm") if limiting.unit == "m" else (math.radians(1.0), "deg")
    return {
        "commanded": {"x_mm": x, "y_mm": y, "z_mm": z, "tilt_deg": tilt},
        "in_workspace": location.in_workspace,
        "outside_workspace_mm": (location.outside_workspace_m / MM).tolist(),
        "outside_workspace_deg": math.degrees(location.outside_workspace_rad),
        "drives": joint_figures(location.nominal.mechanism, location.drives),
        "frames": {frame: _frame_figures(location, frame) for frame in REPORTED_FRAMES},
        "closure": {
            "left_open_mm": location.actual.gap_m / MM,
            "left_open_mrad": location.actual.gap_rad / MRAD,
            "rank_nominal": location.nominal.rank,
            "rank_actual": location.actual.rank,
            "freedoms_nominal": location.nominal.freedoms,
            "iterations": location.actual.iterations,
        },
        "limiting_joint": {
            "joint": limiting.joint,
            f"value_{unit}": limiting.value / scale,
            f"margin_{unit}": limiting.margin / scale,
        },
        "dexterity": {
            "condition": dexterity.condition,
            "nearer_singularity": dexterity.singularity,
            "distance": dexterity.distance,
            "characteristic_length_mm": dexterity.length_m / MM,
        },
    }
