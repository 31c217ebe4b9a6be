"""Margins of joints to their limits, and refusal of joints beyond."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from pouring_robot.exceptions import UnreachablePoseError
from pouring_robot.mechanism.arrays import BoolArray, FloatArray
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism

ROUND_OFF = 1e-9
"""Accuracy of joint values, in m or rad: shorter steps of closures and of Newton are round-off, if they no longer
shrink. A value beyond a limit by no more counts as on it."""
WRITTEN = 1e-6
"""The same for values that were rounded and written to a file, in m or rad."""


def in_limits(values: ArrayLike, lower: ArrayLike, upper: ArrayLike, slack: float = ROUND_OFF) -> BoolArray:
    """Return where values are within limits in their unit, as they broadcast; up to ``slack`` beyond one is on it."""
    given, least, most = map(np.asarray, (values, lower, upper))
    return np.asarray((given >= least - slack) & (given <= most + slack))


@dataclass(frozen=True)
class JointReach:
    """Value, limits and margin of one joint at a pose."""

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
        """Whether it is beyond a limit by more than round-off."""
        return not in_limits(self.value, self.lower, self.upper)


def _bounded(mechanism: ClosedChainMechanism, names: Iterable[str]) -> dict[str, tuple[float, float]]:
    """Return the limits, in m or rad, of those of the joints that a command can move beyond them.

    Joints without limits, locked ones and those that follow locked ones are left out.
    """
    limits, locked = mechanism.joint_limits(), {*mechanism.loops.locked_joints}
    locked |= {mimic.joint for mimic in mechanism.mimics if mimic.leader in locked}
    return {name: limits[name] for name in names if name in limits and name not in locked}


def joint_reach(mechanism: ClosedChainMechanism, values: Mapping[str, float]) -> tuple[JointReach, ...]:
    """Return the margins of joints of given values (m, rad) to their limits, the most limiting first.

    Joints without limits, locked ones and those that follow locked ones are left out.
    """
    bounded = _bounded(mechanism, values).items()
    reaches = [JointReach(name, mechanism.unit_of(name), values[name], *edges) for name, edges in bounded]
    return tuple(sorted(reaches, key=lambda reach: reach.relative_margin))


def within_limits(mechanism: ClosedChainMechanism, values: Mapping[str, FloatArray]) -> BoolArray:
    """Return where the joints of :func:`joint_reach`, of values (n,) each in m or rad, are within their limits, (n,).

    Without such joints it is a single True.
    """
    bounded = _bounded(mechanism, values).items()
    return np.asarray(np.all([in_limits(values[name], *edges) for name, edges in bounded], axis=0))


def refuse_beyond(reaches: Sequence[JointReach]) -> None:
    """Refuse joints beyond their limits; raises UnreachablePoseError, which names the first of them.

    In the order of :func:`joint_reach`, that is the one furthest beyond as a share of its range.
    """
    if worst := next((reach for reach in reaches if reach.beyond), None):
        raise UnreachablePoseError(worst.joint, worst.value, worst.lower, worst.upper, worst.unit)
