"""Cells of the tables that users write: a finite number, or one line that says where it is none."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from pouring_robot.exceptions import TableError


def finite_cell(path: Path, line: int, cells: Sequence[str], index: int, heading: str) -> float:
    """Return the number in one cell of a table's line.

    Args:
        path: the table.
        line: number of the line, the heading is line 1.
        cells: of that line; what is left out at its end counts as empty.
        index: which cell.
        heading: of its column.

    Raises:
        TableError: it is not a finite number.
    """
    text = cells[index].strip() if index < len(cells) else ""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise TableError(path, f"line {line}, column {heading}: '{text}' is not a finite number")
    return value
