"""Priors of a fit: what is known of parameters and frames before anything is measured."""

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
    """Return the standard deviations of all unknowns before measuring, shape (12 + P,), in m and rad.

    Those of parameters are the tolerances of the robot's parts. Of the frames, of sessions too, hardly anything is
    known; the outer ones are held if nothing was measured from outside (``framed``).
    """
    frames, others = np.full(FRAMES, FRAME_STD if framed else _HELD), np.full(len(model.sessions), FRAME_STD)
    return np.concatenate([frames, tolerances.std(model.parameters, model.model.definition), others])
