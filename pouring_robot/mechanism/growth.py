"""Large errors that grow in steps: of several assembly modes the one that grows out of the drawing's is found."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from pouring_robot.mechanism.closed_chain import ClosedChainMechanism


def largest_turn(mechanism: ClosedChainMechanism) -> float:
    """Return the largest angle of a mechanism's errors, in rad."""
    return max((float(np.linalg.norm(pin.log3(pose.rotation))) for pose in mechanism.errors.values()), default=0.0)


def grown(mechanism: ClosedChainMechanism, share: float) -> ClosedChainMechanism:
    """Return a mechanism with a share of all errors: of the way and of the angle."""
    return mechanism.displaced(
        {
            name: pose.inverse() * pin.SE3(pin.exp3(share * pin.log3(pose.rotation)), share * pose.translation)
            for name, pose in mechanism.errors.items()
        }
    )
