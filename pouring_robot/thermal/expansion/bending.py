"""A leg that is hotter on one side bends: how far, and when that matters.

The temperature difference ΔT over the diameter D gives the curvature κ = α ΔT / D, the hot side outside. Between its
two U joints the leg bows; the joints follow freely, so the ladle notices three things only: the leg's chord is shorter
by ∫∫ κ² (second order, below a micrometre), the lower end is turned against the chord, and of these turns the one
about y at leg 4 counts in full, because the tilt drive θ46 sits between that end and the platform.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.thermal.network.field import TemperatureField


@dataclass(frozen=True, eq=False)
class LegBending:
    """Estimated bending of the four legs."""

    bow_m: FloatArray  # largest distance from the chord, ends free to turn: κ l²/8 where κ is even; shape (4,)
    # turn of the lower end against the chord, rotation vector in the fixed platform, shape (4, 3)
    end_rotation_rad: FloatArray

    @classmethod
    def of(cls, field: TemperatureField) -> LegBending:
        """Estimate it from the gradient across the leg elements."""
        weights, depth, lengths = field.between_joints, field.exposure.from_upper_joint_m, field.exposure.lengths_m
        # The tangent turns towards the cold side.
        turning = -field.properties.steel.expansion.value * field.gradient_K_per_m
        total = np.einsum("le,lek->lk", weights, turning)
        lever = np.einsum("le,lek->lk", weights * depth, turning)
        bow = np.linalg.norm(total, axis=1) * lengths / 8.0
        return cls(bow, np.cross(field.leg_directions, lever / lengths[:, None]))

    @property
    def tilt_error_rad(self) -> float:
        """Turn of leg 4's lower end about y: acts as an offset of the tilt drive θ46."""
        return float(self.end_rotation_rad[3, 1])

    def matters(self, lever_m: float, accuracy_m: float) -> bool:
        """Return whether the tilt error moves a point ``lever_m`` from the tilt axis by a tenth of the accuracy."""
        return abs(self.tilt_error_rad) * lever_m > 0.1 * accuracy_m
