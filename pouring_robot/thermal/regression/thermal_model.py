"""A regression's result as a file: the displacement by heat at a pose, from the melt's temperature alone.

    format: pouring_robot/thermal_model/1
    source: error_sets.csv
    temperature_degC: 1150.0                  # T0
    melt_degC: [600.0, 1700.0]                # where it was fitted
    inputs: [x, y, z]                         # of the pose, m (tilt: rad); none for lines of temperature alone
    centre: [-0.1, 0.0, -0.6]                 # p0
    ranges: {x: [-0.4, 0.2], tilt: [0.17, 0.17]}     # of the poses it was fitted to, those of no influence, too
    axes:
      z: {method: pose, coefficients: [[…], […]]}      # C of ErrorLine, m, per K in the second row

The error along each axis is :class:`ErrorLine`'s.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal, Self

import numpy as np
import pydantic

from pouring_robot.exceptions import BadInputError, TableError
from pouring_robot.io.files import write_whole
from pouring_robot.io.temperatures import ZERO_CELSIUS_K
from pouring_robot.io.typed_yaml import Range, StrictModel, read_yaml, validate
from pouring_robot.io.units import MM
from pouring_robot.mechanism.arrays import FloatArray, rms
from pouring_robot.thermal.regression.table import ErrorTable

AXES = ("x", "y", "z")
_SAME = 1e-9  # degC, m or rad: smaller is rounding
_SHOWN = {"melt": (1.0, "degC"), **dict.fromkeys(AXES, (MM, "mm")), "tilt": (math.pi / 180.0, "deg")}
POSE_INPUTS = {"x": "m", "y": "m", "z": "m", "tilt": "rad"}
"""Inputs that a pose of the pouring robot has, and their units; a model with other inputs is for Python only."""


@dataclass(frozen=True, eq=False)
class Positions:
    """The positions where the sets of a table were measured."""

    names: tuple[str, ...]  # of the inputs, such as ``x``
    units: tuple[str, ...]  # ``m`` or ``rad`` of each
    values: FloatArray  # shape (k, f), in m and rad, one row per set
    # lowest and highest value of every known input, in m and rad, including constant ones
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def rows(self, kept: Sequence[int]) -> Self:
        """Return the positions of some of the sets."""
        return replace(self, values=self.values[kept])


@dataclass(frozen=True, eq=False)
class ErrorLine:
    r"""An error that is linear in temperature, with offset and slope linear in the pose.

    .. math:: e(T, p) = (1,\; T - T_0)\; C\; (1,\; p - p_0)^T
    """

    # C, shape (2, 1 + f), in m or rad, per K in the second row, per unit of the input after the first column
    coefficients: FloatArray
    temperature_K: float  # T_0
    centre: FloatArray  # p_0, shape (f,), in m and rad; empty where the line does not depend on the pose

    @classmethod
    def straight(cls, intercept: float, slope: float, temperature_K: float) -> Self:
        """Return a line for all poses: ``intercept`` at 0 K, ``slope`` per K."""
        return cls(np.array([[intercept + slope * temperature_K], [slope]]), temperature_K, np.zeros(0))

    @classmethod
    def of_pose(cls, table: ErrorTable, positions: Positions) -> Self:
        """Fit offset and slope over the poses by least squares; raises TableError for too few sets for the inputs."""
        count, inputs = positions.values.shape
        if count < inputs + 2:
            raise TableError(table.source, f"a line over {inputs} inputs takes {inputs + 2} sets or more, not {count}")
        middle, centre = float(table.temperatures_K.mean()), positions.values.mean(axis=0)
        steps, about = _with_ones(table.temperatures_K - middle), _with_ones(positions.values - centre)
        rows = np.einsum("ta,kb->tkab", steps, about).reshape(table.errors.size, -1)
        found = np.linalg.lstsq(rows, table.errors.ravel(), rcond=None)[0]
        return cls(found.reshape(2, inputs + 1), middle, centre)

    def predict(self, temperatures_K: FloatArray, positions: FloatArray | None = None) -> FloatArray:
        """Return the error at temperatures (n,) and poses (k, f), shape (n, k); a line for all poses gives (n, 1)."""
        steps = _with_ones(temperatures_K - self.temperature_K)
        if not self.centre.size or positions is None:
            return np.asarray(steps @ self.coefficients[:, :1])
        return np.asarray(steps @ self.coefficients @ _with_ones(positions - self.centre).T)


def _with_ones(columns: FloatArray) -> FloatArray:
    return np.column_stack([np.ones(len(columns)), columns])


@dataclass(frozen=True)
class ResidualStatistics:
    """Statistics of a prediction's residuals, in m or rad: mean, sample standard deviation and RMS."""

    mean: float
    spread: float
    rms: float

    @classmethod
    def of(cls, residuals: FloatArray) -> Self:
        """Compute them from residuals of any shape."""
        return cls(float(residuals.mean()), float(residuals.std(ddof=1)), rms(residuals))


