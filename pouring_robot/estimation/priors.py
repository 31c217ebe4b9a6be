"""Tolerances as priors: how far a part may be off before anybody has measured it."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import pydantic

from pouring_robot.estimation.measurement import FRAME_PARAMETERS, CalibrationParameter
from pouring_robot.exceptions import DescriptionError
from pouring_robot.io.typed_yaml import StrictModel, read_yaml, validate
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.parameters import DriveParameter
from pouring_robot.mechanism.poses import MM, MRAD
from pouring_robot.robot.pouring.description import description_folder

Kind = Literal["leg_drive_offset", "tilt_drive_offset", "joint_centre", "joint_axis", "inner_offset"]
FRAME_STD = 0.1
"""Of the outer frames against their first fit, in m and rad: nothing is known of them. Large against what any campaign
leaves open, so that it only picks one answer where several are the same (see the y of target and tracker)."""


class Tolerance(StrictModel):
    """One kind of parameter.

    Attributes:
        std: standard deviation, in ``unit``.
        unit: mm or mrad.
        source: where the figure comes from.
    """

    std: Annotated[float, pydantic.Field(gt=0.0, le=100.0)]
    unit: Literal["mm", "mrad"]
    source: str

    def to_si(self) -> float:
        """Return the standard deviation in m or rad."""
        return self.std * (MM if self.unit == "mm" else MRAD)


class Kinds(StrictModel):
    """A tolerance for each kind of parameter.

    Attributes:
        leg_drive_offset: zero of a leg's drive.
        tilt_drive_offset: zero of the tilt drive.
        joint_centre: place of a U joint on its platform.
        joint_axis: direction of an axis.
        inner_offset: distances inside a leg and its U joints.
    """

    leg_drive_offset: Tolerance
    tilt_drive_offset: Tolerance
    joint_centre: Tolerance
    joint_axis: Tolerance
    inner_offset: Tolerance

    @pydantic.model_validator(mode="after")
    def _units(self) -> Kinds:
        for name, tolerance in self:
            wanted = "mrad" if name in ("tilt_drive_offset", "joint_axis") else "mm"
            if tolerance.unit != wanted:
                raise ValueError(f"the unit of '{name}' must be {wanted}")
        return self


class Tolerances(StrictModel):
    """The tolerances file.

    Attributes:
        format: kind and version of the file.
        kinds: one tolerance a kind.
    """

    format: Literal["pouring_robot/tolerances/1"] = "pouring_robot/tolerances/1"
    kinds: Kinds

    @classmethod
    def load(cls, path: Path | str | None = None) -> Tolerances:
        """Read a tolerances file, by default the shipped one.

        Raises:
            DescriptionError: the file cannot be read, or a key or value in it is wrong.
        """
        return _shipped() if path is None else _read(Path(path))

    def kind_of(self, parameter: CalibrationParameter) -> Kind:
        """Return what kind of error a parameter is."""
        if isinstance(parameter, DriveParameter):
            return "leg_drive_offset" if parameter.unit == "m" else "tilt_drive_offset"
        if parameter.unit == "rad":
            return "joint_axis"
        return "joint_centre" if parameter.joint.endswith(("_s1", "_seat_mount")) else "inner_offset"

    def std(self, parameters: Sequence[CalibrationParameter]) -> FloatArray:
        """Return the standard deviations of parameters, shape (P,), in m and rad."""
        return np.array([getattr(self.kinds, self.kind_of(p)).to_si() for p in parameters], dtype=float)

    def prior(self, parameters: Sequence[CalibrationParameter]) -> FloatArray:
        """Return the standard deviations of all unknowns, frames first, shape (12 + P,), in m and rad."""
        return np.concatenate([np.full(len(FRAME_PARAMETERS), FRAME_STD), self.std(parameters)])


def _read(path: Path) -> Tolerances:
    return validate(Tolerances, read_yaml(path, DescriptionError), path, DescriptionError)


@functools.cache
def _shipped() -> Tolerances:
    return _read(description_folder() / "config" / "tolerances.yaml")
