"""Plans that many tests share."""

import pytest

from pouring_robot.sweeps import SweepConfig, SweepPlan
from tests.sweeps.sweep_files import content


@pytest.fixture(scope="session")
def plan():
    """Monte Carlo on the closed chain: lengths, angles, placements and drives together."""
    return SweepPlan(SweepConfig.model_validate(content()))


@pytest.fixture
def make_plan():
    """Return a plan of the base file with some keys changed."""

    def make(**changes):
        return SweepPlan(SweepConfig.model_validate(content(**changes)))

    return make
