"""Statistics of ranks, without ``scipy.stats``: importing that takes longer than many a diagnosis."""

import numpy as np
from scipy.special import ndtr

from pouring_robot.mechanism.arrays import FloatArray


def ranks(values: FloatArray) -> FloatArray:
    """Return the rank of each value from 1, (n,); equal ones share the mean of theirs."""
    _, which, counts = np.unique(values, return_inverse=True, return_counts=True)
    last = np.cumsum(counts)
    return np.asarray((last - 0.5 * (counts - 1))[which])


def rank_correlation(first: FloatArray, second: FloatArray) -> float:
    """Return Spearman's rank correlation of two courses (n,)."""
    return float(np.corrcoef(ranks(first), ranks(second))[0, 1])


def larger(these: FloatArray, others: FloatArray) -> float:
    """Return the p-value that some values are larger than others by chance alone: Mann and Whitney's, one-sided.

    By the normal distribution, corrected for ties and continuity; of few values it is too careful in the tail, as their
    sum of ranks is bounded (Mann & Whitney, Annals of Mathematical Statistics 18, 1947).
    """
    m, n = len(these), len(others)
    every = np.concatenate([these, others])
    won = ranks(every)[:m].sum() - 0.5 * m * (m + 1)
    _, ties = np.unique(every, return_counts=True)
    spread = m * n / 12.0 * (m + n + 1 - float((ties**3 - ties).sum()) / ((m + n) * (m + n - 1)))
    return float(ndtr((0.5 * m * n + 0.5 - won) / np.sqrt(spread))) if spread > 0.0 else 1.0
