"""From temperatures to local parameters of the pouring robot's model: longer legs, larger platforms.

A leg that is warmer than the drawing's temperature by ΔT(s) is longer by ∫ α ΔT ds. With the drive's own offset the
convention is: leg length = (commanded + offset) · (1 + α · mean rise). Platforms expand about their origins, so that
each U-joint centre moves outwards by α ΔT times its position vector.

The expansion of a driven leg moves the robot; that of a passive leg is absorbed by its joint and moves nothing.
Measured temperatures can replace computed ones, part by part.

This expansion is computed from the melt. Expansion by a campaign's thermometers, for any robot, is an effect in
``effects/families/growth.py``; ``twice_lines`` in ``cli/poses/heat.py`` warns if both are used at once.

A leg that is hotter on one side bends; this is estimated separately: see :class:`LegBending`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
import pinocchio as pin

from pouring_robot.exceptions import BadInputError, closest
from pouring_robot.io.temperatures import kelvin
from pouring_robot.mechanism.arrays import FloatArray, finite
from pouring_robot.robot.pouring.kinematics import FourUPUKinematics
from pouring_robot.robot.pouring.names import CHAINS, STROKES
from pouring_robot.robot.pouring.thermal_properties import PARTS, ThermalProperties
from pouring_robot.thermal.network.temperature_field import TemperatureField


def growth_of_drives(strain: FloatArray, drives: Sequence[str]) -> FloatArray:
    """Return the ratio of warm to cold length of each drive, (n, drives), from strains that begin with the legs'."""
    legs = [STROKES.index(name) if name in STROKES else -1 for name in drives]
    return np.stack([1.0 + strain[:, k] if k >= 0 else np.ones(len(strain)) for k in legs], axis=1)


@dataclass(frozen=True)
class ThermalExpansion:
    """Thermal expansion of every part, as strain: legs 1 to 4 from joint to joint, both platforms.

    Another number of legs, and values that are not finite, raise BadInputError.
    """

    leg_strain: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    platform_strain: float = 0.0
    fixed_platform_strain: float = 0.0

    def __post_init__(self) -> None:
        said = "strains are finite growths per length: four of the legs, one of each platform"
        object.__setattr__(self, "leg_strain", tuple(finite(self.leg_strain, (len(CHAINS),), said).tolist()))
        finite((self.platform_strain, self.fixed_platform_strain), (2,), said)

    @classmethod
    def from_field(cls, field: TemperatureField, measured_degC: Mapping[str, float] | None = None) -> Self:
        """Make it from computed temperatures, replaced by measured means of parts; see :meth:`from_temperatures`."""
        return cls.from_temperatures(field.properties, field.mean_degC | dict(measured_degC or {}))

    @classmethod
    def from_temperatures(cls, properties: ThermalProperties, degC: Mapping[str, float]) -> Self:
        """Make it from mean temperatures by part (:data:`PARTS`); parts left out are at the drawing's temperature.

        An unknown part raises BadInputError, a temperature below absolute zero or not finite TemperatureError.
        """
        strain = dict.fromkeys(PARTS, 0.0)
        for part, value in degC.items():
            if part not in strain:
                raise BadInputError(f"there is no part '{part}' that expands{closest(part, PARTS)}")
            kelvin(value, part)  # refuses impossible temperatures
            strain[part] = properties.strain(float(value))
        one, two, three, four = (strain[f"leg{i}"] for i in CHAINS)
        return cls((one, two, three, four), strain["platform"], strain["fixed_platform"])

    def placements(self, kinematics: FourUPUKinematics) -> dict[str, pin.SE3]:
        """Return the displacements by heat of the drawing's joints, by name: of the U-joint centres."""
        mechanism, errors = kinematics.mechanism, {}
        data = mechanism.frames_at(mechanism.neutral_configuration())
        for k, i in enumerate(CHAINS):
            for joint, base, growth in (
                (f"leg{i}_s1", "fixed_platform", self.fixed_platform_strain * kinematics.fixed_centres_m[k]),
                (f"leg{i}_seat_mount", "moving_platform", self.platform_strain * kinematics.moving_centres_m[k]),
            ):
                placement = mechanism.pose_world_to_placement(data, joint)
                errors[joint] = pin.SE3(
                    np.eye(3), placement.rotation.T @ data.oMf[mechanism.frame_id(base)].rotation @ growth
                )
        return errors


@dataclass(frozen=True, eq=False)
class LegBending:
    """Estimated bending of the four legs, which the closure leaves out.

    The temperature difference ΔT over the diameter D gives the curvature κ = α ΔT / D, with the hot side outside. The
    leg bows between its two U joints, which follow freely. So only three things affect the ladle: the leg's chord is
    shorter by ∫∫ κ² (second order, below a micrometre), the lower end is rotated against the chord, and of these
    rotations the one about y at leg 4 counts, because the tilt drive θ46 is between that end and the platform. How far
    the platform then tilts depends on the other legs and follows from G of that drive.
    """

    bow_m: FloatArray  # largest distance from the chord, ends free to rotate: κ l²/8 for constant κ; shape (4,)
    # rotation of the lower end against the chord, rotation vector in the fixed platform, shape (4, 3)
    end_rotation_rad: FloatArray

    @classmethod
    def of(cls, field: TemperatureField) -> Self:
        """Estimate it from the gradient across the leg elements."""
        weights, depth, lengths = field.between_joints, field.exposure.from_upper_joint_m, field.exposure.lengths_m
        # The tangent rotates towards the cold side.
        turning = -field.properties.steel.expansion.value * field.gradient_K_per_m
        total = np.einsum("le,lek->lk", weights, turning)
        lever = np.einsum("le,lek->lk", weights * depth, turning)
        bow = np.linalg.norm(total, axis=1) * lengths / 8.0
        return cls(bow, np.cross(field.leg_directions, lever / lengths[:, None]))

    @property
    def tilt_drive_offset_rad(self) -> float:
        """Rotation of leg 4's lower end about y, which acts as an offset of the tilt drive θ46."""
        return float(self.end_rotation_rad[3, 1])
