"""Tolerances: how far a part may be off before it has been measured."""

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
import pydantic

from pouring_robot.io.argument_checks import as_path
from pouring_robot.io.typed_yaml import StrictModel, read_yaml, validate
from pouring_robot.io.units import MM, MRAD
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.local_parameters import DriveParameter, GeometricParameter
from pouring_robot.robot.description.definition import RobotDefinition
from pouring_robot.robot.description.urdf import description_folder


class Tolerance(StrictModel):
    """Size of errors of one kind of parameter."""

    std: Annotated[float, pydantic.Field(gt=0.0, le=100.0)]  # standard deviation, in ``unit``
    unit: Literal["mm", "mrad"]  # mm or mrad
    source: str  # where the figure comes from

    def to_si(self) -> float:
        """Return the standard deviation in m or rad."""
        return self.std * (MM if self.unit == "mm" else MRAD)


def _in(unit: str) -> pydantic.AfterValidator:
    """Return a validator that refuses a tolerance in another unit."""

    def check(tolerance: Tolerance) -> Tolerance:
        if tolerance.unit != unit:
            raise ValueError(f"the unit must be {unit}")
        return tolerance

    return pydantic.AfterValidator(check)


Length = Annotated[Tolerance, _in("mm")]
Angle = Annotated[Tolerance, _in("mrad")]


def _kind(name: str, formerly: str = "") -> Any:
    """Return the field of a kind; a file may leave it out (then the shipped value holds) or use its former name."""
    names = pydantic.AliasChoices(name, formerly or name)
    return pydantic.Field(validation_alias=names, default_factory=lambda: getattr(Tolerances.load().kinds, name))


class TolerancesByKind(StrictModel):
    """A tolerance for each kind of parameter; a robot's own file has only the kinds of its robot."""

    linear_drive_offset: Length = _kind("linear_drive_offset", formerly="leg_drive_offset")  # zero of a drive
    rotary_drive_offset: Angle = _kind("rotary_drive_offset", formerly="tilt_drive_offset")
    joint_centre: Length = _kind("joint_centre")  # position of a joint on the body that carries it
    joint_axis: Angle = _kind("joint_axis")  # direction of an axis
    inner_offset: Length = _kind("inner_offset")  # distances within a chain and its joints, where distinguished


class Tolerances(StrictModel):
    """The tolerances file."""

    format: Literal["pouring_robot/tolerances/1"] = "pouring_robot/tolerances/1"  # kind and version of the file
    kinds: TolerancesByKind  # one tolerance per kind

    @classmethod
    def load(cls, path: Path | str | None = None) -> Self:
        """Read a tolerances file (default: the shipped one); raises DescriptionError where something in it is wrong."""
        path = description_folder() / "config" / "tolerances.yaml" if path is None else as_path(path)
        return validate(cls, read_yaml(path), path)

    @classmethod
    def of(cls, robot: RobotDefinition) -> Self:
        """Return the tolerances of a robot: its own, or the shipped ones; raises DescriptionError like :meth:`load`."""
        return cls.load(robot.tolerances_file)

    def std(self, parameters: Sequence[GeometricParameter], robot: RobotDefinition) -> FloatArray:
        """Return the standard deviations of parameters of a robot, shape (P,), in m and rad."""
        kinds = (kind_of(parameter, robot.inner_joints) for parameter in parameters)
        return np.array([getattr(self.kinds, kind).to_si() for kind in kinds], dtype=float)


def kind_of(parameter: GeometricParameter, inner_joints: Collection[str]) -> str:
    """Return the kind of a parameter, a field of :class:`TolerancesByKind`; a DH error has that of its joint."""
    if isinstance(parameter, DriveParameter):
        return "linear_drive_offset" if parameter.unit == "m" else "rotary_drive_offset"
    if parameter.unit == "rad":
        return "joint_axis"
    return "inner_offset" if parameter.joint in inner_joints else "joint_centre"
