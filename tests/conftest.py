"""Robots that many tests share; building one takes a few tenths of a second."""

import pytest

from pouring_robot.robot import PouringRobot, load_robot
from tests.checks import ACTUAL, crooked_model


@pytest.fixture(scope="session")
def drawing():
    """The robot without errors."""
    return PouringRobot()


@pytest.fixture(scope="session")
def as_built():
    """The shipped example of a robot with machining errors."""
    return load_robot(ACTUAL)


@pytest.fixture(scope="session")
def crooked():
    """A robot whose axes are off by 2 mrad."""
    return PouringRobot(crooked_model(seed=7, axis_mrad=2.0))


@pytest.fixture(scope="session")
def very_crooked():
    """A robot whose axes are off by 4 mrad: its loops stay open by milliradians."""
    return PouringRobot(crooked_model(seed=11, axis_mrad=4.0))
