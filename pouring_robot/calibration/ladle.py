"""How well the calibrated model knows the ladle: prediction intervals over the workspace and at measured poses."""

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from pouring_robot.estimation.frames.outer import FRAMES
from pouring_robot.estimation.measurement import MeasurementModel, ModelledRows, Unknowns
from pouring_robot.mechanism.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class LadleUncertainty:
    """Standard deviation of the predicted pouring lip, as the tracker would see it, noise apart.

    The lip is taken to move rigidly with the target: a turn of the platform that looks like a turn of the target on it
    does not count, as long as rotations were measured. Where only positions were, nobody has seen that turn, and it
    counts as far as tolerances leave it open.
    """

    position_m: FloatArray  # commanded origin of the end body, shape (n, 3), in m
    tilt_rad: FloatArray | None  # commanded turn about y, shape (n,), in rad; None where it turns otherwise, too
    std_m: FloatArray  # of x, y and z in tracker axes, shape (n, 3), in m
    std_rad: FloatArray  # of the rotation, shape (n, 3), in rad

    @property
    def half_width_m(self) -> FloatArray:
        """Half the 95 % interval of the worst coordinate of each pose, shape (n,), in m."""
        return np.asarray(1.96 * self.std_m.max(axis=1))


def workspace_rows(model: MeasurementModel) -> ModelledRows:
    """Return commands spread over the workspace that the robot can take."""
    return model.at(*model.model.definition.workspace(model.drawing))


def ladle_uncertainty(
    rows: ModelledRows, unknowns: Unknowns, covariance: FloatArray, T_end_tool: pin.SE3, *, turned: bool
) -> LadleUncertainty:
    """Carry the covariance of the unknowns, in m and rad, at their calibrated values to the lip.

    ``turned`` says whether rotations were measured, so that the attitude of the target is known.
    """
    seen = rows.linearise(unknowns)
    closed = seen.closed
    jacobian, rotation = seen.derivatives[closed], seen.closure.rotation[closed]
    turning = jacobian[:, 3:].copy()
    if not turned:
        turning[:, :, 6:FRAMES] = 0.0  # nothing is known of the target's attitude; the lip is held by the platform's
    arm = T_end_tool.translation - unknowns.frames.T_end_target.translation
    lever = np.einsum("ij,njk,k->ni", unknowns.frames.T_tracker_base.rotation, rotation, arm)
    lip = jacobian[:, :3] + np.cross(turning.transpose(0, 2, 1), lever[:, None, :]).transpose(0, 2, 1)
    turn = rows.start.rotation[closed]
    tilt = np.arctan2(turn[:, 0, 2], turn[:, 2, 2]) if np.allclose(turn[:, 1, 1], 1.0) else None
    return LadleUncertainty(rows.start.position[closed], tilt, _std(lip, covariance), _std(turning, covariance))


def _std(jacobian: FloatArray, covariance: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt(np.maximum(((jacobian @ covariance) * jacobian).sum(axis=2), 0.0)))
