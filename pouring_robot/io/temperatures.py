"""Temperatures: °C in tables and models, K in heat balances; that of the drawing, and what is no temperature."""

import math

from pouring_robot.exceptions import TemperatureError

ZERO_CELSIUS_K = 273.15
"""0 °C in K."""
ABSOLUTE_ZERO_DEGC = -ZERO_CELSIUS_K
REFERENCE_DEGC = 20.0
"""At which parts have the lengths of the drawing, where no file says otherwise."""
AMBIENT_DEGC = 20.0
"""Of a hall, where no file says otherwise."""
HOTTEST_DEGC = 2500.0
"""Hotter than any melt that is poured; beyond it a temperature is a mistake of units."""
IRON_IN_KELVIN = 1538.0 + ZERO_CELSIUS_K
"""Iron's melting point in K. A melt that reads more is rather iron or steel in kelvin than iron 273 °C above it."""
SURROUNDINGS_DEGC = -90.0, 150.0
"""Colder than any place on Earth (-89.2, Vostok 1983), and hotter than any hall: 20 K and 293 °C lie beyond."""


def reference_degC(stated: float | None) -> float:
    """Return at which temperature the drawing holds, in °C, where a file states one or none."""
    return REFERENCE_DEGC if stated is None else stated


def kelvin(value_degC: float, what: str = "temperature", *, surroundings: bool = False) -> float:
    """Return in K what is in °C; raises TemperatureError of ``what`` where that is no temperature (of surroundings)."""
    fault = temperature_fault(value_degC, surroundings=surroundings)
    if fault or not math.isfinite(value_degC):
        raise TemperatureError(what, value_degC, fault)
    return value_degC + ZERO_CELSIUS_K


def temperature_fault(value_degC: float, *, surroundings: bool = False) -> str:
    """Return why a value in °C is no temperature of a part or a melt (or of surroundings), or "" if it is one."""
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
