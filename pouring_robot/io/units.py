"""Units of input and output: those in which tables are read and values shown; internally all is in SI and °C.

Errors are shown in mm and mrad, joint values in mm and degrees. Headings are read in
:mod:`pouring_robot.io.quantity_columns`; keys of YAML files have their unit in their name or next to the value.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Literal

from pouring_robot.io.temperatures import ABSOLUTE_ZERO_DEGC

if TYPE_CHECKING:  # the command line uses units before it loads NumPy
    import numpy as np
    from numpy.typing import NDArray

MM = 1e-3
MRAD = 1e-3
DEG = math.radians(1.0)
_OF_ERRORS = {
    "m": ("mm", MM),
    "rad": ("mrad", MRAD),
    "m/N": ("µm/kN", 1e-9),
    "rad/Nm": ("mrad/kNm", 1e-6),
    "1/K": ("1e-6/K", 1e-6),
}

QuantityKind = Literal["length", "angle", "force", "moment", "mass", "temperature", "time", "sign", "label"]

UNITS: dict[QuantityKind, dict[str, tuple[float, float]]] = {
    "length": {"m": (1.0, 0.0), "mm": (1e3, 0.0), "um": (1e6, 0.0), "in": (1.0 / 0.0254, 0.0)},
    "angle": {"rad": (1.0, 0.0), "mrad": (1e3, 0.0), "deg": (180.0 / math.pi, 0.0)},
    "force": {"N": (1.0, 0.0), "kN": (1e-3, 0.0)},
    "moment": {"Nm": (1.0, 0.0)},
    "mass": {"kg": (1.0, 0.0)},
    "temperature": {"degC": (1.0, 0.0), "K": (1.0, ABSOLUTE_ZERO_DEGC)},
    "time": {"s": (1.0, 0.0), "min": (1.0 / 60.0, 0.0), "h": (1.0 / 3600.0, 0.0)},
    "sign": {},
    "label": {},
}
"""Units of each kind, the internal one first: (value / first figure) + second figure is in the internal unit.

Division by 1000 is rounded correctly, multiplication by 0.001 is not: so mm and m give the same double.
"""
OF_UNIT = {unit: figures for units in UNITS.values() for unit, figures in units.items()}
LARGEST = 1e9
"""No quantity comes near this, in any of its units; a number that does is broken."""
LATEST = 1e3 * LARGEST
"""The same for times, which some count from 1970 on, in s."""


def size_fault(value: float, largest: float = LARGEST) -> str:
    """Return why a finite number is too large for any quantity, or "" if it is not."""
    fits = abs(value) <= largest or not math.isfinite(value)
    return "" if fits else f"{value:g} is larger than any quantity (limit {largest:g}); check the unit"


def to_inner(values: NDArray[np.float64], unit: str) -> NDArray[np.float64]:
    """Return values in the internal unit of their kind (m, rad, kg, s, °C); same shape."""
    divisor, shift = OF_UNIT[unit]
    return values / divisor + shift if shift else values / divisor


def shown_in(unit: str) -> tuple[str, float]:
    """Return the unit in which errors and their causes are shown, and its size in their own unit (SI)."""
    return _OF_ERRORS[unit]


def joint_shown(value: float, unit: str) -> tuple[float, str]:
    """Return a joint value, in m or rad, as it is shown, and the unit shown."""
    shown, si = joint_shown_in(unit)
    return value / si, shown


def joint_shown_in(unit: str) -> tuple[str, float]:
    """Return the unit in which joint values in m or rad are shown, and its size in SI."""
    return ("mm", MM) if unit == "m" else ("deg", DEG)
