"""Where to start: the two outer frames of the present robot."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from pouring_robot.campaign.nominal import PoseStack
from pouring_robot.estimation.frames import FrameFit, fit_frames
from pouring_robot.estimation.measurement import ModelledRows, Unknowns
from pouring_robot.estimation.residuals import MeasuredPoses
from pouring_robot.mechanism.arrays import FloatArray


def first_frames(rows: ModelledRows, measured: MeasuredPoses) -> tuple[Unknowns, FrameFit]:
    """Fit both frames to the present robot, robustly; all parameters are zero.

    Args:
        rows: what was commanded.
        measured: what was seen of the same rows.

    Raises:
        FrameFitError: too few rows have a pose and a complete position.
    """
    parameters = len(rows.model.parameters)
    none = Unknowns.zero(pin.SE3.Identity(), pin.SE3.Identity(), parameters)
    closure = rows.predict(none).closure
    rotation: FloatArray | None = measured.rotation if np.isfinite(measured.rotation).any() else None
    scale = measured.sigma_position_m / measured.sigma_rotation_rad
    fit = fit_frames(PoseStack(closure.position, closure.rotation), measured.position_m, rotation, scale)
    return Unknowns.zero(fit.pose_tracker_to_fixed_platform, fit.pose_platform_to_target, parameters), fit
