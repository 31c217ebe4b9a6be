"""Kernels of Gaussian processes as columns over rows: how something unknown may depend on a condition.

Independent standard normal coefficients of the columns make a random function with the kernel named; its expected
square, averaged over the rows, is 1. Which kernels and length scales are used for which condition:
``diagnosis/discrepancy_processes.py``.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.distance import cdist

from pouring_robot.inference.evidence import eigen
from pouring_robot.mechanism.arrays import FloatArray, evenly_spaced

_NEGLIGIBLE = 1e-3
_MOST_CYCLES, _BETWEEN_CYCLES = 50.0, 0.5
_LANDMARKS = 400
"""Most rows that represent all rows in a kernel (Nyström's method), so that its cost is linear in the rows."""


def standardised(values: FloatArray) -> FloatArray:
    """Return values (n,) or (n, k) with mean 0 and standard deviation 1; constant columns become 0."""
    spread = values.std(axis=0)
    return np.asarray((values - values.mean(axis=0)) / np.where(spread > 1e-12, spread, 1.0))


def _principal(
    points: FloatArray, kernel: Callable[[FloatArray, FloatArray], FloatArray], most: int, *, centred: bool = False
) -> FloatArray:
    """Return the principal columns of a random function of points (n, d) with a kernel.

    Williams & Seeger, Using the Nyström method to speed up kernel machines, NIPS 13, 2001.
    """
    step = -(-len(points) // _LANDMARKS)
    marks = points[np.lexsort(points.T[::-1])][step // 2 :: step]
    inner, across = kernel(marks, marks), kernel(points, marks)
    if centred:
        across -= across.mean(axis=1, keepdims=True)
        across -= inner.mean(axis=0) - inner.mean()
        inner = inner - inner.mean(axis=0) - inner.mean(axis=1, keepdims=True) + inner.mean()
    squared, axes = eigen(inner)
    squared, axes = squared[::-1][:most], axes[:, ::-1][:, :most]
    kept = squared > _NEGLIGIBLE * squared[0]
    columns = across @ axes[:, kept] / np.sqrt(squared[kept])
    size = np.sqrt((columns**2).sum() / len(columns))
    return np.asarray(columns / size)


def smooth(values: FloatArray, length: ArrayLike, most: int = 40) -> FloatArray:
    """Return columns of a squared-exponential kernel of ``values`` (n,) or (n, k), with length scales (k,)."""
    scaled = values.reshape(len(values), -1) / np.asarray(length)

    def kernel(one: FloatArray, other: FloatArray) -> FloatArray:
        values: FloatArray = cdist(one, other, "sqeuclidean")
        values *= -0.5
        return np.exp(values, out=values)

    return _principal(scaled, kernel, most)


def wandering(values: FloatArray, most: int = 25) -> FloatArray:
    """Return columns of a random walk along ``values`` (n,), zero on average: for drifts and steps."""
    spread = float(np.ptp(values))
    place = (values - values.min()) / spread if spread > 0.0 else np.zeros(len(values))
    return _principal(place[:, None], lambda one, other: np.minimum(one, other.T), most, centred=True)


def cycling(values: FloatArray) -> dict[tuple[float, float], FloatArray]:
    """Return columns of waves along ``values`` (n,) whose amplitude and phase drift, by the range of periods of each.

    A wave has at least two cycles, four rows a cycle on average, and at least one cycle resolved by rows that are no
    further apart than half a period. Otherwise a difference from day to day would be a wave, too. The drift makes up
    for the periods between those tried: of one halfway it leaves a hundredth of its square.
    """
    different = np.unique(values)
    apart, spread, most = np.diff(different), float(np.ptp(values)), min(len(different) / 4.0, _MOST_CYCLES)
    place, found = values - values.mean(), {}
    for cycles in np.arange(2.0, most, _BETWEEN_CYCLES).tolist():
        period = spread / cycles
        if apart[apart <= 0.5 * period].sum() < period:
            continue
        turn = 2.0 * np.pi * place / period
        wave = np.column_stack([np.cos(turn), np.sin(turn)])
        columns = np.hstack([wave, wave * (place / np.abs(place).max())[:, None]])
        periods = spread / (cycles + 0.5 * _BETWEEN_CYCLES), spread / (cycles - 0.5 * _BETWEEN_CYCLES)
        found[periods] = columns / np.sqrt((columns**2).sum() / len(columns))
    return found


def separate(labels: NDArray[np.int64]) -> FloatArray:
    """Return a column for each different label; labels (n,) or (n, k), equal rows are the same label."""
    _, place = np.unique(labels, axis=0, return_inverse=True)
    return np.asarray(np.eye(int(place.max()) + 1)[place.reshape(-1)])


def row_by_row(count: int, most: int) -> scipy.sparse.csc_array:
    """Return a column for each of ``count`` rows, at most ``most`` of them, evenly spread: of many, some suffice."""
    chosen = evenly_spaced(count, most)
    shape = (count, len(chosen))
    return scipy.sparse.csc_array((np.ones(len(chosen)), (chosen, np.arange(len(chosen)))), shape=shape)
