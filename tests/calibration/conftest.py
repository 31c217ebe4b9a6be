"""Calibrations that tests share; each takes about a second."""

import pytest

from pouring_robot.calibration.calibrate import CalibrationOptions, calibrate
from tests.campaign.simulated import measure


@pytest.fixture(scope="session")
def real(as_built):
    """A hundred full poses of a robot with machining errors, which move its ladle by millimetres."""
    return measure(as_built, count=100, seed=5)


@pytest.fixture(scope="session")
def found(repeated):
    """The calibration of a robot with machining errors; its noise is estimated from repeats."""
    return calibrate(repeated, None, CalibrationOptions(parameters=("centres", "moving_axes")))


@pytest.fixture(scope="session")
def unchanged(clean):
    """The calibration of a robot without errors."""
    return calibrate(clean.campaign, None, CalibrationOptions(parameters=("drives", "fixed_centres")))
