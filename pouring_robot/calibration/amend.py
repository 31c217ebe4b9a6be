"""The calibrated robot as a model file: what was found, on top of what the model already had."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pydantic

from pouring_robot.estimation.measurement import MeasurementModel
from pouring_robot.exceptions import CalibrationError
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.poses import MM, MRAD
from pouring_robot.robot.model import DriveOffset, JointPlacement, RobotModel


def amended_model(present: RobotModel, measurement: MeasurementModel, values: FloatArray) -> RobotModel:
    """Return the present robot with parameter values added: placements composed exactly, drive offsets summed.

    Args:
        present: the model the parameters act on.
        measurement: gives their meaning.
        values: shape (P,), in m and rad.

    Raises:
        CalibrationError: the result is too large to be an error of a robot.
    """
    placements = dict(present.joint_placements)
    joints = measurement.engine.structure.site_joints
    for joint, error in zip(joints, measurement.placement_errors(values), strict=True):
        if error.any():
            found = pin.SE3(pin.exp3(error[3:]), error[:3])
            placements[joint] = _placement(joint, placements.get(joint, JointPlacement()).to_se3() * found)
    offsets = dict(present.drive_offsets)
    mechanism = measurement.engine.structure.mechanism
    totals = measurement.drive_errors(values)
    for drive, total in zip(mechanism.loops.drives, totals.tolist(), strict=True):
        if total != 0.0:
            offsets[drive] = _offset(drive, total, mechanism.unit_of(drive))
    changed: dict[str, Any] = {"joint_placements": placements, "drive_offsets": offsets}
    return present.model_copy(update=changed)


def _placement(joint: str, displacement: pin.SE3) -> JointPlacement:
    try:
        return JointPlacement.from_se3(displacement)
    except pydantic.ValidationError as problem:
        size = float(np.linalg.norm(displacement.translation)) / MM
        turn = float(np.linalg.norm(pin.log3(displacement.rotation))) / MRAD
        raise _too_large(f"joint '{joint}' would be displaced by {size:.1f} mm and {turn:.1f} mrad") from problem


def _offset(drive: str, value: float, unit: str) -> DriveOffset:
    try:
        return DriveOffset(offset_mm=value / MM) if unit == "m" else DriveOffset(offset_mrad=value / MRAD)
    except pydantic.ValidationError as problem:
        shown = f"{value / MM:.1f} mm" if unit == "m" else f"{value / MRAD:.1f} mrad"
        raise _too_large(f"drive '{drive}' would be off by {shown}") from problem


def _too_large(what: str) -> CalibrationError:
    return CalibrationError(
        f"the fit is not credible: {what}", "check units and drive zeros of the campaign, or the layout of the model"
    )
