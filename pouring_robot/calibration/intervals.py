"""What became of a parameter: its value with standard deviation and 95 % interval, and what the data told of it."""

from dataclasses import dataclass

from pouring_robot.mechanism.arrays import Z95

LEARNT = 0.5
"""A parameter is measured when the data took at least this share of its prior variance away."""
SEEN = 0.01
"""Below this share no pose of the campaign shows a parameter by itself."""


@dataclass(frozen=True)
class Movement:
    """A parameter, or a combination that the campaign determines, in mm or mrad, on top of the present model."""

    name: str
    unit: str
    value: float
    std: float
    prior_std: float

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

    @property
    def surprise(self) -> float:
        """How many standard deviations it is off."""
        return abs(self.value) / self.std


@dataclass(frozen=True)
class ParameterLine(Movement):
    """One parameter: the group it was kept with, and the share of its prior variance that the data took away."""

    group: str
    learnt: float

    @property
    def verdict(self) -> str:
        """What to make of it, in words."""
        if self.learnt < LEARNT:
            return "held by its tolerance"
        return "moved" if self.moved else "measured, not off"
