"""Gross errors: single rows that nothing explains while nearly all others are explained better."""

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from pouring_robot.mechanism.arrays import FloatArray

_SIGMAS = 6.5
"""Of a million normal values one is beyond 4.9; this leaves room for tails that are no longer normal."""
_MOST_SHARE, _FEW = 0.04, 2
_CALM = 1.5
_SHARE = 0.9


def calm(left: FloatArray) -> bool:
    """Return whether residuals (m,) in units of the noise are mostly noise, or at most half as much again.

    By their median, which a few wrong rows do not move.
    """
    return float(np.median(np.abs(left)) / ndtri(0.75)) < _CALM


def gross_errors(left: FloatArray, row: NDArray[np.intp], fitted: NDArray[np.bool_], gone: int) -> NDArray[np.intp]:
    """Return the rows that are gross errors; none where they would be too many to be single ones.

    A gross error draws the answer to itself, so that the others may not be explained to their noise before it is left
    out: rows count by what nine tenths of them stay below.

    Args:
        left: what nothing explains of the fitted rows, in units of the noise, (m,).
        row: row of each of these, (m,), of all n.
        fitted: which rows are fitted, (n,).
        gone: how many rows are left out already.
    """
    worst = np.zeros(len(fitted))
    np.maximum.at(worst, row, np.abs(left))
    components = len(left) / fitted.sum()
    # The largest of so many normal values stays below this in nine rows of ten.
    usual = float(ndtri(0.5 + 0.5 * _SHARE ** (1.0 / components)))
    wrong = np.flatnonzero(worst > _SIGMAS * max(1.0, float(np.quantile(worst[fitted], _SHARE)) / usual))
    few = wrong.size + gone <= max(_FEW, int(_MOST_SHARE * len(fitted)))
    return wrong if few else np.zeros(0, dtype=np.intp)
