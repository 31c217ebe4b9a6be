r"""Likelihood of the residual under a larger noise: of all measurements, or of one kind alone.

V are free columns, of whose coefficients nothing is known, and columns whose coefficients have standard deviation 1.
Where the noise of some equations S is f times as large, the precision of the coefficients is

.. math:: V^T V + \mathrm{diag}(0, 1) - t V_S^T V_S, \qquad t = 1 - f^{-2},

which is diagonal for every f in the generalised eigenvectors of :math:`V_S^T V_S` and the precision at f = 1. The
density is that of a linear model orthogonal to the free columns (restricted likelihood: Searle, Casella & McCulloch,
Variance components, 1992, ch. 6). All factors together cost little more than one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from pouring_robot.inference.evidence import Gram, log_mean_exp
from pouring_robot.inference.priors import NOISE_FACTORS
from pouring_robot.mechanism.arrays import FloatArray


@dataclass(frozen=True)
class LargerNoise:
    """A noise that is larger than stated."""

    kind: int | None  # label of the only kind of measurement that has it; None: all alike
    factor: float  # most probable ratio to the stated noise
    evidence: float  # log evidence against the noise as stated, averaged over factors, in nats


class OtherNoise:
    """Likelihood of a residual where the noise of some equations is different."""

    def __init__(self, every: Gram, some: Gram, free: int, equations: int) -> None:
        """Take inner products of columns (the ``free`` ones first) and residual: over all, and ``some``, equations."""
        precision = every.columns + np.diag(np.arange(len(every.columns)) >= free)
        self._shares, axes = scipy.linalg.eigh(some.columns, precision)
        self._every, self._some = axes.T @ every.projected, axes.T @ some.projected
        self._squared, self._equations = some.squared, equations

    def likelier(self, factors: FloatArray) -> FloatArray:
        """Return the log density with that noise multiplied by each factor, over that with factor 1, (n,), in nats."""
        t = (1.0 - factors**-2.0)[:, None]
        left = 1.0 - t * self._shares
        explained = (self._every - t * self._some) ** 2 / left - self._every**2
        gained = t[:, 0] * self._squared + (explained - np.log(left)).sum(axis=1)
        return np.asarray(0.5 * gained - self._equations * np.log(factors))

    def larger(self, kind: int | None, log_prior: float) -> LargerNoise:
        """Return the larger noise of a kind, given the log prior probability that it is this kind's."""
        densities = self.likelier(NOISE_FACTORS)
        return LargerNoise(kind, float(NOISE_FACTORS[np.argmax(densities)]), float(log_mean_exp(densities)) + log_prior)
