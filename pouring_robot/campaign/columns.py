"""The columns of a campaign (DESIGN §6): which there are, their units, and how a heading is understood.

A unit rides on the column's name (``q1_mm``, ``leg1_K``). Any unit of the right kind is accepted; inside, values
are in m, rad, kg and s, and temperatures in °C, as the names of the fields say.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from pouring_robot.mechanism.arrays import FloatArray

Kind = Literal["length", "angle", "mass", "temperature", "time", "sign", "label"]

ABSOLUTE_ZERO_DEGC = -273.15

# Unit of each kind: value in the unit, divided by the figure and shifted by the second, is the inner value.
# Dividing by 1000 is rounded correctly, multiplying by 0.001 is not: mm and m then give the same double.
UNITS: dict[Kind, dict[str, tuple[float, float]]] = {
    "length": {"m": (1.0, 0.0), "mm": (1000.0, 0.0)},
    "angle": {"rad": (1.0, 0.0), "mrad": (1000.0, 0.0), "deg": (180.0 / math.pi, 0.0)},
    "mass": {"kg": (1.0, 0.0)},
    "temperature": {"degC": (1.0, 0.0), "K": (1.0, ABSOLUTE_ZERO_DEGC)},
    "time": {"s": (1.0, 0.0)},
    "sign": {},
    "label": {},
}
_ALL_UNITS = {unit for units in UNITS.values() for unit in units}


@dataclass(frozen=True)
class Quantity:
    """One quantity of a table.

    Attributes:
        name: its name without unit, such as ``q1`` or ``leg1``.
        kind: what is measured; decides which units are accepted.
        required: whether a table without it is refused.
    """

    name: str
    kind: Kind
    required: bool = False

    @property
    def headings(self) -> tuple[str, ...]:
        """Every heading that is understood; the first is the one in inner units."""
        return tuple(f"{self.name}_{unit}" for unit in UNITS[self.kind]) or (self.name,)

    @property
    def canonical(self) -> str:
        """The heading in inner units: ``q1_m``, ``q4_rad``, ``leg1_degC``, ``session``."""
        return self.headings[0]


LENGTH_DRIVES = ("q1", "q2", "q3")
DRIVES = (*LENGTH_DRIVES, "q4")
APPROACHES = tuple(f"approach_{drive}" for drive in DRIVES)
LEGS = ("leg1", "leg2", "leg3", "leg4")
TEMPERATURES = ("melt", "ambient", *LEGS, "platform")
POSITION = ("x", "y", "z")
ROTATION = ("rx", "ry", "rz")

CONDITIONS = (
    Quantity("session", "label"),
    Quantity("time", "time"),
    *(Quantity(name, "sign") for name in APPROACHES),
    Quantity("payload", "mass"),
    Quantity("truss_travel", "length"),
    *(Quantity(name, "temperature") for name in TEMPERATURES),
)
"""What may be known of a pose besides drives and measurement; every one is optional."""

CAMPAIGN = (
    Quantity("sample", "label"),
    *CONDITIONS[:2],
    *(Quantity(name, "length", required=True) for name in LENGTH_DRIVES),
    Quantity("q4", "angle", required=True),
    *CONDITIONS[2:],
    *(Quantity(name, "length", required=True) for name in POSITION),
    *(Quantity(name, "angle") for name in ROTATION),
)
"""Columns of a campaign file."""

PLAN = (
    Quantity("sample", "label"),
    *(Quantity(name, "length", required=True) for name in POSITION),
    Quantity("tilt", "angle", required=True),
    *CONDITIONS,
)
"""Columns of a pose plan: the poses to command, and optional conditions."""


@dataclass(frozen=True)
class Column:
    """A column of a file that was understood.

    Attributes:
        quantity: what it holds.
        heading: its name in the file.
        index: its place in the file, from 0.
    """

    quantity: Quantity
    heading: str
    index: int

    @property
    def unit(self) -> str:
        """The unit of the file, empty for labels and signs."""
        return self.heading[len(self.quantity.name) + 1 :] if UNITS[self.quantity.kind] else ""

    def to_inner(self, values: FloatArray) -> FloatArray:
        """Return values of the file in inner units (m, rad, kg, s, °C); same shape."""
        if not self.unit:
            return values
        divisor, shift = UNITS[self.quantity.kind][self.unit]
        return values / divisor + shift if shift else values / divisor


class HeadingError(ValueError):
    """A heading is wrong; ``column`` is the heading or the quantity it concerns."""

    def __init__(self, column: str, problem: str) -> None:
        """Keep the heading and the problem."""
        self.column, self.problem = column, problem
        super().__init__(f"{column}: {problem}")


def understand(headings: Sequence[str], quantities: Sequence[Quantity]) -> tuple[dict[str, Column], tuple[str, ...]]:
    """Return the column of each quantity that is there, by quantity name, and the headings nobody knows.

    A heading that is unlike every known one is a user's own column: it is returned as unknown. One that is nearly a
    known one is a slip of the pen and refused.

    Raises:
        HeadingError: a heading is misspelt, has no or a wrong unit, stands twice, or a quantity stands twice in
            different units; or a required quantity is missing.
    """
    known = {heading: quantity for quantity in quantities for heading in quantity.headings}
    found: dict[str, Column] = {}
    unknown = []
    for index, heading in enumerate(headings):
        quantity = known.get(heading)
        if quantity is None:
            _refuse_slip(heading, quantities, known)
            unknown.append(heading)
            continue
        if quantity.name in found:
            earlier = found[quantity.name].heading
            again = "it stands twice" if earlier == heading else f"'{quantity.name}' stands already as '{earlier}'"
            raise HeadingError(heading, f"{again}; keep one of the two columns")
        found[quantity.name] = Column(quantity, heading, index)
    for quantity in quantities:
        if quantity.required and quantity.name not in found:
            raise HeadingError(quantity.canonical, f"the column is missing; add {' or '.join(quantity.headings)}")
    present = [name for name in ROTATION if name in found]
    if 0 < len(present) < len(ROTATION):
        missing = next(name for name in ROTATION if name not in found)
        raise HeadingError(f"{missing}_rad", "the column is missing; a rotation vector needs rx, ry and rz")
    return found, tuple(unknown)


def _refuse_slip(heading: str, quantities: Sequence[Quantity], known: dict[str, Quantity]) -> None:
    stem, _, unit = heading.rpartition("_")
    for quantity in quantities:
        wanted = " or ".join(quantity.headings)
        if heading.strip() in (quantity.name, f"{quantity.name}_") and UNITS[quantity.kind]:
            raise HeadingError(heading, f"the column names no unit; write {wanted}")
        if stem == quantity.name and (unit in _ALL_UNITS or len(unit) <= 4):
            raise HeadingError(heading, f"'{unit}' is no unit of this quantity; write {wanted}")
    lower = {name.lower(): name for name in known}
    near = difflib.get_close_matches(heading.lower(), lower, n=1, cutoff=0.85)
    if near:
        raise HeadingError(heading, f"unknown column; did you mean '{lower[near[0]]}'?")


def read_only(values: FloatArray) -> FloatArray:
    """Return an array that nobody can change, in its own memory; dtype float64."""
    array = np.array(values, dtype=np.float64)
    array.flags.writeable = False
    return array
