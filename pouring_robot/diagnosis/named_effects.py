"""What is named: effects with their parameters, and how sure they are."""

import math
from dataclasses import dataclass

from pouring_robot.effects.base import EffectParameter
from pouring_robot.estimation.intervals import Estimate
from pouring_robot.inference.decision import Cause


@dataclass(frozen=True, eq=False)
class FoundParameter(Estimate):
    """One parameter with its value."""

    parameter: EffectParameter  # what it changes
    value: float  # in its unit
    std: float  # standard deviation, in its unit
    dof: float = math.inf  # degrees of freedom of the standard deviation


FoundByKey = list[tuple[tuple[str, str], tuple[FoundParameter, ...]]]  # parameters by effect and form


def sure_text(probability: float) -> str:
    """Return a probability in percent, from 99 % on with a decimal."""
    # Rounded first, so that a probability just below the largest possible (1 - RATE) is shown as that.
    step = 10 if probability >= 0.99 else 100
    shown = round(1e4 * probability) // step * step / 100
    return "more than 99.9 % sure" if probability > 0.999 else f"{shown:g} % sure"


@dataclass(frozen=True, eq=False, repr=False)
class NamedEffect:
    """A named effect with its parameters."""

    cause: Cause  # what may be said of it
    nearest: bool  # whether it may only stand in for something unknown; its probability is meaningless then
    story: str  # one line for people
    parameters: tuple[FoundParameter, ...]  # main ones first

    def __repr__(self) -> str:
        """Return its id, its form and how sure it is: its parameters hold a number for each row."""
        sure = "may stand in for something unknown" if self.nearest else sure_text(self.cause.probability)
        return f"<NamedEffect: {self.cause.effect}, {self.cause.form}, {sure}>"
