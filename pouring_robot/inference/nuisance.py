"""What always free unknowns (frames, constants) can explain: taken out of everything before anything is compared."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from pouring_robot.mechanism.arrays import FloatArray

_RANK = 1e-10
_TALL = 3


def unit(columns: FloatArray) -> FloatArray:
    """Return columns (m, k) scaled to length 1, those of length 0 left out."""
    size = np.linalg.norm(columns, axis=0)
    return np.asarray(columns[:, size > 0.0] / size[size > 0.0])


def basis(columns: FloatArray, least: float = _RANK) -> FloatArray:
    """Return orthonormal columns (m, r) of the same span as columns (m, k).

    Args:
        columns: scaled so that ``least`` means something.
        least: how long a column must be without those before it to count.
    """
    if not columns.shape[1]:
        return columns
    if len(columns) > _TALL * columns.shape[1]:  # pivoting is slow on many rows; it may as well follow on the triangle
        axes, triangle = scipy.linalg.qr(columns, mode="economic", check_finite=False)
        return np.asarray(axes @ basis(triangle, least))
    axes, triangle, _ = scipy.linalg.qr(columns, mode="economic", pivoting=True, check_finite=False)
    return np.asarray(axes[:, np.abs(np.diag(triangle)) > least])


@dataclass(frozen=True, eq=False)
class Nuisance:
    """The span of nuisance parameters' columns."""

    axes: FloatArray  # orthonormal, shape (m, f)

    @classmethod
    def of(cls, columns: FloatArray, rank: float = _RANK) -> Nuisance:
        """Return the span of columns (m, k) of any scales; what is longer than ``rank`` of the longest axis counts."""
        axes, values, _ = np.linalg.svd(unit(columns), full_matrices=False)
        return cls(axes[:, values > rank * values.max(initial=0.0)])

    @property
    def dof(self) -> int:
        """Degrees of freedom f that it takes up."""
        return int(self.axes.shape[1])

    def cleared(self, values: FloatArray) -> FloatArray:
        """Return vectors (m,) or (m, k) without what the nuisance parameters explain."""
        return np.asarray(values - self.axes @ (self.axes.T @ values))
