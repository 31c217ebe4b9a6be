"""What is wrong with a campaign's data: typed findings with rows, columns, figures and a remedy."""

import enum
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np

from pouring_robot.campaign import columns
from pouring_robot.campaign.data import Campaign
from pouring_robot.exceptions import CampaignError, counted, some
from pouring_robot.mechanism.arrays import Indices

FEW_ROWS = 20  # with fewer usable rows little beyond the two frames can be determined
FEW_VALUES = 60
"""Coordinates of that many rows; where a row is one number, such as a distance or a closure, more rows are needed."""


class Severity(enum.StrEnum):
    """How much a finding matters."""

    ERROR = "error"  # a fit of these data would be wrong
    WARNING = "warning"  # some rows or columns should be looked at, and corrected or left out
    NOTE = "note"  # good to know; limits what a fit can determine


def _error(code: str, remedy: str) -> tuple[str, Severity, str]:
    return code, Severity.ERROR, remedy


def _warning(code: str, remedy: str) -> tuple[str, Severity, str]:
    return code, Severity.WARNING, remedy


def _note(code: str, remedy: str) -> tuple[str, Severity, str]:
    return code, Severity.NOTE, remedy


class FlagCode(enum.StrEnum):
    """Kinds of findings, with severity and remedy; a check may give more specific ones."""

    severity: Severity
    remedy: str

    def __new__(cls, value: str, severity: Severity, remedy: str) -> Self:
        """Make the code a string that carries severity and remedy."""
        code = str.__new__(cls, value)
        code._value_, code.severity, code.remedy = value, severity, remedy
        return code

    ANOTHER_ROBOT = _warning(
        "another_robot", "give its robot file by --robot, or correct 'robot' in the YAML if this is the right robot"
    )
    TOO_FEW_ROWS = _warning(
        "too_few_rows", f"measure at least {FEW_ROWS} poses, preferably 60, spread over the workspace"
    )
    ONE_POSE = _error(
        "one_pose", "command poses that differ in all drives; repeats of one pose cannot determine the frames"
    )
    REPEATED_ROWS = _warning(
        "repeated_rows",
        "copies are left out, since a real repeat would differ by its noise; remove them from the file",
    )
    NO_LENGTH = _warning(
        "no_length",
        "if the device was zeroed there, add its length at that moment to all distances; otherwise empty these cells",
    )
    STUCK_COLUMN = _warning(
        "stuck_column", "the sensor froze or cells were filled down; empty these cells, or measure them again"
    )
    COLUMN_JUMP = _warning("column_jump", "probably a loose sensor or a typing error; empty or correct these cells")
    BAD_APPROACH = _error(
        "bad_approach",
        "write +1 if the drive value was increasing before the stop, -1 if decreasing, nothing if unknown",
    )
    TIME_NOT_INCREASING = _warning(
        "time_not_increasing",
        "give the time of each measurement within its session, or name a new session where the clock restarts",
    )
    SESSIONS_OF_ROWS = _warning(
        "sessions_of_rows",
        "they are taken as row labels, and all rows as one session; give rows measured in one go the same session",
    )
    NO_NOISE_LEVEL = _warning(
        "no_noise_level",
        "state the standard deviation of one measured component, from the device's data sheet or from repeats",
    )
    NO_TEMPERATURES = _note(
        "no_temperatures",
        "effects of heat cannot be tested; record the temperature of the parts that warm up (<part>_degC)",
    )
    MISSING_DRIVES = _warning("missing_drives", "these rows cannot be used; fill in what was commanded")
    IGNORED_COLUMNS = _note("ignored_columns", "rename them if they hold a condition; otherwise nothing is wrong")
    UNUSED_TEMPERATURE = _warning(
        "unused_temperature", "name each after the part whose temperature it is, or leave it out"
    )
    CONDITION_UNIT = _error("condition_unit", "correct the unit at the end of the column's name, or convert the column")
    IMPOSSIBLE_CONDITION = _error("impossible_condition", "correct these cells, or empty them; check the unit, too")
    CONDITIONS_EXCHANGED = _error("conditions_exchanged", "put the headings over the right columns")
    TIME_SHUFFLED = _error("time_shuffled", "give each row its own time, or leave the column out")
    NOISE_TOO_SMALL = _warning(
        "noise_too_small",
        "state the standard deviation of repeats of a pose; with too small a noise, chance looks like an effect",
    )
    ROUNDED_DRIVES = _warning(
        "rounded_drives", "export the drives with all their digits; until then state a noise that includes the rounding"
    )
    NOT_COMPARED = _warning("not_compared", "measure complete positions, too")
    DRIVE_UNIT = _error("drive_unit", "correct the unit at the end of the column's name")
    POSITION_UNIT = _error("position_unit", "correct the unit at the end of the columns' names")
    DISTANCE_UNIT = _error("distance_unit", "correct the unit at the end of the column's name")
    DISTANCE_ZERO = _warning(
        "distance_zero", "add the missing length to all distances, such as a draw wire's length at its zero"
    )
    ROTATION_UNIT = _error("rotation_unit", "correct the unit at the end of the columns' names")
    FRAMES_SWAPPED = _error("frames_swapped", "exchange base and target in the tracker's export, or invert every pose")
    ROTATION_INVERTED = _error(
        "rotation_inverted", "reverse the signs of rx, ry and rz, or change the tracker's export"
    )
    EULER_ANGLES = _error("euler_angles", "convert them to a rotation vector, or have the tracker export that")
    MIRRORED_AXES = _error("mirrored_axes", "check order and signs of x, y and z in the tracker's export")
    DRIVE_REVERSED = _error(
        "drive_reversed",
        "reverse the sign of the column; if the controller counts this way, reverse that of the drive's ratio "
        "(1 unless stated) or mm_per_turn in the robot file",
    )
    DRIVE_ZERO = _error(
        "drive_zero", "if the controller counts from there, set the zero of this drive in the robot file"
    )
    DRIVE_ABSOLUTE = _error(
        "drive_absolute", "convert the column; joint angles of the drawing are relative to the previous link"
    )
    DRIVES_EXCHANGED = _error("drives_exchanged", "put the headings over the right columns")
    NO_AGREEMENT = _error(
        "no_agreement",
        "check that rows of drives and of measurements belong together, and that the drawing is this robot's",
    )
    UNREACHABLE_DRIVES = _error(
        "unreachable_drives", "check the drives' columns and units, and that the model file is this robot's"
    )
    UNREACHABLE_POSE = _error(
        "unreachable_pose",
        "the row pairs a command with another pose's measurement, or was mistyped; correct it or leave it out",
    )
    APART_SESSIONS = _error(
        "apart_sessions",
        "if the tracker was set up anew between sessions, write 'frames: per session' under metrology in the YAML",
    )
    TARGET_MOVED = _warning(
        "target_moved",
        "if the target was remounted or a drive's zero was reset in between, make each session a campaign of its own",
    )
    OUTLIER = _warning("outlier", "measure the pose again, or leave the row out")
    MEASUREMENT_JUMP = _warning(
        "measurement_jump",
        "if the tracker was moved, start a new session there; if the target was, put the rows from there on into a "
        "separate campaign; if neither, the robot's base has settled",
    )


