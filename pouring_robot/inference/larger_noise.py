r"""How likely what is left is where the noise is another: of all that is measured, or of one kind alone.

Beside free columns, of which nothing is known, and columns whose coefficients have standard deviation 1, V both, the
noise of some equations S is f times as large. The precision of the coefficients is then

.. math:: V^T V + \mathrm{diag}(0, 1) - t V_S^T V_S, \qquad t = 1 - f^{-2},

which is diagonal for every f in the generalised eigenvectors of its last product and all of it at f = 1. The density is
that of a linear model across what is free (restricted likelihood: Searle, Casella & McCulloch, Variance components,
1992, ch. 6), and all factors together cost little more than one.
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
    """A noise that is larger than it is said to be."""

    kind: int | None  # of which kind of measurement alone, by its label; None: of all alike
    factor: float  # how many times as large it is, at its most probable
    evidence: float  # log evidence against the noise as it is said to be, averaged over factors, in nats


class OtherNoise:
    """How likely a residual is where the noise of some equations is another."""

    def __init__(self, every: Gram, some: Gram, free: int, equations: int) -> None:
        """Take inner products of columns, so many free ones first, and residual: of all equations and of so many."""
        precision = every.columns + np.diag(np.arange(len(every.columns)) >= free)
        self._shares, axes = scipy.linalg.eigh(some.columns, precision)
        self._every, self._some = axes.T @ every.projected, axes.T @ some.projected
        self._squared, self._equations = some.squared, equations

    def likelier(self, factors: FloatArray) -> FloatArray:
        """Return the log density where that noise is so many times as large, over that as it is, (n,), in nats."""
        t = (1.0 - factors**-2.0)[:, None]
        left = 1.0 - t * self._shares
        explained = (self._every - t * self._some) ** 2 / left - self._every**2
        gained = t[:, 0] * self._squared + (explained - np.log(left)).sum(axis=1)
        return np.asarray(0.5 * gained - self._equations * np.log(factors))

    def larger(self, kind: int | None, log_prior: float) -> LargerNoise:
        """Return what is said of its being larger, of a kind with such a log probability among those that may be."""
        densities = self.likelier(NOISE_FACTORS)
        return LargerNoise(kind, float(NOISE_FACTORS[np.argmax(densities)]), float(log_mean_exp(densities)) + log_prior)
