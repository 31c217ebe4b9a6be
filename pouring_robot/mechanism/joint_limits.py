"""How joints stand within their limits, and what refuses those beyond."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from pouring_robot.exceptions import UnreachablePoseError
from pouring_robot.mechanism.arrays import BoolArray, FloatArray
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism

ROUND_OFF = 1e-9
"""Joint values are known to this, in m or rad: shorter steps of closures and of Newton are round-off, if they no longer
shrink. What stands beyond a limit by no more stands on it."""
WRITTEN = 1e-6
"""The same of values that somebody rounded and wrote down, in m or rad."""


def in_limits(values: ArrayLike, lower: ArrayLike, upper: ArrayLike, slack: float = ROUND_OFF) -> BoolArray:
    """Return where values stand within limits in their unit, as they broadcast; up to ``slack`` beyond one is on it."""
    given, least, most = map(np.asarray, (values, lower, upper))
    return np.asarray((given >= least - slack) & (given <= most + slack))


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

    @property
    def beyond(self) -> bool:
        """Whether it stands beyond a limit, and by more than round-off."""
        return not in_limits(self.value, self.lower, self.upper)


def _bounded(mechanism: ClosedChainMechanism, names: Iterable[str]) -> dict[str, tuple[float, float]]:
    """Return the limits, in m or rad, of joints among some that a command can carry beyond them.

    None are of joints that have no limits, of locked ones, and of what follows these.
    """
    limits, locked = mechanism.joint_limits(), {*mechanism.loops.locked_joints}
    locked |= {mimic.joint for mimic in mechanism.mimics if mimic.leader in locked}
    return {name: limits[name] for name in names if name in limits and name not in locked}


def joint_reach(mechanism: ClosedChainMechanism, values: Mapping[str, float]) -> tuple[JointReach, ...]:
    """Return how joints of given values (m, rad) stand within their limits, the most limiting first.

    Joints without limits, locked ones and what follows these are left out.
    """
    bounded = _bounded(mechanism, values).items()
    reaches = [JointReach(name, mechanism.unit_of(name), values[name], *edges) for name, edges in bounded]
    return tuple(sorted(reaches, key=lambda reach: reach.relative_margin))


def within_limits(mechanism: ClosedChainMechanism, values: Mapping[str, FloatArray]) -> BoolArray:
    """Return where the joints of :func:`joint_reach`, of values (n,) each in m or rad, are within their limits, (n,).

    Without such joints it is one True for all.
    """
    bounded = _bounded(mechanism, values).items()
    return np.asarray(np.all([in_limits(values[name], *edges) for name, edges in bounded], axis=0))


def refuse_beyond(reaches: Sequence[JointReach]) -> None:
    """Refuse joints beyond their limits; raises UnreachablePoseError, which names the first of them.

    As :func:`joint_reach` sorts them, that is the one furthest beyond as a share of its range.
    """
    if worst := next((reach for reach in reaches if reach.beyond), None):
        raise UnreachablePoseError(worst.joint, worst.value, worst.lower, worst.upper, worst.unit)
