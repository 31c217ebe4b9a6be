"""Temperatures: °C in tables and models, K in heat balances; reference temperatures, and which are impossible."""

import math

from pouring_robot.exceptions import TemperatureError

ZERO_CELSIUS_K = 273.15
"""0 °C in K."""
ABSOLUTE_ZERO_DEGC = -ZERO_CELSIUS_K
REFERENCE_DEGC = 20.0
"""Temperature at which parts have the lengths of the drawing, unless a file states another."""
AMBIENT_DEGC = 20.0
"""Temperature of a hall, unless a file states another."""
HOTTEST_DEGC = 2500.0
"""Hotter than any melt that is poured; a temperature beyond it is a mistake of units."""
IRON_IN_KELVIN = 1538.0 + ZERO_CELSIUS_K
"""Iron's melting point in K. A melt that reads more is probably iron or steel in kelvin, not iron 273 °C above it."""
SURROUNDINGS_DEGC = -90.0, 150.0
"""Colder than any place on Earth (-89.2, Vostok 1983), and hotter than any hall: 20 K and 293 °C are outside."""


def reference_degC(stated: float | None) -> float:
    """Return the temperature at which the drawing holds, in °C: that stated in a file, or the default."""
    return REFERENCE_DEGC if stated is None else stated


def kelvin(value_degC: float, what: str = "temperature", *, surroundings: bool = False) -> float:
    """Return a temperature in K; raises TemperatureError of ``what`` where it is impossible (for surroundings)."""
    fault = temperature_fault(value_degC, surroundings=surroundings)
    if fault or not math.isfinite(value_degC):
        raise TemperatureError(what, value_degC, fault)
    return value_degC + ZERO_CELSIUS_K


def temperature_fault(value_degC: float, *, surroundings: bool = False) -> str:
    """Return why a value in °C is impossible for a part or a melt (or for surroundings), or "" if it is possible."""
    coldest, hottest = SURROUNDINGS_DEGC
    if surroundings and value_degC > hottest:
        beyond = f"is hotter than any surroundings (limit {hottest:g} degC)"
    elif value_degC > HOTTEST_DEGC:
        beyond = f"is hotter than any melt (limit {HOTTEST_DEGC:g} degC)"
    elif value_degC < ABSOLUTE_ZERO_DEGC:
        beyond = "lies below absolute zero"
    elif surroundings and value_degC < coldest:
        beyond = f"is colder than any surroundings (limit {coldest:g} degC)"
    else:
        return ""
    return f"{value_degC:g} degC {beyond}; check value and unit"
