"""The calibrated robot as a model file: what was found, on top of what the model already had."""

from __future__ import annotations

from typing import Any

import pinocchio as pin

from pouring_robot.estimation.measurement import MeasurementModel
from pouring_robot.exceptions import BadInputError, CalibrationError
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
            placements[joint] = JointPlacement.from_se3(placements.get(joint, JointPlacement()).to_se3() * found)
    offsets = dict(present.drive_offsets)
    mechanism = measurement.engine.structure.mechanism
    totals = measurement.drive_errors(values)
    for drive, total in zip(mechanism.loops.drives, totals.tolist(), strict=True):
        if total != 0.0:
            own = {"offset_mm": total / MM} if mechanism.unit_of(drive) == "m" else {"offset_mrad": total / MRAD}
            offsets[drive] = DriveOffset(**own)
    changed: dict[str, Any] = {"joint_placements": placements, "drive_offsets": offsets}
    amended = present.model_copy(update=changed)
    try:
        amended.check_errors()
    except BadInputError as problem:
        raise CalibrationError(
            f"the fit is not credible: {problem}", "check units and drive zeros of the campaign, or the model's layout"
        ) from problem
    return amended
