"""Errors of the thermal model; each is one line that says what is wrong and how to mend it."""

from __future__ import annotations

from pouring_robot.exceptions import BadInputError, DescriptionError, NoSolutionError


class ThermalFileError(DescriptionError):
    """The file of thermal properties is wrong."""


class TemperatureError(BadInputError):
    """A temperature lies below absolute zero or is not finite.

    Attributes:
        what: the temperature at fault, such as ``melt``.
        value_degC: the value given.
    """

    def __init__(self, what: str, value_degC: float) -> None:
        """Keep the figure."""
        self.what, self.value_degC = what, value_degC
        super().__init__(
            f"{what}: {value_degC:g} degC is no temperature (absolute zero is -273.15 degC); check value and unit"
        )


class HistoryError(BadInputError):
    """A history of temperatures or poses cannot be followed.

    Attributes:
        problem: what is wrong, on one line.
        row: position of the entry at fault, counted from 1, where one is.
    """

    def __init__(self, problem: str, row: int | None = None) -> None:
        """Name the entry and the problem."""
        self.problem, self.row = problem, row
        super().__init__(f"history{'' if row is None else f', entry {row}'}: {problem}")


class ThermalSolutionError(NoSolutionError):
    """The temperatures cannot be found.

    Attributes:
        problem: why, on one line.
    """

    def __init__(self, problem: str) -> None:
        """Keep the reason."""
        self.problem = problem
        super().__init__(f"no temperatures found: {problem}; check the thermal properties")
