"""The robust loss: the weight of rows that are far off, and the size of residuals so weighted under noise alone.

In a fit (:func:`robust_terms`) the coordinates of a row are judged together: one slip spoils all three, and the bound
follows from the noise. Before any fit, where the noise is not known, the scale is that of the residuals themselves
(:func:`~pouring_robot.mechanism.arrays.robust_sigma`, :func:`huber_weights`, :func:`tukey_weights`).
"""

import functools
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy.special

from pouring_robot.estimation.kinds import KINDS, kind_of
from pouring_robot.exceptions import BadInputError
from pouring_robot.mechanism.arrays import FloatArray, Indices

Loss = Literal["huber", "soft_l1", "linear"]
_FIT_INLIER_SHARE = 0.99
"""Share of the blocks that are within the bound of a fit under noise alone; up to it the loss is quadratic."""
PRELIMINARY_HUBER_BOUND, PRELIMINARY_TUKEY_BOUND = 1.5, 4.7
"""Bounds of weights before a fit, for frames and in checks, in robust standard deviations: beyond them the influence of
a value is constant, or zero. For normal values the efficiency relative to least squares is 96 % and 95 % (Huber, Robust
Statistics, 1981, ch. 4 and 7)."""


@dataclass(frozen=True, eq=False)
class Equations:
    """Residuals over their noise."""

    residual: FloatArray  # of each of m equations, (m,)
    rows: Indices  # row of each, (m,)
    components: Indices  # component of each, as :mod:`pouring_robot.estimation.kinds` numbers them, (m,)


def huber_weights(sizes: FloatArray, bound: float | FloatArray = PRELIMINARY_HUBER_BOUND) -> FloatArray:
    """Return Huber's weights of non-negative sizes, same shape: 1 up to the bound, which is in their unit."""
    return np.asarray(bound / np.maximum(sizes, bound))


def tukey_weights(sizes: FloatArray) -> FloatArray:
    """Return Tukey's weights of non-negative sizes, in robust deviations, same shape: 0 from the bound on."""
    return np.where(sizes < PRELIMINARY_TUKEY_BOUND, (1.0 - (sizes / PRELIMINARY_TUKEY_BOUND) ** 2) ** 2, 0.0)


def _quantiles(share: float, counts: Indices) -> FloatArray:
    """Return the quantiles at a ``share`` of chi-square with degrees of freedom (n,), (n,); 1 where these are none."""
    # From scipy.special: importing scipy.stats takes longer than many a calibration.
    return np.array([1.0, *(scipy.special.chdtri(k, 1.0 - share) for k in _sizes(counts))])[counts]


def _sizes(counts: Indices) -> range:
    """Return the numbers of components that blocks, (n,), may have: up to three of a position, any of closures."""
    return range(1, int(counts.max()) + 1)


def _blocks(equations: Equations) -> tuple[Indices, FloatArray, Indices]:
    """Return the block of each equation, and the squared size and number of components of each block."""
    blocks = len(KINDS) * equations.rows + kind_of(equations.components)
    squared = np.bincount(blocks, equations.residual**2).astype(np.float64)
    return blocks, squared, np.bincount(blocks)


def typical_size(equations: Equations) -> float:
    """Return the median size of the blocks over that under noise alone, at least 1."""
    _, squared, counts = _blocks(equations)
    kept = counts > 0
    median = _quantiles(0.5, counts[kept])
    return max(1.0, float(np.sqrt(np.median(squared[kept] / median))))


def robust_terms(equations: Equations, loss: Loss, widened: float = 1.0) -> tuple[float, FloatArray]:
    """Return the summed loss, and the weight of each equation, shape (m,).

    ``widened`` is a factor on the bound up to which the loss is quadratic. Raises BadInputError for an unknown loss.
    """
    blocks, squared, counts = _blocks(equations)
    cost, weight = _weighed(squared, widened * np.sqrt(_quantiles(_FIT_INLIER_SHARE, counts)), loss)
    return float(cost.sum()), weight[blocks]


def noise_shares(equations: Equations, loss: Loss) -> FloatArray:
    """Return the expectation of each equation's squared weighted residual under noise alone, shape (m,); linear: 1.

    Proposal 2 of Huber, Robust Statistics (1981), normalises a scale by this: a slip counts no more than its bound.
    """
    blocks, _, counts = _blocks(equations)
    return np.array([1.0, *(_noise_share(loss, k) for k in _sizes(counts))])[counts][blocks]


@functools.cache
def _noise_share(loss: Loss, components: int) -> float:
    nodes, weights = scipy.special.roots_genlaguerre(64, 0.5 * components - 1.0)  # half a chi-square is a gamma
    bound = np.sqrt(_quantiles(_FIT_INLIER_SHARE, np.full(nodes.size, components)))
    _, weight = _weighed(2.0 * nodes, bound, loss)
    return float((weights * weight**2) @ nodes / (weights @ nodes))


def _weighed(squared: FloatArray, bound: FloatArray, loss: Loss) -> tuple[FloatArray, FloatArray]:
    """Return the loss and the weight of blocks, given their squared sizes."""
    size = np.sqrt(squared)
    if loss == "linear":
        return squared, np.ones_like(squared)
    if loss == "huber":
        return np.where(size <= bound, squared, 2.0 * bound * size - bound**2), huber_weights(size, bound)
    if loss == "soft_l1":
        root = np.sqrt(1.0 + squared / bound**2)
        return 2.0 * bound**2 * (root - 1.0), 1.0 / root
    raise BadInputError(f"there is no loss '{loss}'; use huber, soft_l1 or linear")
