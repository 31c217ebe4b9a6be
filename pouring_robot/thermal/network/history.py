"""Histories over time: melt and ambient temperature, and the poses that are held.

Too few entries, unequal lengths and times that do not increase raise HistoryError, impossible temperatures
TemperatureError.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np

from pouring_robot.exceptions import BadInputError, HistoryError, TableError
from pouring_robot.io.quantity_columns import Quantity, whole_column
from pouring_robot.io.tables import read_table
from pouring_robot.io.temperatures import AMBIENT_DEGC, ZERO_CELSIUS_K, kelvin, temperature_fault
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.closure.solver import ClosureResult
from pouring_robot.robot.pouring.platform_pose import PLATFORM_POSE, POSE_COLUMNS, PlatformPose

Placed = PlatformPose | ClosureResult
"""Where the robot is: a nominal pose, or a closure of any robot of the layout."""

_TIME, _MELT, _AMBIENT = Quantity("time", "time"), Quantity("melt", "temperature"), Quantity("ambient", "temperature")
_STRAIGHT_K_PER_S = 1e-12


@dataclass(frozen=True, eq=False)
class HeatHistory:
    """Melt and ambient temperature over time, (n,) each, linear between two or more entries."""

    times_s: FloatArray
    melt_degC: FloatArray
    ambient_degC: FloatArray

    def __post_init__(self) -> None:
        times = np.array(self.times_s, dtype=float)
        if times.ndim != 1 or times.size < 2:
            raise HistoryError("give at least two entries, its start and its end")
        _check_order(times)
        object.__setattr__(self, "times_s", times)
        for what in ("melt", "ambient"):
            values = np.array(getattr(self, f"{what}_degC"), dtype=float)
            if values.shape != times.shape:
                raise HistoryError(f"{what}_degC has {values.size} entries, times_s has {times.size}")
            for row, value in enumerate(values, start=1):
                kelvin(float(value), f"history, entry {row}: {what}", surroundings=what == "ambient")
            object.__setattr__(self, f"{what}_degC", values)

    @classmethod
    def constant(cls, melt_degC: float, ambient_degC: float, duration_s: float) -> Self:
        """Return constant temperatures over a duration."""
        return cls(np.array([0.0, duration_s]), np.full(2, melt_degC), np.full(2, ambient_degC))

    @property
    def start_s(self) -> float:
        """Time of the first entry."""
        return float(self.times_s[0])

    @property
    def end_s(self) -> float:
        """Time of the last entry."""
        return float(self.times_s[-1])

    def at(self, time_s: float) -> tuple[float, float]:
        """Return melt and ambient temperature at a time, in K."""
        melt, ambient = (np.interp(time_s, self.times_s, values) for values in (self.melt_degC, self.ambient_degC))
        return float(melt) + ZERO_CELSIUS_K, float(ambient) + ZERO_CELSIUS_K

    @property
    def corners_s(self) -> FloatArray:
        """Times at which the slope of a temperature changes; an integrator must not step across them."""
        steps = np.diff(self.times_s)
        bends = sum(np.abs(np.diff(np.diff(values) / steps)) for values in (self.melt_degC, self.ambient_degC))
        return np.asarray(self.times_s[1:-1][np.asarray(bends) > _STRAIGHT_K_PER_S])


@dataclass(frozen=True)
class PoseSchedule:
    """Poses held one after the other, each from its time on; moves between them take no time."""

    entries: tuple[tuple[float, Placed], ...]
    lines: tuple[int, ...] = ()  # line of each in its table, if read from one

    def __post_init__(self) -> None:
        if not self.entries:
            raise HistoryError("the schedule holds no pose")
        _check_order(np.array([time for time, _ in self.entries], dtype=float))

    @classmethod
    def of(cls, poses: "Placed | PoseSchedule | Sequence[tuple[float, Placed]]", start_s: float) -> "PoseSchedule":
        """Return a schedule from one pose that is held throughout, from entries, or unchanged."""
        if isinstance(poses, PoseSchedule):
            return poses
        if isinstance(poses, PlatformPose | ClosureResult):
            return cls(((start_s, poses),))
        return cls(tuple((float(time), pose) for time, pose in poses))

    def at(self, time_s: float) -> Placed:
        """Return the pose held from a time on; before the first entry, the first pose."""
        begun = [pose for time, pose in self.entries if time <= time_s]
        return begun[-1] if begun else self.entries[0][1]


def _check_order(times: FloatArray) -> None:
    for row, time in enumerate(times, start=1):
        if not math.isfinite(time):
            raise HistoryError(f"its time must be a finite number, not {time}", row)
        if row > 1 and time <= times[row - 2]:
            raise HistoryError(f"its time of {time:g} s is not later than {times[row - 2]:g} s; sort by time", row)


def read_shift(path: Path | str, default_ambient_degC: float = AMBIENT_DEGC) -> tuple[HeatHistory, PoseSchedule | None]:
    """Read a history from a table, and the held poses if it has any.

    Columns, each in any unit of its kind: time, ``melt``, optionally ``ambient``, and all or none of ``x``, ``y``,
    ``z``, ``tilt``. A pose is held from the time of its line on.

    Raises:
        TableError: the file cannot be read, a column is missing, unknown or duplicated, a cell is not a number, times
            do not increase, or a temperature is impossible; names line and column.
    """
    table = read_table(path, "time_min, melt_degC, ambient_degC")
    known = (_TIME, _MELT, _AMBIENT, *PLATFORM_POSE)
    table.refuse_others([heading for quantity in known for heading in quantity.headings])
    there = [quantity for quantity in known if {*quantity.headings} & {*table.headings}]
    columns = {quantity: whole_column(table, quantity) for quantity in (_TIME, _MELT, *there)}
    for quantity in (_MELT, _AMBIENT):
        heading, values = columns.get(quantity, ("", ()))
        for row, value in enumerate(values):
            if problem := temperature_fault(float(value), surroundings=quantity == _AMBIENT):
                raise table.fault(problem, row, heading)
    time_heading, times = columns[_TIME]
    late = np.flatnonzero(np.diff(times) <= 0.0)
    if late.size:
        raise table.fault("is not later than the line before; sort by time", int(late[0]) + 1, time_heading)
    ambient = columns[_AMBIENT][1] if _AMBIENT in there else np.full(len(times), default_ambient_degC)
    try:
        history = HeatHistory(times, columns[_MELT][1], ambient)
    except BadInputError as error:
        raise TableError(path, str(error)) from error
    if not {*there} & {*PLATFORM_POSE}:
        return history, None
    missing = [name for name, quantity in zip(POSE_COLUMNS, PLATFORM_POSE, strict=True) if quantity not in there]
    if missing:
        raise table.heading_fault(f"column '{missing[0]}' is missing; a pose needs {', '.join(POSE_COLUMNS)}")
    numbers = zip(*(columns[quantity][1].tolist() for quantity in PLATFORM_POSE), strict=True)
    poses = [PlatformPose.of_values(row) for row in numbers]
    changes = [k for k in range(len(poses)) if k == 0 or poses[k] != poses[k - 1]]
    entries = tuple((float(times[k]), poses[k]) for k in changes)
    return history, PoseSchedule(entries, tuple(table.lines[changes].tolist()))
