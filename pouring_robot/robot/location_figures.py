"""Ladle locations as plain numbers in mm, mrad and degrees: what the command line prints and writes as JSON."""

import math
from typing import Any

import numpy as np
import pinocchio as pin

from pouring_robot.io.units import MM, MRAD, joint_shown, joint_shown_in
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.conditioning import AxisWeakness, Dexterity
from pouring_robot.mechanism.poses import PoseDifference
from pouring_robot.robot.location import LadleLocation, Location

Figures = dict[str, Any]


def joint_figures(mechanism: ClosedChainMechanism, values: dict[str, float]) -> Figures:
    """Return joint values with their unit in the name: mm for prismatic, degrees for revolute joints."""
    shown = {joint: joint_shown(value, mechanism.unit_of(joint)) for joint, value in values.items()}
    return {f"{joint}_{unit}": figure for joint, (figure, unit) in shown.items()}


def difference_figures(difference: PoseDifference) -> Figures:
    """Return a pose difference in mm and mrad."""
    translation, rotation = difference.to_mm_mrad()
    return {
        "translation_mm": translation.tolist(),
        "rotation_mrad": rotation.tolist(),
        "distance_mm": difference.distance_m / MM,
        "angle_mrad": difference.angle_rad / MRAD,
    }


def rotation_deg(pose: pin.SE3) -> list[float]:
    """Return the attitude of a pose as a rotation vector, in degrees."""
    vector: list[float] = np.degrees(pin.log3(pose.rotation)).tolist()
    return vector


def _frame_figures(location: Location, frame: str) -> Figures:
    nominal, actual = location.poses(frame)
    return {
        "nominal_mm": (nominal.translation / MM).tolist(),
        "nominal_rotation_deg": rotation_deg(nominal),
        "actual_mm": (actual.translation / MM).tolist(),
        "actual_rotation_deg": rotation_deg(actual),
        "error": difference_figures(location.difference(frame)),
    }


def location_figures(location: Location, dexterity: Dexterity, weakness: AxisWeakness | None = None) -> Figures:
    """Return all figures of one location, ready for JSON; units are in the names.

    The internal load is the force on the joints that arises because the chains over-constrain the platform. Each loop's
    force and torque act from its second frame on the chain of the first one, in the axes of the second frame. They
    follow from the stiffness in the loops file, which is assumed.
    """
    actual, figures = location.actual, Figures()
    if isinstance(location, LadleLocation):  # this robot is commanded by poses
        figures |= {
            "commanded": location.commanded.figures(),
            "in_workspace": location.in_workspace,
            "outside_workspace_mm": (location.outside_workspace_m / MM).tolist(),
            "outside_workspace_deg": math.degrees(location.outside_workspace_rad),
        }
    wrenches = zip(actual.mechanism.loops.names, actual.internal_wrench, strict=True)
    figures |= {
        "drives": joint_figures(location.nominal.mechanism, location.drives),
        "frames": {frame: _frame_figures(location, frame) for frame in location.loops.reported_frames},
        "closure": {
            "left_open_mm": actual.gap_m / MM,
            "left_open_mrad": actual.gap_rad / MRAD,
            "rank_nominal": location.nominal.rank,
            "rank_actual": actual.rank,
            "freedoms_nominal": location.nominal.freedoms,
            "iterations": actual.iterations,
            "internal_load": {
                "force_N": actual.internal_force_n,
                "torque_Nm": actual.internal_torque_nm,
                "loops": {n: {"force_N": w[:3].tolist(), "torque_Nm": w[3:].tolist()} for n, w in wrenches},
            },
        },
    }
    if location.reach:  # the joint that is nearest to its limits
        limiting, (unit, scale) = location.reach[0], joint_shown_in(location.reach[0].unit)
        value, margin = limiting.value / scale, limiting.margin / scale
        figures["limiting_joint"] = {"joint": limiting.joint, f"value_{unit}": value, f"margin_{unit}": margin}
    figures["dexterity"] = {
        "condition": dexterity.condition,
        "nearer_singularity": dexterity.singularity,
        "distance": dexterity.distance,
        "characteristic_length_mm": dexterity.length_m / MM,
    }
    if weakness is not None:  # how far the most harmful axis tilt moves the pouring lip along y
        figures["sideways"] = {"mm_per_mrad": weakness.m_per_rad, "axis_tilt": weakness.parameter}
    return figures
