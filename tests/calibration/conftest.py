"""Campaigns and calibrations that tests share; a calibration takes about a second."""

import dataclasses

import numpy as np
import pytest

from pouring_robot.calibration.calibrate import CalibrationOptions, calibrate
from pouring_robot.campaign import MeasurementOptions, PosePlan, random_plan, simulate_campaign
from tests.campaign.simulated import SIGMA_M, SIGMA_RAD, measure


@pytest.fixture(scope="session")
def clean(drawing):
    """Sixty full poses of the robot of the drawing."""
    return measure(drawing)


@pytest.fixture(scope="session")
def positions(drawing):
    """Sixty positions without rotations."""
    return measure(drawing, seed=2, sigma_rotation_rad=None)


@pytest.fixture(scope="session")
def real(as_built):
    """A hundred full poses of a robot with machining errors, which move its ladle by millimetres."""
    return measure(as_built, count=100, seed=5)


@pytest.fixture(scope="session")
def repeated(as_built):
    """Sixty poses, of which four were measured six times in a row, and no noise stated."""
    plan = random_plan(as_built, 60, 9)
    order = [k for k in range(60) for _ in range(6 if k % 15 == 0 else 1)]
    conditions = {name: values[order] for name, values in plan.conditions.items()}
    conditions |= {name: np.ones(len(order)) for name in conditions if name.startswith("approach")}
    again = PosePlan(
        tuple(plan.poses[k] for k in order),
        plan.drives[order],
        tuple(str(k) for k in range(len(order))),
        ("1",) * len(order),
        conditions,
    )
    campaign = simulate_campaign(as_built, again, MeasurementOptions(SIGMA_M, SIGMA_RAD, seed=9)).campaign
    blank = campaign.metadata.model_copy(update={"sigma_position_m": None, "sigma_rotation_rad": None})
    return dataclasses.replace(campaign, metadata=blank)


@pytest.fixture(scope="session")
def found(repeated):
    """The calibration of a robot with machining errors; its noise comes from repeats."""
    return calibrate(repeated, None, CalibrationOptions(parameters=("centres", "moving_axes")))


@pytest.fixture(scope="session")
def unchanged(clean):
    """The calibration of a robot that is as drawn."""
    return calibrate(clean.campaign, None, CalibrationOptions(parameters=("drives", "fixed_centres")))
