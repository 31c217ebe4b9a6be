"""A regression's result as a file: what heat adds to a pose, from the melt's temperature alone.

    format: pouring_robot/thermal_model/1
    source: error_sets.csv
    temperature_degC: 1150.0                  # T0
    melt_degC: [600.0, 1700.0]                # where it was fitted
    inputs: [x, y, z]                         # of the pose, m (tilt: rad); none for lines of temperature alone
    centre: [-0.1, 0.0, -0.6]                 # p0
    axes:
      z: {method: pose, coefficients: [[…], […]]}      # C of ErrorLine, m, per K in the second row

The error along each axis is :class:`~pouring_robot.thermal.regression.error_line.ErrorLine`'s.
"""

# ruff: noqa: N815 - units keep their capitals
from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Literal

import numpy as np
import pydantic

from pouring_robot.exceptions import BadInputError, ThermalFileError
from pouring_robot.io.files import write_whole
from pouring_robot.io.temperatures import ZERO_CELSIUS_K
from pouring_robot.io.typed_yaml import StrictModel, read_yaml, validate
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.thermal.regression.error_line import ErrorLine

AXES = ("x", "y", "z")


class AxisModel(StrictModel):
    """The line of one axis: how it was found, and C, in m, per K in the second row, per m or rad of the inputs."""

    method: str
    coefficients: tuple[tuple[float, ...], tuple[float, ...]]


class ThermalModel(StrictModel):
    """What heat adds to the position of the end frame.

    Keys as in the file; ``melt_degC``: lowest and highest temperature of the table it was fitted to. An axis that is
    not named is taken for free of error.
    """

    format: Literal["pouring_robot/thermal_model/1"] = "pouring_robot/thermal_model/1"
    source: str
    temperature_degC: float
    melt_degC: tuple[float, float]
    inputs: tuple[str, ...] = ()
    centre: tuple[float, ...] = ()
    axes: dict[Literal["x", "y", "z"], AxisModel] = pydantic.Field(min_length=1)

    @pydantic.model_validator(mode="after")
    def _fits(self) -> ThermalModel:
        if len(self.centre) != len(self.inputs):
            raise ValueError("centre needs one number for each of the inputs")
        for name, axis in self.axes.items():
            if any(len(row) not in (1, 1 + len(self.inputs)) for row in axis.coefficients):
                raise ValueError(f"axes.{name}: rows of coefficients need 1 or {1 + len(self.inputs)} numbers")
        return self

    @classmethod
    def load(cls, path: Path | str) -> ThermalModel:
        """Read a thermal-model file.

        Raises:
            ThermalFileError: it is missing or wrong; names file, line and key.
        """
        return validate(cls, read_yaml(Path(path), ThermalFileError), Path(path), ThermalFileError)

    def save(self, path: Path | str) -> Path:
        """Write the file.

        Raises:
            OutputError: it cannot be written.
        """
        import yaml

        return write_whole(path, yaml.safe_dump(self.model_dump(mode="json"), sort_keys=False, allow_unicode=True))

    def displacement_m(self, melt_degC: float, pose: Mapping[str, float]) -> FloatArray:
        """Return what heat adds to the position, shape (3,), in m, at a temperature of the melt and a pose.

        ``pose``: the inputs by name, in m and rad; others are not looked at.

        Raises:
            BadInputError: an input is missing.
        """
        missing = [name for name in self.inputs if name not in pose]
        if missing:
            raise BadInputError(f"the thermal model needs {', '.join(missing)}, which this command has not")
        place = np.array([[pose[name] for name in self.inputs]])
        moved = np.zeros(3)
        for name, axis in self.axes.items():
            centre = np.array(self.centre if len(axis.coefficients[0]) > 1 else ())
            line = ErrorLine(np.array(axis.coefficients), self.temperature_degC + ZERO_CELSIUS_K, centre)
            moved[AXES.index(name)] = line.predict(np.array([melt_degC + ZERO_CELSIUS_K]), place)[0, 0]
        return moved

    def beyond(self, melt_degC: float) -> bool:
        """Return whether a temperature lies outside those that the model was fitted to."""
        low, high = self.melt_degC
        return not low - 1e-9 <= melt_degC <= high + 1e-9