ROW_CODES = (FlagCode.OUTLIER, FlagCode.UNREACHABLE_POSE, FlagCode.UNREACHABLE_DRIVES, FlagCode.REPEATED_ROWS)
"""Findings about single rows: these are left out, and the others can be used."""

_UNDONE = {
    FlagCode.DRIVE_UNIT: "the unit of {} corrected",
    FlagCode.DRIVE_REVERSED: "the sign of {} reversed",
    FlagCode.DRIVE_ZERO: "{} counted from the other zero",
    FlagCode.DRIVE_ABSOLUTE: "{} counted from the link before",
    FlagCode.DRIVES_EXCHANGED: "{} exchanged back",
    FlagCode.POSITION_UNIT: "the unit of {} corrected",
    FlagCode.FRAMES_SWAPPED: "the measured poses inverted",
    FlagCode.MIRRORED_AXES: "signs and order of {} corrected",
    FlagCode.ROTATION_UNIT: "the unit of {} corrected",
    FlagCode.ROTATION_INVERTED: "the sign of {} reversed",
    FlagCode.EULER_ANGLES: "{} converted to a rotation vector",
    FlagCode.APART_SESSIONS: "separate frames for each session",
}
"""Mistakes that are undone when found, for the checks and figures that follow."""


@dataclass(frozen=True)
class DataFlag:
    """One finding."""

    code: FlagCode
    severity: Severity
    message: str  # what and where, one line, with the file's own lines and headings
    remedy: str  # what to do about it, one sentence
    rows: tuple[int, ...] = ()  # indices of the rows concerned, from 0; empty: the campaign as a whole
    columns: tuple[str, ...] = ()  # headings in the file of the columns concerned
    metrics: dict[str, float] = field(default_factory=dict)  # the figures behind it; the unit is the end of the name

    def __str__(self) -> str:
        return f"{self.severity}: {self.message}; {self.remedy}"

    def figures(self, campaign: Campaign) -> dict[str, Any]:
        """Return the finding ready for JSON, with rows and lines of the file."""
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


