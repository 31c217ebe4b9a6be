"""95 % intervals of normal values, in figures and as text: those of a calibration and those of a diagnosis.

Where standard deviations come from: for all unknowns of a calibration, ``covariances`` of a
:class:`~pouring_robot.estimation.map_fit.Fit`; for the ladle, these propagated to the lip
(:func:`~pouring_robot.calibration.metrics.ladle_uncertainty`); for effects, ``Diagnoser.covariances``
(:mod:`pouring_robot.diagnosis.diagnoser`).
"""

import math
from collections.abc import Iterable

import numpy as np
from scipy.special import ndtr, stdtrit

from pouring_robot.io.figures import two_digits
from pouring_robot.mechanism.arrays import FloatArray

Z95 = 1.959963984540054  # half the 95 % interval of a normal value in standard deviations: its 0.975 quantile


def student(deviations: float, dof: float) -> float:
    """Return the quantile of Student's t with the same probability as a normal value of so many ``deviations``.

    Without any degree of freedom nothing is known about the standard deviation: infinite.
    """
    if math.isinf(dof):
        return deviations
    return float(stdtrit(dof, ndtr(deviations))) if dof > 0.0 else math.inf


def deviations95(dof: float) -> float:
    """Return half the 95 % interval in standard deviations with so many degrees of freedom: Student's t."""
    return student(Z95, dof)


def largest_std(directions: FloatArray, covariances: Iterable[FloatArray]) -> FloatArray:
    """Return the standard deviation of combinations of unknowns, (..., k) to (...), by the larger of some covariances.

    Angrist & Pischke, Mostly harmless econometrics (2009), ch. 8, advise this for a robust covariance besides that of
    the model: an estimate from few blocks is itself uncertain, and may be too small by chance.
    """
    variances = [((directions @ covariance) * directions).sum(axis=-1) for covariance in covariances]
    return np.asarray(np.sqrt(np.maximum(np.max(variances, axis=0), 0.0)))


class Estimate:
    """A value with its standard deviation, both in the unit in which they are shown."""

    value: float
    std: float
    dof: float  # degrees of freedom of the standard deviation; infinite where it is known

    @property
    def half_width(self) -> float:
        """Half of the 95 % interval."""
        return deviations95(self.dof) * self.std

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval."""
        return self.value - self.half_width, self.value + self.half_width

    @property
    def moved(self) -> bool:
        """Whether the 95 % interval excludes zero."""
        return abs(self.value) > self.half_width


def value_and_half_width(value: float, std: float, dof: float) -> tuple[str, str]:
    """Return a value and its 95 % half width as text, with two digits of the latter; ``dof`` are those of ``std``."""
    half = deviations95(dof) * std
    digits = two_digits(half)
    return f"{value:+z.{digits}f}", f"{half:.{digits}f}"
