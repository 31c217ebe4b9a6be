"""The numbers of a command: drive values, or what the robot's controller computes them from."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pouring_robot.io.quantity_columns import Quantity
from pouring_robot.io.units import joint_shown_in
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.robot.description.drive import Drive

_ROUND_M, _ROUND_RAD = 1e-4, math.radians(1e-2)


@dataclass(frozen=True)
class CommandAxis:
    """One number of a command."""

    quantity: Quantity  # its column in a table
    lower: float  # smallest value, in m or rad; ``upper``: largest value
    upper: float
    drive: Drive | None = None  # the drive that it commands; None: the table has the value itself

    @property
    def _shown(self) -> tuple[str, float]:
        return joint_shown_in("m" if self.quantity.kind == "length" else "rad")

    @property
    def heading(self) -> str:
        """Heading of its column, in mm or degrees."""
        return f"{self.quantity.name}_{self._shown[0]}"

    @property
    def step(self) -> float:
        """Step between round figures of the table (0.1 mm or 0.01 degrees), in m or rad of the value."""
        factor = 1.0 if self.drive is None else abs(self.drive.factor)
        return factor * (_ROUND_M if self.quantity.kind == "length" else _ROUND_RAD)

    def shown(self, value: float) -> float:
        """Return the figure in the table, in mm or degrees, of a value (m or rad)."""
        command = value if self.drive is None else float(self.drive.commanded(np.asarray(value)))
        return command / self._shown[1]

    def value(self, shown: float) -> float:
        """Return the value (m or rad) of a figure in the table."""
        return float(self.values(np.asarray(shown * self._shown[1])))

    def values(self, commands: FloatArray) -> FloatArray:
        """Return the values (m or rad) of commands (SI); same shape."""
        return commands if self.drive is None else self.drive.value(commands)

    def text(self, value: float) -> str:
        """Return a value (m or rad) as a round figure of the table."""
        return f"{self.shown(value):z.{1 if self.quantity.kind == 'length' else 2}f}"


def command_box(axes: Sequence[CommandAxis]) -> tuple[FloatArray, FloatArray]:
    """Return the smallest and largest values of a command, (k,) each, in m and rad."""
    return np.array([axis.lower for axis in axes]), np.array([axis.upper for axis in axes])