class AxisModel(StrictModel):
    """The line of one axis: its method, and C, in m, per K in the second row, per m or rad of the inputs."""

    method: str
    coefficients: tuple[tuple[float, ...], tuple[float, ...]]


class ThermalModel(StrictModel):
    """The displacement of the end frame by heat.

    Keys as in the file; ``melt_degC`` and ``ranges``: lowest and highest temperature of the table it was fitted to, and
    of its poses, m and rad. An axis that is not named has no error. A file that is missing or wrong raises
    DescriptionError, which names file, line and key; a pose without one of the inputs raises BadInputError.
    """

    format: Literal["pouring_robot/thermal_model/1"] = "pouring_robot/thermal_model/1"
    source: str
    temperature_degC: float
    melt_degC: Range
    inputs: tuple[str, ...] = ()
    centre: tuple[float, ...] = ()
    ranges: dict[str, Range] = pydantic.Field(default_factory=dict)
    axes: dict[Literal["x", "y", "z"], AxisModel] = pydantic.Field(min_length=1)

    @pydantic.model_validator(mode="after")
    def _fits(self) -> Self:
        if len(self.centre) != len(self.inputs):
            raise ValueError("centre needs one number for each of the inputs")
        for name, axis in self.axes.items():
            if {len(row) for row in axis.coefficients} not in ({1}, {1 + len(self.inputs)}):
                raise ValueError(
                    f"axes.{name}: rows of coefficients need 1 or {1 + len(self.inputs)} numbers, both alike"
                )
        return self

    @classmethod
    def load(cls, path: Path | str) -> Self:
        """Read a thermal-model file."""
        return validate(cls, read_yaml(Path(path)), Path(path))

    def save(self, path: Path | str, *, overwrite: bool = False) -> Path:
        """Write the file.

        Raises:
            OutputError: it cannot be written, or exists already and ``overwrite`` is not set.
        """
        import yaml

        text = yaml.safe_dump(self.model_dump(mode="json"), sort_keys=False, allow_unicode=True)
        return write_whole(path, text, overwrite=overwrite)

    def displacement_m(self, melt_degC: float, pose: Mapping[str, float]) -> FloatArray:
        """Return the displacement by heat, shape (3,), in m, at a temperature of the melt and a pose.

        ``pose``: the inputs by name, in m and rad; others are ignored.
        """
        missing = [name for name in self.inputs if name not in pose]
        if missing:
            raise BadInputError(f"the thermal model needs {', '.join(missing)}, which this command does not have")
        place = np.array([[pose[name] for name in self.inputs]])
        moved = np.zeros(3)
        for name, axis in self.axes.items():
            centre = np.array(self.centre if len(axis.coefficients[0]) > 1 else ())
            line = ErrorLine(np.array(axis.coefficients), self.temperature_degC + ZERO_CELSIUS_K, centre)
            moved[AXES.index(name)] = line.predict(np.array([melt_degC + ZERO_CELSIUS_K]), place)[0, 0]
        return moved

    def beyond(self, melt_degC: float, pose: Mapping[str, float]) -> list[str]:
        """Return descriptions of the values of a temperature and a pose (m, rad) outside the range of the fit."""
        asked = {"melt": (melt_degC, self.melt_degC)}
        asked |= {name: (pose[name], bounds) for name, bounds in self.ranges.items() if name in pose}
        found = []
        for name, (value, (low, high)) in asked.items():
            if not low - _SAME <= value <= high + _SAME:
                unit, word = _SHOWN.get(name, (1.0, "m or rad"))
                fitted = f"{low / unit:.6g}" + (f" to {high / unit:.6g}" if high > low else "")
                found.append(f"{name} {value / unit:.6g} {word} ({fitted})")
        return found
