"""95 % intervals, of normal values, in figures and as text: those of a calibration and those of a diagnosis.

Where standard deviations come from: of all unknowns of a calibration, ``inflated_covariance`` of a
:class:`~pouring_robot.estimation.map_fit.Fit`; of the ladle, that carried to the lip
(:func:`~pouring_robot.calibration.metrics.ladle_uncertainty`); of effects, ``Diagnoser.parameters_of``
(:mod:`pouring_robot.diagnosis.diagnoser`).
"""

import math

Z95 = 1.959963984540054
"""Half the 95 % interval of a normal value in standard deviations: its quantile of 0.975."""


class Estimate:
    """What is a value with its standard deviation, both in the unit it is shown in."""

    value: float
    std: float

    @property
    def half_width(self) -> float:
        """Half of the 95 % interval."""
        return Z95 * self.std

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval."""
        return self.value - self.half_width, self.value + self.half_width

    @property
    def moved(self) -> bool:
        """Whether the 95 % interval leaves out zero."""
        return abs(self.value) > self.half_width


def value_and_half_width(value: float, std: float) -> tuple[str, str]:
    """Return a value and its 95 % half width as text, two digits of the latter."""
    half = Z95 * std
    digits = 1 - math.floor(math.log10(half)) if half > 0.0 else 3
    digits = min(max(digits, 0), 6)
    return f"{value:+.{digits}f}", f"{half:.{digits}f}"
