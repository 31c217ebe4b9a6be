"""Plans that many tests share."""

import pytest

from pouring_robot.sweeps import SweepConfig, SweepPlan
from tests.sweeps.sweep_files import content


@pytest.fixture(scope="package", autouse=True)
def _one_minute():
    """Reports say when they were made; here all are made in the same minute, so that they can be compared."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SOURCE_DATE_EPOCH", "0")
        yield


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
