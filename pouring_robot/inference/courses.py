"""Courses: how something unknown may depend on a condition. Columns over rows, the likely ones large.

Independent standard coefficients on the columns make a random function with the kernel named; its expected square,
averaged over the rows, is 1.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray

from pouring_robot.mechanism.arrays import FloatArray

_NEGLIGIBLE = 1e-3
_MANY_TIMES = 12


def standardised(values: FloatArray) -> FloatArray:
    """Return values (n,) or (n, k) with mean 0 and standard deviation 1; constant columns become 0."""
    spread = values.std(axis=0)
    return np.asarray((values - values.mean(axis=0)) / np.where(spread > 1e-12, spread, 1.0))


def _principal(kernel: FloatArray, most: int) -> FloatArray:
    if len(kernel) > _MANY_TIMES * most:
        squared, axes = scipy.linalg.eigh(kernel, subset_by_index=(len(kernel) - most, len(kernel) - 1))
    else:
        squared, axes = np.linalg.eigh(kernel)
    squared, axes = squared[::-1][:most], axes[:, ::-1][:, :most]
    kept = squared > _NEGLIGIBLE * max(float(squared[0]), 1e-300)
    columns = axes[:, kept] * np.sqrt(squared[kept])
    size = np.sqrt((columns**2).sum() / len(columns))
    return np.asarray(columns / size) if size > 0.0 else columns


def smooth(values: FloatArray, length: ArrayLike, most: int = 40) -> FloatArray:
    """Return columns of a smooth function of ``values`` (n,) or (n, k), squared-exponential kernel of a length (k,)."""
    points = values.reshape(len(values), -1)
    squared = (((points[:, None] - points[None]) / np.asarray(length)) ** 2).sum(axis=-1)
    return _principal(np.exp(-0.5 * squared), most)


def wandering(values: FloatArray, most: int = 25) -> FloatArray:
    """Return columns of a random walk along ``values`` (n,), zero on average: what drifts and what steps."""
    spread = float(np.ptp(values))
    place = (values - values.min()) / spread if spread > 0.0 else np.zeros(len(values))
    kernel = np.minimum(place[:, None], place[None])
    kernel = kernel - kernel.mean(axis=0)
    return _principal(kernel - kernel.mean(axis=1, keepdims=True), most)


def separate(labels: NDArray[np.int64]) -> FloatArray:
    """Return a column for each different label; labels (n,) or (n, k), rows alike have the same label."""
    _, place = np.unique(labels, axis=0, return_inverse=True)
    return np.asarray(np.eye(int(place.max()) + 1)[place.reshape(-1)])
