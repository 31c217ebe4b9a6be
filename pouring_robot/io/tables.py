"""Tables that users write, CSV, Parquet or Excel, read so that every fault names file, line and column."""

import csv
import io
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pouring_robot.exceptions import TableError, closest
from pouring_robot.io.argument_checks import as_path
from pouring_robot.io.files import EXCEL_SUFFIXES, PARQUET_SUFFIXES
from pouring_robot.io.units import LARGEST, LATEST, size_fault

_COMMENT = "; a line that begins with # is not a comment here: delete it, or only the # in front of headings"
_MOST_ROWS = 1_000_000
_UNUSABLE = "is not a usable number; write a finite one, or leave the cell empty if it is missing"
_DATE = re.compile(r"(?P<year>\d{4})?\d{0,2}(?P<mark>[-/.:])\d{1,2}((?P=mark)\d{1,4}.*)?")
_WHOLE = re.compile(r"(-?\d+)\.0")  # as pandas writes whole numbers where cells of the column are empty
_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+(e[+-]?\d+)?", re.IGNORECASE)


@dataclass(frozen=True)
class Table:
    """Headings and raw cells of a table. Empty lines are left out."""

    path: Path
    headings: tuple[str, ...]
    # line of each row in a CSV or Excel file (the heading is line 1), shape (n,); in Parquet, its row from 1
    lines: NDArray[np.int64]
    error: type[TableError]  # what is raised where something is wrong
    heading_line: int | None  # None where headings are not on a line
    cells: Callable[[int], Sequence[Any]] = field(repr=False)  # returns the cells of a column, by its index

    def __len__(self) -> int:
        return int(self.lines.size)

    def fault(self, problem: str, row: int, heading: str | None = None) -> TableError:
        """Return the error of a row (its index) or of one of its cells."""
        return self.error(self.path, problem, int(self.lines[row]), heading)

    def heading_fault(self, problem: str, heading: str | None = None) -> TableError:
        """Return the error of the headings, or of one."""
        return self.error(self.path, problem, self.heading_line, heading)

    def refuse_others(self, known: Sequence[str]) -> None:
        """Refuse headings that are not among these, and those that occur twice."""
        for heading in self.headings:
            if not heading:
                mend = "name it, or remove it; if it is the index of pandas, write the table with index=False"
                raise self.heading_fault(f"a column has no heading; {mend}")
            if heading not in known:
                with_unit = [name for name in known if name.lower().startswith(f"{heading.lower()}_")]
                said = f" names no unit; write {' or '.join(with_unit)}" if with_unit else closest(heading, known)
                raise self.heading_fault(f"unknown column '{heading}'{separators(self.headings) or said}")
        self.refuse_doubled()

    def refuse_doubled(self) -> None:
        """Refuse headings that occur twice."""
        for heading in self.headings:
            if self.headings.count(heading) > 1:
                raise self.heading_fault(f"column '{heading}' occurs twice")

    def labels(self, index: int) -> tuple[str, ...]:
        """Return the cells of a column as text; "" where empty."""
        return tuple(_label(cell) for cell in self.cells(index))

    def numbers(self, index: int, *, sparse: bool = False, empty: str = "") -> NDArray[np.float64]:
        """Return the cells of a column as finite numbers (n,), none larger than any quantity, in the unit of the file.

        ``sparse``: NaN where a cell is empty (or ``nan``). ``empty`` is the message for an empty cell; by default, that
        it is not a finite number.

        Raises:
            TableError: a cell is not such a number.
        """
        values = np.empty(len(self))
        timed = self.headings[index].startswith("time_")
        largest = LATEST if timed else LARGEST
        for row, cell in enumerate(self.cells(index)):
            try:
                values[row] = _number(cell)
                if not (math.isfinite(values[row]) or (sparse and math.isnan(values[row]))):
                    raise ValueError
            except (ValueError, OverflowError) as error:
                shown = "" if cell is None else " ".join(str(cell).split())[:40]
                wrong = _UNUSABLE if sparse else "is not a finite number"
                if _DECIMAL_COMMA.fullmatch(shown):
                    wrong = "is not a number: the decimal mark must be a point"
                elif timed and (date := _DATE.fullmatch(shown)):
                    wrong = _is_a_date(day_or_month_first=not date["year"] and date["mark"] != ":")
                said = empty if empty and not shown else f"'{shown}' {wrong}"
                raise self.fault(said, row, self.headings[index]) from error
            if fault := size_fault(values[row], largest):
                raise self.fault(fault, row, self.headings[index])
        return values


