"""Shared by the tests of heat."""

import pytest

from pouring_robot.thermal.network.thermal_network import ThermalNetwork


@pytest.fixture(scope="session")
def network(drawing):
    """The thermal network of the drawing."""
    return ThermalNetwork(drawing)
