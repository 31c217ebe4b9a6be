"""A table of error sets: one row per melt temperature, one column per pose, from a CSV with units in its headings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from pouring_robot.exceptions import BadInputError, TableError
from pouring_robot.io.tables import Table, read_table
from pouring_robot.io.temperatures import ZERO_CELSIUS_K
from pouring_robot.io.units import UNITS, to_inner
from pouring_robot.mechanism.arrays import BoolArray, FloatArray, read_only

if TYPE_CHECKING:
    import pandas as pd


KINDS = {unit: kind for kind in ("length", "angle") for unit in UNITS[kind]}
"""Kind of each unit that an error or a position may have."""
_EMPTY = "the cell is missing; fill it or leave the line out"

LEAST_ROWS = 3
"""Two temperatures always lie on a line; the third is the first that can contradict it."""

# Below this share of its own size a column's range is rounding, not a response to temperature.
_FLAT = 1e-12


class ErrorSetError(BadInputError, ValueError):
    """Values that a regression cannot use. Also a ValueError, as scikit-learn's tools expect.

    Functions and estimators in this folder raise it where a set or the temperature is constant, a setting is out of
    range, or a formula cannot be solved; for other input than finite tables scikit-learn raises its own ValueError.
    """


@dataclass(frozen=True)
class ErrorTable:
    """Errors of several poses at several melt temperatures.

    Raises:
        TableError: shapes or names do not fit, numbers are not finite, there are fewer than three rows, temperatures
            are below 0 K or not distinct, or a column is constant; later, a requested name is not in the table.
    """

    temperatures_K: FloatArray  # melt temperatures, shape (n,), all different, in the order they were given
    errors: FloatArray  # error of pose i at temperature j at [j, i], shape (n, k), in m or rad
    names: tuple[str, ...]  # names of the k error sets, without units
    kind: str = "length"  # "length" (m) or "angle" (rad)
    source: str = "table of error sets"  # file of the table, or a description of its origin; error messages name it

    def __post_init__(self) -> None:
        temperatures, errors = (np.array(numbers, dtype=float) for numbers in (self.temperatures_K, self.errors))
        if errors.ndim != 2 or temperatures.shape != errors.shape[:1] or errors.shape[1:] != (len(self.names),):
            shapes = f"temperatures {temperatures.shape}, errors {errors.shape}, {len(self.names)} names"
            raise TableError(self.source, f"shapes do not fit ({shapes}); give (n,), (n, k) and k names")
        if len(set(self.names)) < len(self.names) or not self.names:
            raise TableError(self.source, "give one or more error sets, each with a name of its own")
        if self.kind not in KINDS.values():
            raise TableError(self.source, f"kind '{self.kind}' is not known; give 'length' or 'angle'")
        if len(temperatures) < LEAST_ROWS:
            raise TableError(self.source, f"{len(temperatures)} temperatures are too few; give {LEAST_ROWS} or more")
        if not (np.isfinite(temperatures).all() and np.isfinite(errors).all()):
            raise TableError(self.source, "every temperature and every error must be a finite number")
        if (coldest := temperatures.min()) < 0.0:
            raise TableError(self.source, f"temperature {coldest - ZERO_CELSIUS_K:g} degC is below 0 K; check its unit")
        _check_distinct(self.source, temperatures)
        for name in np.array(self.names)[_flat(errors)]:
            raise TableError(self.source, f"column {name} is constant; leave it out, it says nothing about temperature")
        object.__setattr__(self, "temperatures_K", read_only(temperatures))
        object.__setattr__(self, "errors", read_only(errors))

    @property
    def temperature_column(self) -> FloatArray:
        """Melt temperatures in K as scikit-learn expects them, shape (n, 1)."""
        return self.temperatures_K[:, None]

    def select(self, names: Sequence[str]) -> ErrorTable:
        """Return the table with only these sets, in this order."""
        for name in names:
            if name not in self.names:
                raise TableError(self.source, f"holds no error set '{name}'; it has {', '.join(self.names)}")
        columns = [self.names.index(name) for name in names]
        return replace(self, errors=self.errors[:, columns], names=tuple(names))

    def without(self, names: Sequence[str]) -> ErrorTable:
        """Return the table without these sets."""
        return self.select([name for name in self.names if name not in names])

    def frame(self) -> pd.DataFrame:
        """Return the errors (m or rad) as a pandas table: columns are the sets, the index is temperature in K."""
        import pandas as pd

        index = pd.Index(self.temperatures_K, name="temperature_K")
        return pd.DataFrame(self.errors, columns=list(self.names), index=index)

    @classmethod
    def read_csv(cls, path: Path | str, *, temperature_column: str | None = None) -> ErrorTable:
        """Read a table from a CSV file in UTF-8, whose first line names the columns, each with its unit.

        One column is the temperature (``_degC`` or ``_K``); all others are error sets (``_um _mm _m`` or ``_mrad _deg
        _rad``, not both kinds). Where several columns are temperatures, ``temperature_column`` selects one, and the
        others are ignored. Empty lines are skipped.

        Raises:
            TableError: the file cannot be read, a heading is duplicated or has no or an unknown unit, a cell is
                missing or not a finite number, a line is too long, or as for the constructor.
        """
        table = read_table(path, "melt_degC,P1_mm,P2_mm")
        temperature, sets, kind = _sort_headings(table, temperature_column)
        if len(table) < LEAST_ROWS:
            raise TableError(path, f"holds {len(table)} temperatures; {LEAST_ROWS} or more are needed to see a trend")
        errors = [to_inner(table.numbers(i, empty=_EMPTY), unit) for i, _, unit in sets]
        unit = table.headings[temperature].rpartition("_")[2]
        temperatures = to_inner(table.numbers(temperature, empty=_EMPTY), unit) + ZERO_CELSIUS_K
        _check_distinct(path, temperatures, table.lines.tolist())
        return cls(temperatures, np.column_stack(errors), tuple(name for _, name, _ in sets), kind, str(path))

    def csv(self) -> str:
        """Return the table as CSV: columns ``melt_degC`` and each set in mm or mrad, with 17 digits."""
        unit = "mm" if self.kind == "length" else "mrad"
        frame = self.frame().mul(1e3).add_suffix(f"_{unit}")
        frame.insert(0, "melt_degC", self.temperatures_K - ZERO_CELSIUS_K)
        return str(frame.to_csv(index=False, float_format="%.17g", lineterminator="\n"))


def _flat(columns: FloatArray) -> BoolArray:
    """Return which columns are constant except for rounding."""
    return np.asarray(np.ptp(columns, axis=0) <= _FLAT * np.abs(columns).max(axis=0))


def standardised(name: str, numbers: ArrayLike) -> FloatArray:
    """Return the columns of an array (n, k) with mean 0 and sample standard deviation 1.

    Raises:
        ErrorSetError: a column is constant.
    """
    columns = np.asarray(numbers, dtype=float)
    flat = _flat(columns)
    if flat.any():
        raise ErrorSetError(f"{name} {flat.argmax()} is constant; leave it out, it follows nothing")
    return np.asarray((columns - columns.mean(axis=0)) / columns.std(axis=0, ddof=1))


def _sort_headings(table: Table, wanted: str | None) -> tuple[int, list[tuple[int, str, str]], str]:
    """Return the index of the temperature column; index, name and unit of every set; and their kind."""
    table.refuse_doubled()
    temperatures, sets, kinds = [], [], {}
    for i, heading in enumerate(table.headings):
        name, _, unit = heading.rpartition("_")
        if name and unit in UNITS["temperature"]:
            temperatures.append(i)
        elif name and unit in KINDS:
            sets.append((i, name, unit))
            kinds[KINDS[unit]] = heading
        else:
            known = " ".join(f"_{unit}" for unit in [*UNITS["temperature"], *KINDS])
            raise table.heading_fault(f"column '{heading}' has no unit; end its name with one of {known}")
    chosen = [i for i in temperatures if wanted in {None, table.headings[i]}]
    if len(chosen) != 1:
        found = ", ".join(table.headings[i] for i in temperatures) or "none"
        raise table.heading_fault(f"exactly one column must be the temperature (_degC or _K), found: {found}")
    if not sets:
        raise table.heading_fault("names no error set, such as P1_mm")
    if len(kinds) > 1:
        raise table.heading_fault(f"{kinds['length']} is a length, {kinds['angle']} an angle; make two tables")
    names = [name for _, name, _ in sets]
    for name in names:
        if names.count(name) > 1:
            raise table.heading_fault(f"error set {name} occurs twice, in two units")
    return chosen[0], sets, next(iter(kinds))


def _check_distinct(source: Any, temperatures: FloatArray, lines: list[int] | None = None) -> None:
    """Raise a TableError where two temperatures are the same to 1e-9 K."""
    order = np.argsort(temperatures, kind="stable")
    same = np.flatnonzero(np.diff(temperatures[order]) < 1e-9)
    if same.size:
        first, second = (int(i) for i in order[same[0] : same[0] + 2])
        where = f"rows {first + 1} and {second + 1}" if lines is None else f"lines {lines[first]} and {lines[second]}"
        degrees = temperatures[first] - ZERO_CELSIUS_K
        raise TableError(source, f"{where} have the same temperature, {degrees:g} degC; keep one, or their mean")