def _is_a_date(*, day_or_month_first: bool) -> str:
    """Return the message for a date in a column of times; pandas by default reads 01.03. as the 3rd of January."""
    order, otherwise = (", dayfirst=True", "; False if the month comes first") if day_or_month_first else ("", "")
    return (
        "is a date or a time of day; write the time since the first row (in s: "
        f"t = pandas.to_datetime(t{order}); (t - t[0]).dt.total_seconds(){otherwise})"
    )


def read_table(
    path: Path | str, example: str, error: type[TableError] = TableError, *, short_rows: bool = True
) -> Table:
    """Read a table whose first line names its columns: CSV (UTF-8, commas), or by its suffix Parquet or Excel.

    Args:
        path: the file; an Excel file holds one sheet that is not empty.
        example: headings such a table may have, for the message about an empty file.
        error: the error raised.
        short_rows: whether cells may be left out at the end of a row; they are empty then.

    Raises:
        TableError: (or ``error``) the file cannot be read, is empty, has several sheets, or a row has more cells than
            there are headings (or fewer).
    """
    path = as_path(path)
    if path.suffix.lower() in PARQUET_SUFFIXES:
        return _read_parquet(path, error)
    rows = (_excel_rows if path.suffix.lower() in EXCEL_SUFFIXES else _csv_rows)(path, error)
    if not rows:
        raise error(path, f"is empty; line 1 must name the columns, such as {example}")
    heading_line, first = rows.pop(0)
    if len(rows) > _MOST_ROWS:
        raise error(path, f"has more than {_MOST_ROWS} rows; split it")
    width = len(first)
    for line, cells in rows:
        if len(cells) > width or (len(cells) < width and not short_rows):
            why = f"; does line {heading_line} name every column?" if len(cells) > width else "; is the row cut off?"
            why = _COMMENT if str(cells[0]).startswith("#") else why
            raise error(path, f"{len(cells)} cells for {width} columns{separators(first) or why}", line)
        cells.extend([""] * (width - len(cells)))
    lines = np.array([line for line, _ in rows], dtype=np.int64)
    headings = tuple(str(cell).strip() for cell in first)
    return Table(path, headings, lines, error, heading_line, lambda index: [cells[index] for _, cells in rows])


def table_of(frame: Any, path: Path, error: type[TableError] = TableError) -> Table:
    """Return a data frame of pandas as a table that would be at ``path``; rows are counted from 1.

    An index with a name is a column, as it is in a file that pandas writes.
    """
    frame = frame.reset_index([name for name in frame.index.names if name is not None], allow_duplicates=True)
    headings = tuple(str(name).strip() for name in frame.columns)
    return Table(path, headings, np.arange(1, len(frame) + 1), error, None, lambda k: _cells(frame.iloc[:, k].tolist()))


def csv_text(headings: Iterable[str], rows: Iterable[Iterable[Any]]) -> str:
    """Return a table as CSV; cells that hold commas or quotes are quoted, None is empty."""
    stream = io.StringIO()
    csv.writer(stream, lineterminator="\n").writerows([headings, *rows])
    return stream.getvalue()


