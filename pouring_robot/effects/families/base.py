"""What all families share: an effect that is made for parts of one robot, and parameters that move its drives.

Usual sizes are orders of size: evidence is averaged from a hundredth to ten times of them, and what only shapes an
effect from 0.03 to all of its part (docs/inference.md, "Two scales an effect").
"""

from collections.abc import Sequence
from dataclasses import dataclass

from pouring_robot.effects.base import Effect, EffectParameter
from pouring_robot.effects.conditions import Conditions
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.poses import MM, MRAD
from pouring_robot.robot.description.definition import Drive


@dataclass(eq=False)
class Family(Effect):
    """A family of effects, made for parts of one robot."""

    id: str  # name in files and on the command line
    story: str  # one line for people
    drives: tuple[Drive, ...] = ()  # on which it acts


def channel(drive: Drive) -> str:
    """Return the name of the local parameter that moves a drive."""
    return f"drive.{drive.joint}"


def of_drives(drives: Sequence[Drive], unit: float, courses: FloatArray) -> dict[str, FloatArray]:
    """Return the change of all drives along courses (n, drives), of a unit in m or rad."""
    return {channel(drive): unit * courses[:, k] for k, drive in enumerate(drives)}


def of_drive(
    drive: Drive, name: str, prior_std: float, course: FloatArray, main: bool = True, per: str = ""
) -> EffectParameter:
    """Return a parameter that moves one drive along a course (n,), in its own unit; ``per`` is added to that."""
    unit, si = ("mm", MM) if drive.unit == "m" else ("mrad", MRAD)
    return EffectParameter(f"{drive.symbol}_{name}", unit + per, prior_std, {channel(drive): si * course}, main)


def of_each(
    conditions: Conditions,
    drives: Sequence[Drive],
    name: str,
    prior_std: float,
    courses: FloatArray,
    main: bool = True,
    per: str = "",
) -> list[EffectParameter]:
    """Return such a parameter for each of some drives: its own column of the courses of all drives, (n, D)."""
    columns = zip(drives, conditions.places(drives), strict=True)
    return [of_drive(drive, name, prior_std, courses[:, k], main, per) for drive, k in columns]
