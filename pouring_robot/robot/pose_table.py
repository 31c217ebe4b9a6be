"""Commanded poses from a CSV file, whose column names carry the units."""

from __future__ import annotations

import csv
import math
from pathlib import Path

from pouring_robot.exceptions import TableError, closest
from pouring_robot.io.cells import finite_cell
from pouring_robot.robot.pouring.poses import PlatformPose

_LENGTHS = {"mm": 1e-3, "m": 1.0}
_ANGLES = {"deg": math.radians(1.0), "rad": 1.0, "mrad": 1e-3}
_COLUMNS = {
    name: {f"{name}_{unit}": factor for unit, factor in units.items()}
    for name, units in (("x", _LENGTHS), ("y", _LENGTHS), ("z", _LENGTHS), ("tilt", _ANGLES))
}


def read_poses(path: Path | str) -> list[PlatformPose]:
    """Read commanded poses in the file's order; see :func:`read_pose_lines`.

    Raises:
        TableError: the file is wrong.
    """
    return list(read_pose_lines(path).values())


def read_pose_lines(path: Path | str) -> dict[int, PlatformPose]:
    """Read commanded poses: columns x, y, z (``_mm`` or ``_m``) and tilt (``_deg``, ``_rad`` or ``_mrad``).

    Returns:
        The poses in the file's order, by the line they stand on.

    Raises:
        TableError: the file cannot be read, a column is missing, doubled or unknown, a row has too many cells, or
            a cell is no finite number.
    """
    path = Path(path)
    try:
        with path.open(encoding="utf-8-sig", newline="") as stream:
            reader = csv.reader(stream)
            rows = [(reader.line_num, row) for row in reader]
    except OSError as error:
        raise TableError(path, f"cannot be read: {error.strerror}") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise TableError(path, "is not a CSV file in UTF-8") from error
    if not rows:
        raise TableError(path, "is empty; the first line must name the columns x_mm, y_mm, z_mm, tilt_deg")
    header = [cell.strip() for cell in rows[0][1]]
    columns = _find_columns(path, header)
    poses = {}
    for number, row in rows[1:]:
        if len(row) > len(header):
            raise TableError(path, f"line {number}: {len(row)} cells, but the header names {len(header)} columns")
        if any(cell.strip() for cell in row):
            x, y, z, tilt = (_cell(path, number, row, *columns[name]) for name in _COLUMNS)
            poses[number] = PlatformPose((x, y, z), tilt)
    if not poses:
        raise TableError(path, "holds no pose below its header line")
    return poses


def _find_columns(path: Path, header: list[str]) -> dict[str, tuple[int, float, str]]:
    """Return position, factor to SI and heading of each wanted column."""
    known = [heading for units in _COLUMNS.values() for heading in units]
    for heading in header:
        if heading not in known:
            raise TableError(path, f"line 1: unknown column '{heading}'{closest(heading, known)}")
    found = {}
    for name, units in _COLUMNS.items():
        matches = [(i, units[heading], heading) for i, heading in enumerate(header) if heading in units]
        if len(matches) != 1:
            problem = "is missing" if not matches else "stands twice"
            raise TableError(path, f"line 1: the column for {name} ({' or '.join(units)}) {problem}")
        found[name] = matches[0]
    return found


def _cell(path: Path, number: int, row: list[str], index: int, factor: float, heading: str) -> float:
    return finite_cell(path, number, row, index, heading) * factor