def rows_csv(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return rows by heading as CSV; a cell that a row lacks is empty."""
    names = dict.fromkeys(name for row in rows for name in row)
    return csv_text(names, ([row.get(name) for name in names] for row in rows))


def _number(cell: Any) -> float:
    """Return a cell as a number, NaN when it is empty; raises ValueError, or OverflowError of one beyond a double."""
    if cell is None:
        return math.nan
    if isinstance(cell, str):
        if "_" in cell:  # Python would read 1_000 as 1000
            raise ValueError(cell)
        return float(cell) if cell.strip() else math.nan
    if isinstance(cell, bool) or not isinstance(cell, Real | Decimal):  # of numpy, too, but for its truth values
        raise ValueError(str(cell))
    return float(cell)


def separators(headings: Sequence[Any]) -> str:
    """Return a hint about a table of these headings, if they are a comment or a single heading."""
    if headings and str(headings[0]).startswith("#"):
        return _COMMENT
    if len(headings) == 1 and any(mark in str(headings[0]) for mark in ";\t"):
        return " (columns must be parted by commas, and the decimal mark must be a point)"
    return ""


def _label(cell: Any) -> str:
    if cell is None or (isinstance(cell, float) and not math.isfinite(cell)):
        return ""
    text = " ".join(str(cell).split())
    whole = _WHOLE.fullmatch(text)
    return whole[1] if whole else text


_Rows = list[tuple[int, list[Any]]]


def _csv_rows(path: Path, error: type[TableError]) -> _Rows:
    """Return line number and cells of every line that is not empty."""
    try:
        reader = csv.reader(io.StringIO(path.read_text(encoding="utf-8-sig"), newline=""), strict=True)
    except OSError as problem:
        raise error(path, f"cannot be read: {problem.strerror}") from problem
    except ValueError as problem:
        raise error(path, "cannot be read: it is not a CSV file in UTF-8; save it as one") from problem
    try:
        return [(reader.line_num, cells) for cells in reader if any(cell.strip() for cell in cells)]
    except csv.Error as problem:
        raise error(path, f"not valid CSV: {problem}", reader.line_num) from problem


def _excel_rows(path: Path, error: type[TableError]) -> _Rows:
    """Return the same for an Excel file, of whose sheets only one may hold cells."""
    import pandas as pd

    try:
        # Words such as NA stay what they are, so that only a cell with an error, such as #DIV/0!, has no value.
        frames = pd.read_excel(path, sheet_name=None, header=None, dtype=object, keep_default_na=False)
    except ImportError as problem:  # pandas names the package that reads this kind
        raise error(path, f"cannot be read: {' '.join(str(problem).split())} Or save the table as CSV") from problem
    except OSError as problem:
        raise error(path, f"cannot be read: {problem.strerror or problem}") from problem
    except Exception as problem:  # what a damaged workbook raises depends on the package that opens it
        raise error(path, "is not an Excel file, or a damaged one; save it again, or as CSV") from problem
    sheets = {name: rows for name, frame in frames.items() if (rows := _rows_of(frame))}
    if len(sheets) > 1:
        named = ", ".join(f"'{name}'" for name in sheets)
        raise error(path, f"has the sheets {named}; keep the one with the table, or save that one as CSV")
    return next(iter(sheets.values()), [])


def _rows_of(frame: Any) -> _Rows:
    """Return line number and cells of every line of a sheet that is not empty."""
    rows = frame.fillna("an error of Excel").itertuples(index=False)
    return [(line, list(row)) for line, row in enumerate(rows, start=1) if any(str(cell).strip() for cell in row)]


def _cells(given: Iterable[Any]) -> list[Any]:
    """Return cells of pandas, "" for those that are missing."""
    import pandas as pd

    # For a cell that holds a list isna gives a mask; its column decides whether it accepts such a cell.
    return ["" if pd.isna(cell) is True else cell for cell in given]


def _read_parquet(path: Path, error: type[TableError]) -> Table:
    # Takes half a second to import, and only Parquet needs it.
    import pyarrow
    import pyarrow.parquet

    broken = (ValueError, TypeError, KeyError, NotImplementedError, MemoryError, OverflowError, pyarrow.ArrowException)
    try:
        table = pyarrow.parquet.ParquetFile(pyarrow.BufferReader(path.read_bytes())).read()
    except (OSError, *broken) as problem:
        reason = (problem.strerror if isinstance(problem, OSError) else None) or str(problem)
        raise error(path, f"cannot be read as Parquet: {reason}") from problem

    def column(index: int) -> Sequence[Any]:
        try:
            return list(table.column(index).to_pylist())
        except broken as problem:
            raise error(path, f"cannot be read: {problem}", None, str(table.column_names[index])) from problem

    headings = tuple(str(name).strip() for name in table.column_names)
    return Table(path, headings, np.arange(1, table.num_rows + 1), error, None, column)
