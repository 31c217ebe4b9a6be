"""What is wrong with a campaign's data: typed findings with rows, columns, figures and a remedy."""

from __future__ import annotations

import enum
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pouring_robot.campaign.data import Campaign


class Severity(enum.StrEnum):
    """How much a finding matters."""

    ERROR = "error"
    """A fit of these data would be wrong."""
    WARNING = "warning"
    """Some rows or columns should be looked at, and mended or left out."""
    NOTE = "note"
    """Good to know; limits what can be found out."""


class FlagCode(enum.StrEnum):
    """What was found."""

    TOO_FEW_ROWS = "too_few_rows"
    ONE_POSE = "one_pose"
    REPEATED_ROWS = "repeated_rows"
    STUCK_COLUMN = "stuck_column"
    COLUMN_JUMP = "column_jump"
    BAD_APPROACH = "bad_approach"
    TIME_NOT_INCREASING = "time_not_increasing"
    NO_NOISE_LEVEL = "no_noise_level"
    NO_TEMPERATURES = "no_temperatures"
    MISSING_DRIVES = "missing_drives"
    IGNORED_COLUMNS = "ignored_columns"
    DRIVE_UNIT = "drive_unit"
    POSITION_UNIT = "position_unit"
    ROTATION_UNIT = "rotation_unit"
    FRAMES_SWAPPED = "frames_swapped"
    ROTATION_INVERTED = "rotation_inverted"
    MIRRORED_AXES = "mirrored_axes"
    DRIVES_EXCHANGED = "drives_exchanged"
    NO_AGREEMENT = "no_agreement"
    UNREACHABLE_DRIVES = "unreachable_drives"
    UNREACHABLE_POSE = "unreachable_pose"
    OUTLIER = "outlier"
    MEASUREMENT_JUMP = "measurement_jump"


@dataclass(frozen=True)
class DataFlag:
    """One finding.

    Attributes:
        code: what was found.
        severity: how much it matters.
        message: what and where, one line, with the file's own lines and headings.
        remedy: what to do about it, one sentence.
        rows: indices of the rows concerned, from 0; empty: the campaign as a whole.
        columns: headings in the file of the columns concerned.
        metrics: the figures behind it; the unit is the end of the name.
    """

    code: FlagCode
    severity: Severity
    message: str
    remedy: str
    rows: tuple[int, ...] = ()
    columns: tuple[str, ...] = ()
    metrics: dict[str, float] = field(default_factory=dict)

    def __str__(self) -> str:
        """Return the finding on one line."""
        return f"{self.severity}: {self.message}; {self.remedy}"

    def to_json(self, campaign: Campaign) -> dict[str, Any]:
        """Return the finding ready for JSON, with the file's lines beside the rows."""
        return {
            "code": str(self.code),
            "severity": str(self.severity),
            "message": self.message,
            "mend": self.remedy,
            "rows": list(self.rows),
            "lines": [int(campaign.lines[row]) for row in self.rows],
            "columns": list(self.columns),
            "figures": dict(self.metrics),
        }


Rows = NDArray[np.intp]


def outlier_rows(flags: Iterable[DataFlag]) -> Rows:
    """Return the rows that no fit should use: outliers, and poses or drives out of reach; ascending."""
    codes = (FlagCode.OUTLIER, FlagCode.UNREACHABLE_POSE, FlagCode.UNREACHABLE_DRIVES)
    rows = {row for flag in flags if flag.code in codes for row in flag.rows}
    return np.array(sorted(rows), dtype=np.intp)


def row_tuple(rows: Iterable[int] | Rows) -> tuple[int, ...]:
    """Return row indices as plain integers."""
    return tuple(int(row) for row in rows)


def where(campaign: Campaign, rows: Sequence[int] | Rows, most: int = 6) -> str:
    """Return ``line 12`` or ``lines 12, 40 and 7 more`` for rows of a campaign."""
    lines = [str(int(campaign.lines[row])) for row in rows[:most]]
    more = f" and {len(rows) - most} more" if len(rows) > most else ""
    return f"line{'s' if len(rows) > 1 else ''} {', '.join(lines)}{more}"
