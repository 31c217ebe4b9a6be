"""What the controller of the pouring robot commands: the platform's four degrees of freedom."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Self

import numpy as np
import pinocchio as pin

from pouring_robot.io.argument_checks import expect
from pouring_robot.io.quantity_columns import Quantity
from pouring_robot.io.units import MM
from pouring_robot.mechanism.arrays import finite
from pouring_robot.mechanism.rotations import tilts

PLATFORM_POSE = (*(Quantity(name, "length", required=True) for name in "xyz"), Quantity("tilt", "angle", required=True))
"""The numbers of a pose in a table, each in a column with any unit of its kind."""

POSE_COLUMNS = ("x_mm", "y_mm", "z_mm", "tilt_deg")
"""Their names in mm and degrees, in written tables and printed figures."""


@dataclass(frozen=True)
class PlatformPose:
    """A commanded pose: position and tilt of the moving platform; raises BadInputError if one is not finite."""

    position_m: tuple[float, float, float]  # origin o of the moving platform in the fixed platform O, in m
    tilt_rad: float  # r, rotation about y, in rad

    def __post_init__(self) -> None:
        position = finite(self.position_m, (3,), "the pose's x, y, z must be finite numbers, in m")
        tilt = finite(self.tilt_rad, (), "the pose's tilt must be a finite number, in rad")
        # The input may be an array, which has neither a plain comparison nor a hash.
        object.__setattr__(self, "position_m", tuple(position.tolist()))
        object.__setattr__(self, "tilt_rad", tilt.item())

    @classmethod
    def of_values(cls, values: Iterable[float]) -> Self:
        """Make a pose from x, y, z in m and the tilt in rad, (4,), as in :attr:`values`."""
        x, y, z, tilt = finite(values, (4,), "a command is x, y, z in m and the tilt in rad").tolist()
        return cls((x, y, z), tilt)

    @classmethod
    def from_mm_deg(cls, x_mm: float, y_mm: float, z_mm: float, tilt_deg: float) -> Self:
        """Make a pose from values in mm and degrees."""
        demand = "the pose's x, y, z and tilt must be finite numbers, in mm and degrees"
        *position, tilt = finite((x_mm, y_mm, z_mm, tilt_deg), (4,), demand).tolist()
        x, y, z = (value * MM for value in position)
        return cls((x, y, z), math.radians(tilt))

    @classmethod
    def from_se3(cls, pose_fixed_platform_to_moving_platform: pin.SE3) -> Self:
        """Extract the four degrees of freedom from a full pose: its position, and its tilt about y."""
        expect(pose_fixed_platform_to_moving_platform, pin.SE3, "a full pose is a pinocchio.SE3")
        x, y, z = (float(value) for value in pose_fixed_platform_to_moving_platform.translation)
        return cls((x, y, z), tilts(pose_fixed_platform_to_moving_platform.rotation).item())

    @property
    def values(self) -> tuple[float, float, float, float]:
        """Return x, y, z in m and the tilt in rad."""
        return *self.position_m, self.tilt_rad

    def to_se3(self) -> pin.SE3:
        """Return the pose of the moving platform in the fixed platform."""
        return pin.SE3(pin.utils.rotate("y", self.tilt_rad), np.array(self.position_m))

    def to_mm_deg(self) -> tuple[float, float, float, float]:
        """Return x, y, z in mm and the tilt in degrees."""
        x, y, z = self.position_m
        return x / MM, y / MM, z / MM, math.degrees(self.tilt_rad)

    def figures(self) -> dict[str, float]:
        """Return the same by name."""
        return dict(zip(POSE_COLUMNS, self.to_mm_deg(), strict=True))
