"""A drive: the joint that it moves, its names in files, and the command for a value of its joint."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from pouring_robot.exceptions import DescriptionError, closest
from pouring_robot.io.units import MM
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.joint_types import UNITS
from pouring_robot.robot.description.robot_file import DriveEntry


@dataclass(frozen=True)
class Drive:
    """One drive."""

    joint: str  # the URDF joint that it moves
    column: str  # name of its campaign column, without unit
    unit: Literal["m", "rad"]  # of the joint, ``m`` or ``rad``
    command: Literal["length", "angle"]  # kind of the commanded quantity, which decides the units of its column
    factor: float = 1.0  # how far the joint moves (SI) for a command of one (SI)
    zero: float = 0.0  # value of the joint at a command of zero, in m or rad
    symbol: str = ""  # short name in tables and parameters
    words: str = ""  # name in sentences

    @classmethod
    def of(cls, entry: DriveEntry, kinds: Mapping[str, str], path: Path) -> Drive:
        """Return the drive for an entry of the robot file at a path; ``kinds``: type of each joint of the URDF.

        Raises DescriptionError where the entry's joint cannot be a drive, or has a ratio of the wrong kind.
        """
        kind = kinds.get(entry.joint)
        if kind is None or kind not in UNITS:
            what = "is not a joint of the robot" if kind is None else f"is {kind}; a drive slides or turns"
            near = closest(entry.joint, kinds) if kind is None else ""
            raise DescriptionError(path, f"drive '{entry.joint}' {what}{near}")
        unit, factor = UNITS[kind], entry.ratio
        if entry.mm_per_turn is not None:
            if unit == "rad":
                raise DescriptionError(path, f"drive '{entry.joint}' turns, so it has no mm_per_turn")
            factor = entry.mm_per_turn * MM / (2.0 * math.pi)
        column = entry.column or entry.joint
        command: Literal["length", "angle"] = "length" if unit == "m" and entry.mm_per_turn is None else "angle"
        return cls(entry.joint, column, unit, command, factor, entry.zero, column, column)

    @property
    def approach_column(self) -> str:
        """Name of the campaign column with its side of approach."""
        return f"approach_{self.column}"

    @property
    def command_unit(self) -> Literal["m", "rad"]:
        """Unit of its command, ``m`` or ``rad``."""
        return "m" if self.command == "length" else "rad"

    @property
    def load(self) -> Literal["force", "moment"]:
        """Kind of load it carries."""
        return "force" if self.unit == "m" else "moment"

    @property
    def force_column(self) -> str:
        """Name of the campaign column with the load it carries."""
        return f"force_{self.column}"

    @property
    def per_turn(self) -> float | None:
        """Its travel per turn of its joint or motor, in m or rad; None where the command does not determine turns."""
        return 2.0 * math.pi if self.unit == "rad" else 2.0 * math.pi * self.factor if self.command == "angle" else None

    def turned(self, value: FloatArray, pitch_m: float | None) -> FloatArray:
        """Return the angle of its joint or motor, in rad, at values of the joint in m or rad; same shape.

        ``pitch_m`` is the pitch of its screw, used where the robot file states none; without either the angle is zero.
        """
        return np.asarray(2.0 * np.pi * value / abs(self.per_turn or pitch_m or np.inf))

    def value(self, command: FloatArray) -> FloatArray:
        """Return the joint's value for commands, in m or rad; same shape."""
        return np.asarray(command * self.factor + self.zero)

    def commanded(self, value: FloatArray) -> FloatArray:
        """Return the command (SI) for values of the joint; same shape."""
        return np.asarray((value - self.zero) / self.factor)

    def side(self, side: FloatArray) -> FloatArray:
        """Convert the side of approach (+1: rising) of the command to that of the joint, or back; same shape."""
        return np.asarray(side * np.sign(self.factor))
