"""Diagnoses that several test files use, each made once."""

import functools

import pytest

from pouring_robot.diagnosis.diagnose import DiagnosisOptions, diagnose
from tests.diagnosis.hidden import HOT, NOTHING, campaign, stepped


@pytest.fixture(scope="session")
def diagnosed(tmp_path_factory):
    """Return the diagnosis of a hidden campaign: what is hidden, and whether small errors are in the background."""

    @functools.cache
    def of(wanted, background):
        return diagnose(campaign(tmp_path_factory.mktemp("hidden"), wanted, background=background))

    return lambda wanted, background=False: of(wanted, background)  # the name makes no second diagnosis


@pytest.fixture(scope="session")
def hot(diagnosed):
    return diagnosed(HOT)


@pytest.fixture(scope="session")
def nothing(diagnosed):
    return diagnosed(NOTHING)


@pytest.fixture(scope="session")
def excluded(tmp_path_factory):
    """A step that only a drift could explain, which may not be named."""
    data = stepped(tmp_path_factory.mktemp("stepped"))
    return diagnose(data, options=DiagnosisOptions(exclude=("base_drift",)))
