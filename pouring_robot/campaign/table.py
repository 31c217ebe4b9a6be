"""Reading a table of numbers and labels, CSV or Parquet, so that every fault names file, line and column."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pouring_robot.campaign.columns import ABSOLUTE_ZERO_DEGC, Column, HeadingError, Quantity, understand
from pouring_robot.exceptions import CampaignError
from pouring_robot.mechanism.arrays import FloatArray

PARQUET_SUFFIXES = (".parquet", ".pq")
LARGEST = 1e9
"""No value of a campaign comes near this, in any of the units; what does is a broken number."""
_MOST_ROWS = 1_000_000


@dataclass(frozen=True)
class Table:
    """A table that was understood.

    Attributes:
        path: the file.
        lines: (n,) line of each row in a CSV file (the header is line 1); in Parquet, its row from 1.
        columns: each column that was found, by quantity name.
        unknown: headings that are no part of the contract and were left out.
        numbers: values of each numeric column in inner units (m, rad, kg, s, °C), (n,), NaN where a cell is empty.
        labels: cells of each label column, length n, "" where empty.
    """

    path: Path
    lines: NDArray[np.int64]
    columns: dict[str, Column]
    unknown: tuple[str, ...]
    numbers: dict[str, FloatArray] = field(repr=False)
    labels: dict[str, tuple[str, ...]] = field(repr=False)

    def __len__(self) -> int:
        """Return the number of rows."""
        return int(self.lines.size)


def read_table(path: Path | str, quantities: Sequence[Quantity]) -> Table:
    """Read a CSV (UTF-8, commas) or Parquet file that holds the given quantities.

    Empty cells are missing values, as are the ``nan`` that some programs write for them.

    Raises:
        CampaignError: the file cannot be read, a heading is wrong, or a cell is no number.
    """
    path = Path(path)
    read = _read_parquet if path.suffix.lower() in PARQUET_SUFFIXES else _read_csv
    headings, lines, cells = read(path)
    headings = [heading.strip() for heading in headings]
    csv_row = 1 if read is _read_csv else None
    try:
        columns, unknown = understand(headings, quantities)
    except HeadingError as error:
        hint = ""
        if len(headings) == 1 and any(mark in headings[0] for mark in ";\t"):
            hint = " (columns must be parted by commas, and the decimal mark must be a point)"
        raise CampaignError(path, error.problem + hint, row=csv_row, column=error.column[:80]) from error
    if not lines:
        raise CampaignError(path, "holds no row; each row is one static pose")
    numbers, labels = {}, {}
    for name, column in columns.items():
        if column.quantity.kind == "label":
            labels[name] = tuple(_label(value) for value in cells(column.index))
        else:
            numbers[name] = _numbers(path, column, lines, cells(column.index))
    return Table(path, np.array(lines, dtype=np.int64), columns, tuple(filter(None, unknown)), numbers, labels)


_Content = tuple[list[str], list[int], Callable[[int], Sequence[Any]]]


def _read_csv(path: Path) -> _Content:
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, ValueError) as error:
        reason = (error.strerror or str(error)) if isinstance(error, OSError) else "it is not UTF-8 text"
        raise CampaignError(path, f"cannot be read: {reason}") from error
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    headings: list[str] = []
    lines: list[int] = []
    rows: list[list[str]] = []
    try:
        for row in reader:
            if not any(cell.strip() for cell in row):
                continue
            if not headings:
                headings = row
                continue
            if len(row) != len(headings):
                problem = f"the row has {len(row)} cells, the header {len(headings)}; is it cut off?"
                raise CampaignError(path, problem, row=reader.line_num)
            lines.append(reader.line_num)
            rows.append(row)
            if len(rows) > _MOST_ROWS:
                raise CampaignError(path, f"has more than {_MOST_ROWS} rows; split it")
    except csv.Error as error:
        raise CampaignError(path, f"not valid CSV: {error}", row=reader.line_num) from error
    if not headings:
        raise CampaignError(path, "is empty; its first line must name the columns, such as q1_mm")
    return headings, lines, lambda index: [row[index] for row in rows]


def _read_parquet(path: Path) -> _Content:
    # Half a second to import, and only those who use Parquet need it.
    import pyarrow
    import pyarrow.parquet

    try:
        table = pyarrow.parquet.ParquetFile(pyarrow.BufferReader(path.read_bytes())).read()
    except (
        OSError,
        ValueError,
        TypeError,
        KeyError,
        NotImplementedError,
        MemoryError,
        pyarrow.ArrowException,
    ) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise CampaignError(path, f"cannot be read as Parquet: {reason}") from error

    def column(index: int) -> Sequence[Any]:
        try:
            return list(table.column(index).to_pylist())
        except (ValueError, OverflowError, pyarrow.ArrowException) as error:
            name = str(table.column_names[index])
            raise CampaignError(path, f"cannot be read: {error}", column=name) from error

    return [str(name) for name in table.column_names], list(range(1, table.num_rows + 1)), column


def _label(value: Any) -> str:
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return ""
    if isinstance(value, float) and value.is_integer():
        return str(int(value))
    return " ".join(str(value).split())


def _number(value: Any) -> float:
    """Return a cell as a number, NaN when it is empty.

    Raises:
        ValueError: it is neither.
    """
    if value is None:
        return math.nan
    if isinstance(value, str):
        text = value.strip()
        if not text:
            return math.nan
        if "_" in text:  # Python would read 1_000 as 1000
            raise ValueError(text)
        number = float(text)
    elif isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(str(value))
    else:
        number = float(value)
    if abs(number) > LARGEST:
        raise ValueError(str(value))
    return number


def _numbers(path: Path, column: Column, lines: Sequence[int], cells: Sequence[Any]) -> FloatArray:
    values = np.empty(len(cells))
    for row, cell in enumerate(cells):
        try:
            values[row] = _number(cell)
        except (ValueError, OverflowError) as error:
            shown = " ".join(str(cell).split())[:40]
            problem = f"'{shown}' is not a usable number; write a finite one, or leave the cell empty if it is missing"
            raise CampaignError(path, problem, row=lines[row], column=column.heading) from error
    inner = column.to_inner(values)
    if column.quantity.kind == "temperature" and np.any(inner < ABSOLUTE_ZERO_DEGC):
        row = int(np.flatnonzero(inner < ABSOLUTE_ZERO_DEGC)[0])
        problem = f"{values[row]:g} {column.unit} is below absolute zero; check the unit"
        raise CampaignError(path, problem, row=lines[row], column=column.heading)
    return inner
