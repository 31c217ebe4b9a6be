"""Shared by the tests of the effects."""

import pytest

from tests.effects.bench import Bench


@pytest.fixture(scope="session")
def bench():
    """Seventy rows in three sessions on a faultless machine of the rig."""
    return Bench()
