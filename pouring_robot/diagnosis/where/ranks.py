"""Rank statistics without ``scipy.stats``, whose import takes longer than many a diagnosis."""

import numpy as np
from scipy.special import ndtr

from pouring_robot.mechanism.arrays import FloatArray


def ranks(values: FloatArray) -> FloatArray:
    """Return the rank of each value from 1, (n,); equal values have their mean rank."""
    _, which, counts = np.unique(values, return_inverse=True, return_counts=True)
    last = np.cumsum(counts)
    return np.asarray((last - 0.5 * (counts - 1))[which])


def rank_correlation(first: FloatArray, second: FloatArray) -> float:
    """Return Spearman's rank correlation of two series (n,)."""
    return float(np.corrcoef(ranks(first), ranks(second))[0, 1])


def larger(these: FloatArray, others: FloatArray) -> float:
    """Return the p-value of some values being larger than others: one-sided Mann-Whitney test.

    By the normal approximation, corrected for ties and continuity; for few values it is conservative in the tail, as
    their rank sum is bounded (Mann & Whitney, Annals of Mathematical Statistics 18, 1947).
    """
    m, n = len(these), len(others)
    every = np.concatenate([these, others])
    u = ranks(every)[:m].sum() - 0.5 * m * (m + 1)
    _, ties = np.unique(every, return_counts=True)
    spread = m * n / 12.0 * (m + n + 1 - float((ties**3 - ties).sum()) / ((m + n) * (m + n - 1)))
    return float(ndtr((0.5 * m * n + 0.5 - u) / np.sqrt(spread))) if spread > 0.0 else 1.0
