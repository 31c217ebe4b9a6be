"""Measured data in, calibrated robot out: choice of parameters, fit, judgement on rows nobody has looked at, report."""

from __future__ import annotations

from pouring_robot.estimation.frames import FRAME_PARAMETERS, FRAMES
from pouring_robot.estimation.measurement import MeasurementModel, ModelledRows, Prediction, Unknowns
from pouring_robot.estimation.residuals import MeasuredPoses, WhitenedEquations, regressor, whiten

__all__ = [
    "FRAMES",
    "FRAME_PARAMETERS",
    "MeasuredPoses",
    "MeasurementModel",
    "ModelledRows",
    "Prediction",
    "Unknowns",
    "WhitenedEquations",
    "regressor",
    "whiten",
]
