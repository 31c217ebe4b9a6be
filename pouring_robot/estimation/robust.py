"""The robust loss: one slip spoils all three coordinates of a row, so they are judged together."""

import functools
from typing import Literal

import numpy as np
import scipy.special
from numpy.typing import NDArray

from pouring_robot.estimation.instruments import KINDS, kind_of
from pouring_robot.estimation.residuals import WhitenedEquations
from pouring_robot.exceptions import BadInputError
from pouring_robot.mechanism.arrays import FloatArray

Loss = Literal["huber", "soft_l1", "linear"]
_INLIER_SHARE = 0.99


@functools.cache
def _quantiles(share: float) -> FloatArray:
    """Return what chi-square of 1 to 3 freedoms stays below with a probability, (4,); 1 in place of none."""
    # Of scipy.special: importing scipy.stats takes longer than many a calibration.
    return np.array([1.0, *(scipy.special.chdtri(k, 1.0 - share) for k in (1, 2, 3))])


def _blocks(equations: WhitenedEquations) -> tuple[NDArray[np.intp], FloatArray, NDArray[np.intp]]:
    """Return the block of each equation, and of each block its squared size and number of components."""
    blocks = len(KINDS) * equations.rows + kind_of(equations.components)
    length = int(blocks.max()) + 1 if blocks.size else 0
    squared = np.bincount(blocks, equations.residual**2, minlength=length).astype(np.float64)
    return blocks, squared, np.bincount(blocks, minlength=length)


def scatter(equations: WhitenedEquations) -> float:
    """Return the median size of the blocks over what noise makes it, at least 1."""
    _, squared, counts = _blocks(equations)
    median = _quantiles(0.5)
    kept = counts > 0
    return max(1.0, float(np.sqrt(np.median(squared[kept] / median[counts[kept]])))) if kept.any() else 1.0


def robust_terms(equations: WhitenedEquations, loss: Loss, widened: float = 1.0) -> tuple[float, FloatArray]:
    """Return the summed loss, and the weight of each equation, shape (m,).

    Args:
        equations: of a prediction.
        loss: which one.
        widened: factor on the bound up to which the loss is quadratic.

    Raises:
        BadInputError: there is no such loss.
    """
    blocks, squared, counts = _blocks(equations)
    length = counts.size
    bound = widened * np.sqrt(_quantiles(_INLIER_SHARE))[counts]
    size = np.sqrt(squared)
    if loss == "linear":
        cost, weight = squared, np.ones(length)
    elif loss == "huber":
        cost = np.where(size <= bound, squared, 2.0 * bound * size - bound**2)
        weight = bound / np.maximum(size, bound)
    elif loss == "soft_l1":
        root = np.sqrt(1.0 + squared / bound**2)
        cost, weight = 2.0 * bound**2 * (root - 1.0), 1.0 / root
    else:
        raise BadInputError(f"there is no loss '{loss}'; use huber, soft_l1 or linear")
    return float(cost.sum()), weight[blocks]
