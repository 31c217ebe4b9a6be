r"""Which of many possible measurements best distinguish explanations. Nothing here knows the robot.

Every explanation, fitted to the existing data, predicts each possible measurement with a mean and a covariance. A set
of measurements is valued, for a pair of explanations, by the expected growth of their log evidence difference, averaged
over which of the two is right (Box & Hill, Technometrics 9, 1967; with equal covariances this is the T-criterion of
Atkinson & Fedorov, Biometrika 62, 1975):

.. math:: \tfrac12 \left( D(p_1 \| p_2) + D(p_2 \| p_1) \right), \quad
   D(p_1 \| p_2) = \tfrac12 [\mathrm{tr}\, C_2^{-1} (C_1 + d d^T) - k + \ln |C_2| / |C_1|]

Sets grow by one measurement at a time. What the next one adds has a closed form, from its distributions given the ones
before and the second moment of the difference of their means.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pouring_robot.mechanism.arrays import FloatArray, Indices


@dataclass(frozen=True, eq=False)
class Prediction:
    """An explanation's prediction of n possible measurements of k components each, over the noise."""

    mean: FloatArray  # shape (n * k,)
    covariance: FloatArray  # of prediction plus noise, shape (n * k, n * k)


@dataclass(frozen=True, eq=False)
class ChosenMeasurements:
    """Measurements that were chosen."""

    chosen: Indices  # their indices, in the order they were chosen
    # expected growth of each pair's log evidence difference through each of them, (count, pairs), in nats
    gains: FloatArray


class _Expected:
    """One explanation's covariance of all measurements, given those already made."""

    def __init__(self, covariance: FloatArray) -> None:
        self.covariance = covariance.copy()

    def by(self, place: slice) -> FloatArray:
        """Return the regression coefficients of all others on the measurement at a place, (n * k, k)."""
        return np.asarray(np.linalg.solve(self.covariance[place, place], self.covariance[place]).T)

    def add(self, place: slice) -> None:
        """Take a measurement as made."""
        self.covariance -= self.by(place) @ self.covariance[place]
        _settle(self.covariance, place, 1.0)


class _Direction:
    """One explanation assumed to be right and another one compared with it, while measurements are added."""

    def __init__(self, right: _Expected, other: _Expected, apart: FloatArray, components: int) -> None:
        self._right, self._other, self._k = right, other, components
        self._apart = np.outer(apart, apart)  # second moment of the difference of the means

    def gains(self) -> FloatArray:
        """Return the expected log evidence from each measurement if it is the next, shape (n,)."""
        moments = self._right.covariance, self._other.covariance, self._apart
        return _divergence(*(_blocks(m, self._k) for m in moments))

    def add(self, place: slice) -> None:
        """Take a measurement as made, before the two explanations do."""
        spread, by_other = self._right.covariance[place, place], self._other.by(place)
        # The means change with the measured value, whose distribution is that of the right explanation.
        moved = by_other @ self._apart[place]
        own = by_other @ self._apart[place, place] @ by_other.T
        differ = self._right.by(place) - by_other
        self._apart += own - moved - moved.T + differ @ spread @ differ.T
        _settle(self._apart, place, 0.0)


def _settle(matrix: FloatArray, place: slice, left: float) -> None:
    """Make the measurement at a place independent of all others, as nothing more can be learnt from it."""
    matrix[place], matrix[:, place] = 0.0, 0.0
    matrix[place, place] = left * np.eye(place.stop - place.start)


def _blocks(matrix: FloatArray, k: int) -> FloatArray:
    """Return the square blocks of size k on the diagonal, (n, k, k)."""
    n = len(matrix) // k
    return np.asarray(matrix.reshape(n, k, n, k)[np.arange(n), :, np.arange(n), :])


def total(gains: FloatArray) -> FloatArray:
    """Return how well all pairs are distinguished together: a geometric mean of (..., pairs), in nats.

    One is added before and subtracted after it, so that a pair that no measurement separates does not hide the others.
    """
    return np.asarray(np.expm1(np.log1p(np.maximum(gains, 0.0)).mean(axis=-1)))


def choose(
    predictions: Sequence[Prediction], pairs: Sequence[tuple[int, int]], components: int, count: int
) -> ChosenMeasurements:
    """Choose ``count`` of n possible measurements one by one; none is chosen twice.

    Each explanation has a prediction of all n; ``pairs`` are explanations that should be distinguished.
    """
    both_ways = [way for a, b in pairs for way in ((a, b), (b, a))]
    every = [_Expected(one.covariance) for one in predictions]
    directions = [
        _Direction(every[right], every[other], predictions[right].mean - predictions[other].mean, components)
        for right, other in both_ways
    ]
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
        place = slice(components * best, components * (best + 1))
        for direction in directions:
            direction.add(place)
        for one in every:
            one.add(place)
    return ChosenMeasurements(np.array(chosen, dtype=np.intp), np.array(gains).reshape(-1, len(pairs)))


def expected(
    predictions: Sequence[Prediction], pairs: Sequence[tuple[int, int]], components: int, chosen: Indices
) -> FloatArray:
    """Return the expected log evidence from a whole set of measurements for each pair, shape (pairs,), in nats."""
    places = (components * chosen[:, None] + np.arange(components)).ravel()
    parts = [Prediction(p.mean[places], p.covariance[np.ix_(places, places)]) for p in predictions]
    return np.array([0.5 * (divergence(parts[a], parts[b]) + divergence(parts[b], parts[a])) for a, b in pairs])


def divergence(right: Prediction, other: Prediction) -> float:
    """Return the expected log evidence for the right explanation against another one, in nats."""
    apart = right.mean - other.mean
    return float(_divergence(right.covariance, other.covariance, np.outer(apart, apart)))


def _divergence(right: FloatArray, other: FloatArray, apart: FloatArray) -> FloatArray:
    """Return :func:`divergence`, (...), from covariances and second moment of the means' difference, (..., k, k)."""
    size = np.trace(np.linalg.solve(other, right + apart), axis1=-2, axis2=-1)
    return np.asarray(0.5 * (size - right.shape[-1] + np.linalg.slogdet(other)[1] - np.linalg.slogdet(right)[1]))
