r"""Which of many possible measurements best tell explanations apart. Nothing here knows the robot.

Every explanation, fitted to the data there are, predicts each possible measurement with a mean and a covariance. What a
set of measurements is worth between two explanations is the growth of their log evidence difference that one must
expect, averaged over which of both is right (Box & Hill, Technometrics 9, 1967; with equal covariances this is the
T-criterion of Atkinson & Fedorov, Biometrika 62, 1975):

.. math:: \tfrac12 \left( D(p_1 \| p_2) + D(p_2 \| p_1) \right), \quad
   D(p_1 \| p_2) = \tfrac12 [\mathrm{tr}\, C_2^{-1} (C_1 + d d^T) - k + \ln |C_2| / |C_1|]

Sets grow one measurement at a time. What the next one adds is known in closed form: its distributions given the ones
before, and the second moment of the difference of their means.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pouring_robot.mechanism.arrays import FloatArray, Indices


@dataclass(frozen=True, eq=False)
class Prediction:
    """What an explanation predicts of n possible measurements of k components each, over the noise."""

    mean: FloatArray  # shape (n * k,)
    covariance: FloatArray  # of the prediction and the noise, shape (n * k, n * k)


@dataclass(frozen=True, eq=False)
class Choice:
    """Measurements that were chosen."""

    chosen: Indices  # their indices, in the order they were chosen
    # expected growth of the evidence difference between each pair by each of them, (count, pairs), in nats
    gains: FloatArray


class _Direction:
    """One explanation taken as right and another one compared with it, while measurements are added."""

    def __init__(self, right: Prediction, other: Prediction, components: int) -> None:
        self._k = components
        self._right, self._other = right.covariance.copy(), other.covariance.copy()
        apart = right.mean - other.mean
        self._apart = np.outer(apart, apart)

    def gains(self) -> FloatArray:
        """Return the expected evidence of each measurement next, shape (n,)."""
        return _divergence(*(_blocks(m, self._k) for m in (self._right, self._other, self._apart)))

    def add(self, index: int) -> None:
        """Take a measurement as made."""
        place = slice(self._k * index, self._k * (index + 1))
        spread = self._right[place, place]
        by_right = np.linalg.solve(spread, self._right[place]).T
        by_other = np.linalg.solve(self._other[place, place], self._other[place]).T
        # The means move with what is measured, which is random where the right explanation is right.
        moved = by_other @ self._apart[place]
        own = by_other @ self._apart[place, place] @ by_other.T
        differ = by_right - by_other
        self._apart += own - moved - moved.T + differ @ spread @ differ.T
        self._right -= by_right @ self._right[place]
        self._other -= by_other @ self._other[place]
        for matrix, left in ((self._right, 1.0), (self._other, 1.0), (self._apart, 0.0)):
            matrix[place], matrix[:, place] = 0.0, 0.0  # nothing is left to be learnt from the same noise
            matrix[place, place] = left * np.eye(self._k)


def _blocks(matrix: FloatArray, k: int) -> FloatArray:
    """Return the square blocks of size k on the diagonal, (n, k, k)."""
    n = len(matrix) // k
    return np.asarray(matrix.reshape(n, k, n, k)[np.arange(n), :, np.arange(n), :])


def total(gains: FloatArray) -> FloatArray:
    """Return how far all pairs come apart together: a geometric mean of (..., pairs), in nats.

    One is added before and taken away after it, so that a pair no measurement can tell apart does not hide the others.
    """
    return np.asarray(np.expm1(np.log1p(np.maximum(gains, 0.0)).mean(axis=-1)))


def choose(predictions: Sequence[Prediction], pairs: Sequence[tuple[int, int]], components: int, count: int) -> Choice:
    """Choose so many of n possible measurements, of k components each, one by one; none is chosen twice.

    Each explanation has a prediction of all n; pairs are explanations that are to be told apart.
    """
    both_ways = [way for a, b in pairs for way in ((a, b), (b, a))]
    directions = [_Direction(predictions[right], predictions[other], components) for right, other in both_ways]
    sums = np.zeros(len(pairs))
    chosen: list[int] = []
    gains: list[FloatArray] = []
    n = len(predictions[0].mean) // components
    for _ in range(min(count, n)):
        found = np.column_stack([one.gains() for one in directions]).reshape(n, len(pairs), 2).mean(axis=2)
        worth = total(sums + found)
        worth[chosen] = -np.inf
        best = int(np.argmax(worth))
        chosen.append(best)
        gains.append(found[best])
        sums = sums + found[best]
        for one in directions:
            one.add(best)
    return Choice(np.array(chosen, dtype=np.intp), np.array(gains).reshape(-1, len(pairs)))


def expected(
    predictions: Sequence[Prediction], pairs: Sequence[tuple[int, int]], components: int, chosen: Indices
) -> FloatArray:
    """Return what a whole set of measurements is worth between each pair, shape (pairs,), in nats."""
    places = (components * chosen[:, None] + np.arange(components)).ravel()
    parts = [Prediction(p.mean[places], p.covariance[np.ix_(places, places)]) for p in predictions]
    return np.array([0.5 * (divergence(parts[a], parts[b]) + divergence(parts[b], parts[a])) for a, b in pairs])


def divergence(right: Prediction, other: Prediction) -> float:
    """Return the expected log evidence for the right explanation against another one, in nats."""
    apart = right.mean - other.mean
    return float(_divergence(right.covariance, other.covariance, np.outer(apart, apart)))


def _divergence(right: FloatArray, other: FloatArray, apart: FloatArray) -> FloatArray:
    """Return it, (...), by covariances and the second moment of the difference of the means, (..., k, k) each."""
    size = np.trace(np.linalg.solve(other, right + apart), axis1=-2, axis2=-1)
    return np.asarray(0.5 * (size - right.shape[-1] + np.linalg.slogdet(other)[1] - np.linalg.slogdet(right)[1]))
