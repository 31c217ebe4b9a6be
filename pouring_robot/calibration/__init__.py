"""Measured data in, calibrated robot out: the measurement model, identification, and the report (DESIGN §1, §6)."""

from __future__ import annotations

from pouring_robot.calibration.measurement import (
    FRAME_PARAMETERS,
    FRAMES,
    CalibrationParameter,
    MeasurementModel,
    ModelledRows,
    Prediction,
    Unknowns,
)
from pouring_robot.calibration.residuals import MeasuredPoses, WhitenedEquations, regressor, whiten

__all__ = [
    "FRAMES",
    "FRAME_PARAMETERS",
    "CalibrationParameter",
    "MeasuredPoses",
    "MeasurementModel",
    "ModelledRows",
    "Prediction",
    "Unknowns",
    "WhitenedEquations",
    "regressor",
    "whiten",
]
