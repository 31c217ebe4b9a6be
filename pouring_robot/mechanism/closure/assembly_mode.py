"""Large errors that grow in steps: of several assembly modes, the one continuous with the drawing's is found."""

from collections.abc import Callable
from typing import Generic, TypeVar

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism

_JUMP, _JUMP_M = 4.0, 1e-3
Made = TypeVar("Made")


def largest_turn(mechanism: ClosedChainMechanism) -> float:
    """Return the largest angle of a mechanism's errors, in rad."""
    return max((float(np.linalg.norm(pin.log3(pose.rotation))) for pose in mechanism.errors.values()), default=0.0)


def grown(mechanism: ClosedChainMechanism, share: float) -> ClosedChainMechanism:
    """Return a mechanism with a share of all errors: of their translations and of their angles."""
    return mechanism.displaced(
        {
            name: pose.inverse() * pin.SE3(pin.exp3(share * pin.log3(pose.rotation)), share * pose.translation)
            for name, pose in mechanism.errors.items()
        }
    )


class Shares(Generic[Made]):
    """Objects made from a mechanism with a share of its errors, by the share; the first ``kept``, coarse ones, stay."""

    def __init__(
        self, mechanism: ClosedChainMechanism, make: Callable[[ClosedChainMechanism], Made], kept: int
    ) -> None:
        self._mechanism, self._make, self._kept, self._made = mechanism, make, kept, dict[float, Made]()

    def __getitem__(self, share: float) -> Made:
        """Return the object made at a share, 0 to 1."""
        made = self._made.get(share) or self._make(grown(self._mechanism, share))
        if len(self._made) < self._kept:
            self._made[share] = made
        return made


def jumps(moved: FloatArray | float, before: FloatArray | float) -> NDArray[np.bool_] | bool:
    """Return whether a step of growth left the mode that the step before it followed; both in m, or arrays of them.

    A mode that ends in a fold approaches its end as the square root of the remaining share: of even steps none is more
    than ``1 + sqrt(2)`` times the one before (the limit leaves a margin, because the square root is only the first
    term). Another mode is further away.
    """
    return (moved > _JUMP * before) & (moved > _JUMP_M)
