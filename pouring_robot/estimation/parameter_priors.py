"""What is known of the unknowns before measuring: the tolerances of the parts, and hardly anything of the frames."""

import numpy as np

from pouring_robot.estimation.frames.outer import FRAMES
from pouring_robot.estimation.measurement import MeasurementModel
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.robot.tolerances import Tolerances

FRAME_STD = 0.1
"""Of the outer frames against their first fit, in m and rad: nothing is known of them. Large against what any campaign
leaves open, so that it only picks one answer where several are the same (see the y of target and tracker)."""


_HELD = 1e-9  # m and rad: of frames that nobody measured from


def prior_std(model: MeasurementModel, tolerances: Tolerances, *, framed: bool = True) -> FloatArray:
    """Return the standard deviations of all unknowns, frames first, shape (12 + P,), in m and rad.

    Args:
        model: whose unknowns they are; those of sessions with frames of their own stand last.
        tolerances: of the robot's parts.
        framed: whether anything was measured from outside; if not, the frames are held.
    """
    frames, others = np.full(FRAMES, FRAME_STD if framed else _HELD), np.full(len(model.sessions), FRAME_STD)
    return np.concatenate([frames, tolerances.std(model.parameters, model.model.definition), others])
