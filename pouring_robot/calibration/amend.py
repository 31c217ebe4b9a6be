"""The calibrated robot as a model file: what was found, on top of what the model already had."""

import pinocchio as pin

from pouring_robot.estimation.measurement import MeasurementModel
from pouring_robot.exceptions import BadInputError, CalibrationError
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.robot.model import RobotModel


def amended_model(present: RobotModel, measurement: MeasurementModel, values: FloatArray) -> RobotModel:
    """Return the present robot with parameter values (P,), in m and rad, added.

    Placements are composed exactly, drive offsets summed.

    Raises:
        CalibrationError: the result is too large to be an error of a robot.
    """
    structure = measurement.engine.structure
    errors = zip(structure.site_joints, measurement.placement_errors(values), strict=True)
    placements = {joint: pin.SE3(pin.exp3(error[3:]), error[:3]) for joint, error in errors if error.any()}
    added = (measurement.drive_errors(values) - measurement.drive_errors(None)).tolist()
    drives = {name: own for name, own in zip(structure.mechanism.loops.drives, added, strict=True) if own}
    amended = present.displaced(placements, drives)
    try:
        amended.check_errors()
    except BadInputError as problem:
        raise CalibrationError(
            f"the fit is not credible: {problem}", "check units and drive zeros of the campaign, or the model's layout"
        ) from problem
    return amended
