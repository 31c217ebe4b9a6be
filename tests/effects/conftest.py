"""Shared by the tests of the effects."""

import numpy as np
import pytest

from tests.effects.bench import Bench


@pytest.fixture(scope="session")
def bench():
    """Seventy rows in three sessions on a faultless machine of the rig."""
    return Bench()


@pytest.fixture
def rng():
    """Return a seeded generator."""
    return np.random.default_rng(20240917)
