"""What effects do where errors count, such as a pouring lip: figures to show, not to judge by."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from pouring_robot.diagnosis.findings import Findings
from pouring_robot.effects.base import EffectParameter
from pouring_robot.estimation.frames.outer import OuterFrames
from pouring_robot.mechanism.arrays import FloatArray


def moved_at_lip(diagnosis: Findings, parameters: Sequence[EffectParameter]) -> FloatArray:
    """Return by how much some of the fitted parameters move the tool, shape (n, 3), in m.

    In the axes of the base, loops closed exactly with everything found and again without these parameters.
    A constant part counts here, though the frames absorb it in the campaign.
    """
    rows, after = diagnosis.rows, diagnosis.after
    frames = OuterFrames(pin.SE3.Identity(), diagnosis.model.nominal_mechanism().T_end_tool)
    chosen = {id(p) for p in parameters}
    kept = np.array([0.0 if id(p) in chosen else 1.0 for p in after.parameters])
    with_all = rows.predicted(rows.changes(after.parameters, after.values), frames)
    without = rows.predicted(rows.changes(after.parameters, kept * after.values), frames)
    return np.asarray(with_all.position_m - without.position_m)
