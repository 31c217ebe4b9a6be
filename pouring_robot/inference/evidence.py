r"""Evidence for a group of columns: how much better data are explained if their coefficients may differ from zero.

Whitened residuals r are Gaussian with covariance :math:`I + \sum_k s_k^2 \Phi_k \Phi_k^T`: each group k of columns
counts with independent coefficients, of the standard deviations that scale its columns, times one unknown scale s_k.
The log evidence of a group against its absence, given the others, is in closed form for any s (d, p: squared singular
values of the group's columns seen through the others, and squared projections of the residual):

.. math:: \tfrac12 \sum_i \frac{p_i s^2 d_i}{1 + s^2 d_i} - \ln(1 + s^2 d_i)

and is averaged over scales spread evenly in their logarithm, so that a group pays for columns it does not need
(Rasmussen & Williams, Gaussian Processes for Machine Learning, 2006, ch. 5; MacKay, Neural Computation 4, 1992).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from scipy.special import logsumexp

from pouring_robot.mechanism.arrays import FloatArray

LOG_SCALES: FloatArray = np.linspace(np.log(1e-2), np.log(1e1), 28)
"""Scales that evidence is averaged over: from a hundredth to ten times what an effect's own units call usual."""
_NEGLIGIBLE = 1e-10


@dataclass(frozen=True)
class BayesFactor:
    """What a group of columns is worth.

    Attributes:
        evidence: log evidence against leaving it out, averaged over scales, in nats.
        scale: the most probable scale.
        peak: log evidence at that scale.
    """

    evidence: float
    scale: float
    peak: float


class Others:
    """Everything else in the model: the covariance :math:`C = I + A A^T`, and inner products through its inverse.

    With the QR decomposition of A stacked on the unit matrix, :math:`C^{-1} = I - Q_1 Q_1^T`, without loss of digits
    where columns are large.

    Args:
        columns: groups that make up A, each of shape (m, k), scaled by the standard deviations of their coefficients.
        rows: m, for the case of no group.
    """

    def __init__(self, columns: Sequence[FloatArray], rows: int) -> None:
        """Decompose."""
        stacked = np.hstack([np.zeros((rows, 0)), *columns])
        count = stacked.shape[1]
        axes, triangle = scipy.linalg.qr(np.vstack([stacked, np.eye(count)]), mode="economic", check_finite=False)
        self._axes, self._below = axes[:rows], axes[rows:]
        self.log_determinant = 2.0 * float(np.log(np.abs(np.diag(triangle))).sum())

    def inner(self, left: FloatArray, right: FloatArray) -> FloatArray:
        """Return leftᵀ C⁻¹ right for columns (m, k) or vectors (m,)."""
        z, w = self._axes.T @ left, self._axes.T @ right
        return np.asarray(
            (left - self._axes @ z).T @ (right - self._axes @ w) + (self._below @ z).T @ (self._below @ w)
        )

    def solve(self, values: FloatArray) -> FloatArray:
        """Return C⁻¹ values."""
        return np.asarray(values - self._axes @ (self._axes.T @ values))


def bayes_factor(columns: FloatArray, residual: FloatArray, others: Others, largest: float = np.inf) -> BayesFactor:
    """Return what a group of columns is worth beside everything else.

    Args:
        columns: shape (m, k).
        residual: shape (m,).
        others: everything else in the model.
        largest: scales beyond this are not possible.
    """
    squared, axes = np.linalg.eigh(others.inner(columns, columns))
    kept = squared > _NEGLIGIBLE * max(float(squared[-1]), 1.0)
    if not kept.any():
        return BayesFactor(0.0, float(np.exp(LOG_SCALES[0])), 0.0)  # columns that nothing is left of explain nothing
    squared, axes = squared[kept], axes[:, kept]
    projected = (axes.T @ others.inner(columns, residual)) ** 2 / squared
    log_scales = LOG_SCALES[np.exp(LOG_SCALES) <= largest * (1.0 + 1e-9)]
    variance = np.exp(2.0 * log_scales)[:, None] * squared
    values = 0.5 * (projected * variance / (1.0 + variance) - np.log1p(variance)).sum(axis=1)
    best = int(np.argmax(values))
    evidence = float(logsumexp(values) - np.log(log_scales.size))
    return BayesFactor(evidence, float(np.exp(log_scales[best])), float(values[best]))


def posterior(columns: FloatArray, residual: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return mean (k,) and covariance (k, k) of coefficients with the prior N(0, I), with unit noise.

    Args:
        columns: shape (m, k), scaled by the standard deviations of the coefficients.
        residual: shape (m,).
    """
    precision = columns.T @ columns + np.eye(columns.shape[1])
    factor = scipy.linalg.cho_factor(precision)
    mean = scipy.linalg.cho_solve(factor, columns.T @ residual)
    return np.asarray(mean), np.asarray(scipy.linalg.cho_solve(factor, np.eye(len(precision))))
