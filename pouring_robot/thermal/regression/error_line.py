"""An error as a line of temperature, and of the pose where that counts; needs nothing but arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pouring_robot.exceptions import TableError
from pouring_robot.mechanism.arrays import FloatArray

if TYPE_CHECKING:
    from pouring_robot.thermal.regression.table import ErrorTable


@dataclass(frozen=True, eq=False)
class Positions:
    """Where the sets of a table were measured."""

    names: tuple[str, ...]  # of the inputs, such as ``x``
    units: tuple[str, ...]  # ``m`` or ``rad`` of each
    values: FloatArray  # shape (k, f), in m and rad, one row a set

    def rows(self, kept: Sequence[int]) -> Positions:
        """Return those of some of the sets."""
        return Positions(self.names, self.units, self.values[kept])


@dataclass(frozen=True, eq=False)
class ErrorLine:
    r"""An error that is linear in temperature, with offset and slope linear in the pose.

    .. math:: e(T, p) = (1,\; T - T_0)\; C\; (1,\; p - p_0)^T
    """

    # C, shape (2, 1 + f), in m or rad, per K in the second row, per unit of the input after the first column
    coefficients: FloatArray
    temperature_K: float  # noqa: N815 - T_0, in kelvin
    centre: FloatArray  # p_0, shape (f,), in m and rad; empty where the pose does not count

    @classmethod
    def straight(cls, intercept: float, slope: float, temperature_K: float) -> ErrorLine:
        """Return a line for all poses: ``intercept`` at 0 K, ``slope`` per K."""
        return cls(np.array([[intercept + slope * temperature_K], [slope]]), temperature_K, np.zeros(0))

    @classmethod
    def of_pose(cls, table: ErrorTable, positions: Positions) -> ErrorLine:
        """Fit offset and slope over the poses by least squares.

        Raises:
            TableError: there are too few sets for the inputs.
        """
        count, inputs = positions.values.shape
        if count < inputs + 2:
            raise TableError(table.source, f"{count} sets are too few for {inputs} inputs; give {inputs + 2} or more")
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
class Remains:
    """What a prediction leaves of errors, in m or rad: mean, sample standard deviation and RMS of all residuals."""

    mean: float
    spread: float
    rms: float

    @classmethod
    def of(cls, residuals: FloatArray) -> Remains:
        """Take them from residuals of any shape."""
        return cls(float(residuals.mean()), float(residuals.std(ddof=1)), float(np.sqrt(np.square(residuals).mean())))
