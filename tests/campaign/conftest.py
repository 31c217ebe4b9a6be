"""Campaigns that many tests share."""

import pytest

from tests.campaign.simulated import measure


@pytest.fixture(scope="session")
def clean(drawing):
    """Sixty full poses of the robot of the drawing."""
    return measure(drawing)


@pytest.fixture(scope="session")
def real(as_built):
    """Eighty full poses of a robot with machining errors, which move its ladle by millimetres."""
    return measure(as_built, count=80, seed=5)


@pytest.fixture(scope="session")
def positions(drawing):
    """Sixty positions without rotations."""
    return measure(drawing, seed=2, sigma_rotation_rad=None)
