"""Quantities with units: a column's heading ends in any unit of the right kind (``q1_mm``, ``leg1_K``)."""

import difflib
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pouring_robot.exceptions import TableError, some
from pouring_robot.io.tables import Table, read_table, separators
from pouring_robot.io.temperatures import ABSOLUTE_ZERO_DEGC, HOTTEST_DEGC, temperature_fault
from pouring_robot.io.units import LARGEST, LATEST, OF_UNIT, UNITS, QuantityKind, size_fault, to_inner

LIMITS: dict[QuantityKind, tuple[float, float]] = {
    "mass": (0.0, 1e4),
    "temperature": (ABSOLUTE_ZERO_DEGC, HOTTEST_DEGC),
    "time": (-LATEST, LATEST),
    "length": (-1e-3 * LARGEST, 1e-3 * LARGEST),  # as it may be given in mm
}
"""Limits of quantities of a kind, in internal units; no robot has values beyond. Others are at most LARGEST."""


def first_fault(values: NDArray[np.float64], kind: QuantityKind) -> tuple[int, str] | None:
    """Return index and fault of the first value, in the internal unit, beyond :data:`LIMITS`; None if there is none."""
    low, high = LIMITS.get(kind, (-LARGEST, LARGEST))
    wrong = np.flatnonzero((values < low) | (values > high))
    if not wrong.size:
        return None
    value = float(values.flat[wrong[0]])
    if kind == "temperature":
        return int(wrong[0]), temperature_fault(value)
    if kind != "mass":
        return int(wrong[0]), size_fault(value, high) or "it must be finite, or NaN where it is unknown"
    return int(wrong[0]), f"{value:g} kg is not a possible load ({low:g} to {high:g} kg); check value and unit"


@dataclass(frozen=True)
class Quantity:
    """One quantity of a table."""

    name: str  # without unit, such as ``q1`` or ``leg1``
    kind: QuantityKind  # what is measured; determines which units are accepted
    required: bool = False  # whether a table without it is refused
    unless: str = ""  # a quantity that may replace it
    part_of: str = ""  # the whole it belongs to, such as "a rotation vector": all its quantities are there, or none
    words: str = ""  # what it is, where its name may be misunderstood

    @property
    def headings(self) -> tuple[str, ...]:
        """Every heading that is understood; the first is the one in internal units."""
        return tuple(f"{self.name}_{unit}" for unit in UNITS[self.kind]) or (self.name,)

    @property
    def canonical(self) -> str:
        """The heading in internal units: ``q1_m``, ``q4_rad``, ``leg1_degC``, ``session``."""
        return self.headings[0]


@dataclass(frozen=True)
class QuantityTable:
    """A table whose headings were understood."""

    table: Table
    headings: dict[str, str]  # heading in the file of each quantity found, by quantity name
    unknown: tuple[str, ...]  # headings that are not quantities and were left out
    # values of each numeric quantity in internal units (m, rad, kg, s, °C), (n,), NaN where a cell is empty
    numbers: dict[str, NDArray[np.float64]] = field(repr=False)
    labels: dict[str, tuple[str, ...]] = field(repr=False)  # cells of each label, length n, "" where empty

    def __len__(self) -> int:
        return len(self.table)

    def fault(self, problem: str, row: int, name: str | None = None) -> TableError:
        """Return the error of a row (its index), or of the cell of a quantity in it."""
        return self.table.fault(problem, row, None if name is None else self.headings[name])


def read_quantities(
    path: Path | str | Table, quantities: Sequence[Quantity], example: str, error: type[TableError] = TableError
) -> QuantityTable:
    """Read a table, given or by its path, of quantities and possibly columns of the user's own, as :func:`read_table`.

    Empty cells are missing values, as are the ``nan`` that some programs write for them. A heading unlike every known
    one is a user's own column and left out; one that is nearly a known one is a typing error and refused.

    Raises:
        TableError: (or ``error``) the file cannot be read; a heading is misspelt, has no or a wrong unit, or a quantity
            occurs twice; a required quantity is missing; there is no row; or a cell is not a number, or an impossible
            load or temperature (:data:`LIMITS`).
    """
    table = path if isinstance(path, Table) else read_table(path, example, error, short_rows=False)
    places = _understand(table, quantities)
    if not len(table):
        raise error(table.path, "holds no row; each row is one static pose")
    known = {quantity.name: quantity for quantity in quantities}
    headings = {name: table.headings[index] for name, index in places.items()}
    numbers, labels = {}, {}
    for name, index in places.items():
        kind = known[name].kind
        if kind == "label":
            labels[name] = table.labels(index)
            continue
        numbers[name] = table.numbers(index, sparse=True)
        if UNITS[kind]:
            numbers[name] = to_inner(numbers[name], headings[name].removeprefix(f"{name}_"))
            if fault := first_fault(numbers[name], kind):
                row, said = fault
                raise table.fault(f"{said}, or leave the cell empty if it is missing", row, headings[name])
    unknown = tuple(heading for heading in table.headings if heading and heading not in headings.values())
    return QuantityTable(table, headings, unknown, numbers, labels)


