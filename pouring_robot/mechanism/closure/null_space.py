"""Equations of motion that leave some freedoms undetermined: solved in the directions they determine.

A rod between two ball joints can spin freely, without effect on anything else. The Hessian of the closure is singular
then, but the step that closes the loops, and the motion that an error causes, are determined in all other directions.
"""

from dataclasses import dataclass
from typing import Self

import eigenpy
import numpy as np
from numpy.typing import NDArray

from pouring_robot.mechanism.arrays import FloatArray

# Eigenvalues of a Hessian scaled to a unit diagonal that are a smaller share of the largest are round-off of zero.
SINGULAR_RATIO = 1e-13
# A diagonal entry that is a smaller share of the largest is round-off of zero: such a joint moves no loop.
_NO_STIFFNESS = 1e-16


def unit_scale(matrix: FloatArray) -> FloatArray:
    """Return the factors that scale a Hessian to a unit diagonal, shape (n,): m and rad differ by decades."""
    diagonal = np.abs(np.diagonal(matrix))
    largest = diagonal.max(initial=0.0) or 1.0
    return np.asarray(1.0 / np.sqrt(np.maximum(diagonal, _NO_STIFFNESS * largest)))


def is_regular(factors: eigenpy.LLT, matrix: FloatArray) -> bool:
    """Return whether a Cholesky factorisation succeeded and no pivot of it is round-off of zero."""
    if factors.info() != eigenpy.ComputationInfo.Success:
        return False
    pivots = np.diagonal(factors.matrixL())
    return bool((pivots * pivots > SINGULAR_RATIO * np.diagonal(matrix)).all())


@dataclass(frozen=True)
class Spectrum:
    """Eigenvalues of a symmetric matrix scaled to a unit diagonal, and the directions they determine."""

    scale: FloatArray  # factors of the scaling, shape (n,)
    values: FloatArray  # eigenvalues, rising, shape (n,)
    vectors: FloatArray  # one a column, shape (n, n)

    @classmethod
    def of(cls, matrix: FloatArray) -> Self:
        """Decompose a symmetric matrix, shape (n, n)."""
        scale = unit_scale(matrix)
        # By QR steps: NumPy's divide and conquer ends without an answer for some of many eigenvalues near zero. Of what
        # is not finite all is NaN, at which a closure ends.
        found = eigenpy.SelfAdjointEigenSolver(matrix * scale[:, None] * scale)
        return cls(scale, found.eigenvalues(), found.eigenvectors())

    @property
    def ratio(self) -> float:
        """Smallest over largest eigenvalue."""
        return float(self.values[0] / self.values[-1]) if self.values[-1] > 0.0 else 0.0

    @property
    def is_semidefinite(self) -> bool:
        """Whether no eigenvalue is negative by more than round-off."""
        return bool(self.values[0] >= -SINGULAR_RATIO * self.values[-1])

    @property
    def _determined(self) -> NDArray[np.bool_]:
        return np.asarray(np.abs(self.values) > SINGULAR_RATIO * np.abs(self.values).max())

    def solve(self, right_side: FloatArray) -> FloatArray:
        """Return the solution of least length (scaled) in the determined directions; right sides (n,) or (n, m)."""
        kept = self._determined
        vectors = self.scale[:, None] * self.vectors[:, kept]
        return np.asarray((vectors / self.values[kept]) @ (vectors.T @ right_side))

    def left_out(self, right_side: FloatArray) -> FloatArray:
        """Return how much of each right side (n, m) is outside the range of any solution, shape (m,).

        The unit is what a unit motion (m or rad) of the stiffest freedom causes.
        """
        scaled = self.scale.min() * self.scale[:, None] * right_side
        return np.asarray(np.linalg.norm(self.vectors[:, ~self._determined].T @ scaled, axis=0))

    @property
    def idle(self) -> FloatArray:
        """Undetermined directions, unit vectors (m and rad), shape (n, k)."""
        directions = self.scale[:, None] * self.vectors[:, ~self._determined]
        return np.asarray(directions / np.linalg.norm(directions, axis=0))
