"""How joints stand within their limits."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from pouring_robot.exceptions import UnreachablePoseError
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism


@dataclass(frozen=True)
class JointReach:
    """How one joint stands within its limits at a pose."""

    joint: str
    unit: Literal["m", "rad"]  # ``m`` or ``rad``, of the three values
    value: float  # where it stands
    lower: float  # lower limit
    upper: float  # upper limit

    @property
    def margin(self) -> float:
        """Distance to the nearer limit, negative beyond it."""
        return min(self.value - self.lower, self.upper - self.value)

    @property
    def relative_margin(self) -> float:
        """The margin as a share of the joint's range, so that lengths and angles compare."""
        return self.margin / (self.upper - self.lower)


def joint_reach(mechanism: ClosedChainMechanism, values: Mapping[str, float]) -> tuple[JointReach, ...]:
    """Return how joints of given values (m, rad) stand within their limits, the most limiting first.

    Joints without limits, locked ones and those that cannot move are left out.
    """
    limits, locked = mechanism.joint_limits(), mechanism.loops.locked_joints
    moving = [name for name in values if name in limits and name not in locked and limits[name][0] < limits[name][1]]
    reaches = [JointReach(name, mechanism.unit_of(name), values[name], *limits[name]) for name in moving]
    return tuple(sorted(reaches, key=lambda reach: reach.relative_margin))


def refuse_beyond(reaches: Sequence[JointReach]) -> None:
    """Refuse joints beyond their limits; raises UnreachablePoseError, which names the one that is furthest."""
    for worst in reaches[:1]:
        if worst.margin < 0.0:
            raise UnreachablePoseError(worst.joint, worst.value, worst.lower, worst.upper, worst.unit)
