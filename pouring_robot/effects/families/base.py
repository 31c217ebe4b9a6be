"""What all families share: an effect that is made for parts of one robot, and parameters that move its drives.

Usual sizes are orders of size: evidence is averaged from a hundredth to ten times of them, and what only shapes an
effect from 0.03 to all of its part (docs/inference.md, "Two scales an effect").
"""

from __future__ import annotations

from collections.abc import Sequence

from pouring_robot.effects.base import Effect, EffectParameter
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.poses import MM, MRAD
from pouring_robot.robot.description.definition import Drive

Drives = tuple[Drive, ...]


class Family(Effect):
    """A family of effects, made for parts of one robot.

    Args:
        id_: name in files and on the command line.
        story: one line for people.
        drives: on which it acts.
    """

    def __init__(self, id_: str, story: str, drives: Drives = ()) -> None:
        """Keep what it is called and what it acts on."""
        self.id, self.story, self.drives = id_, story, drives


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