def whole_column(table: Table, quantity: Quantity) -> tuple[str, NDArray[np.float64]]:
    """Return heading and values, (n,) in the internal unit, of the only column of a quantity, which has no empty cell.

    Raises TableError (or the table's own error) where it is missing or given in two units, or a cell is not a number.
    """
    found = [heading for heading in table.headings if heading in quantity.headings]
    if len(found) != 1:
        problem = "occurs twice" if found else "is missing"
        raise table.heading_fault(f"the column for {quantity.name} ({' or '.join(quantity.headings)}) {problem}")
    values = table.numbers(table.headings.index(found[0]))
    return found[0], to_inner(values, found[0].removeprefix(f"{quantity.name}_"))


def _understand(table: Table, quantities: Sequence[Quantity]) -> dict[str, int]:
    """Return the column of each quantity that the table has, by quantity name."""
    known = {heading: quantity for quantity in quantities for heading in quantity.headings}
    found: dict[str, int] = {}
    for index, heading in enumerate(table.headings):
        quantity = known.get(heading)
        if quantity is None:
            _refuse_slip(table, heading, quantities, known)
        elif quantity.name in found:
            earlier = table.headings[found[quantity.name]]
            again = "it occurs twice" if earlier == heading else f"'{quantity.name}' is already given as '{earlier}'"
            raise table.heading_fault(f"{again}; keep one of the two columns", heading)
        else:
            found[quantity.name] = index
    wholes = {quantity.part_of for quantity in quantities if quantity.part_of and quantity.name in found}
    for quantity in quantities:
        if quantity.required and not {quantity.name, quantity.unless} & found.keys():
            others = [h for h in table.headings if h not in known and h.rpartition("_")[2] in UNITS[quantity.kind]]
            renamed = f", or rename {some([repr(heading) for heading in others], 4)} if that is it" if others else ""
            instead = (heading for other in quantities if other.name == quantity.unless for heading in other.headings)
            remedy = f"the column is missing; add {' or '.join((*quantity.headings, *instead))}"
            raise table.heading_fault(remedy + (separators(table.headings) or renamed), quantity.canonical)
        if quantity.part_of in wholes and quantity.name not in found:
            *parts, last = [other.name for other in quantities if other.part_of == quantity.part_of]
            remedy = f"the column is missing; {quantity.part_of} needs {', '.join(parts)} and {last}"
            raise table.heading_fault(remedy, quantity.canonical)
    return found


def _refuse_slip(table: Table, heading: str, quantities: Sequence[Quantity], known: dict[str, Quantity]) -> None:
    stem, _, unit = heading.rpartition("_")
    for quantity in quantities:
        wanted, words = " or ".join(quantity.headings), quantity.words or "this quantity"
        if heading in (quantity.name, f"{quantity.name}_") and UNITS[quantity.kind]:
            raise table.heading_fault(f"the column names no unit; write {wanted}", heading)
        if stem == quantity.name and (unit in OF_UNIT or len(unit) <= 4):
            raise table.heading_fault(f"'{unit}' is not a unit of {words}; write {wanted}", heading)
    # Where a temperature such as leg1_degC was read, leg5_degC is not a typing error for it.
    read = {name for name, quantity in known.items() if quantity.kind == "temperature"} & {*table.headings}
    lower = {name.lower(): name for name in known if name not in read}
    near = difflib.get_close_matches(heading.lower(), lower, n=1, cutoff=0.85)
    if near:
        remedy = f"unknown column; did you mean '{lower[near[0]]}'?"
        raise table.heading_fault(remedy + separators(table.headings), heading)