def flagged(
    campaign: Campaign,
    code: FlagCode,
    message: str,
    rows: Iterable[int] | Indices = (),
    quantities: Iterable[str] = (),
    metrics: dict[str, float] | None = None,
    *,
    severity: Severity | None = None,
    remedy: str = "",
) -> DataFlag:
    """Return a finding about rows and quantities of a campaign, by default with the severity of its code."""
    headings = tuple(campaign.heading(name) for name in quantities)
    indices = tuple(int(row) for row in rows)
    return DataFlag(code, severity or code.severity, message, remedy or code.remedy, indices, headings, metrics or {})


def stuck(campaign: Campaign, name: str, value: float, rows: Indices, severity: Severity, remedy: str = "") -> DataFlag:
    """Return the finding that a column keeps one value in consecutive rows."""
    lines = campaign.lines[rows[[0, -1]]]
    message = f"column '{campaign.heading(name)}' keeps one value from line {lines[0]} to line {lines[1]}"
    if name in columns.drive_names(campaign.robot):
        remedy = "if the drive really stood still, its errors cannot be found; otherwise correct the column"
    else:
        message += " while the rest of the row changes"
    metrics = {"rows": float(rows.size), "value": float(value)}
    return flagged(campaign, FlagCode.STUCK_COLUMN, message, rows, [name], metrics, severity=severity, remedy=remedy)


def usable_without(campaign: Campaign, flags: Sequence[DataFlag]) -> Indices:
    """Return the rows to leave out, ascending, of data that are usable without them.

    Raises:
        CampaignError: the data are wrong as a whole, or in more than half of the rows, which no robust fit survives.
    """
    rows = wrong_rows(flags)
    many = 2 * rows.size > np.count_nonzero(campaign.usable)
    for flag in flags:
        if flag.severity is Severity.ERROR and (many or flag.code not in ROW_CODES):
            raise CampaignError(campaign.path, f"{flag.message}; {flag.remedy}")
    return rows


def refuse_errors(campaign: Campaign, flags: Iterable[DataFlag]) -> None:
    """Refuse data with any error, even in single rows, which a fit would leave out.

    Raises:
        CampaignError: there are errors; says how many, and the first of them.
    """
    errors = [flag for flag in flags if flag.severity is Severity.ERROR]
    if errors:
        said = f"{counted(len(errors), 'error')} in the data: {errors[0].message}; {errors[0].remedy}"
        raise CampaignError(campaign.path, said)


def wrong_rows(flags: Iterable[DataFlag]) -> Indices:
    """Return the rows that no fit should use: gross errors, poses or drives out of reach, and copies; ascending."""
    rows = {row for flag in flags if flag.code in ROW_CODES for row in flag.rows}
    return np.array(sorted(rows), dtype=np.intp)


def undone(flags: Iterable[DataFlag]) -> list[str]:
    """Return in words which of the mistakes found the checks undo before they compare, in the order of findings."""
    corrected = [flag for flag in flags if flag.code in _UNDONE]
    return [_UNDONE[flag.code].format(", ".join(f"'{heading}'" for heading in flag.columns)) for flag in corrected]


def where(campaign: Campaign, rows: Sequence[int] | Indices, most: int = 6) -> str:
    """Return ``line 12`` or ``lines 12, 40 and 7 more`` for rows of a campaign."""
    lines = [str(int(campaign.lines[row])) for row in rows]
    return f"line{'s' if len(rows) > 1 else ''} {some(lines, most)}"
