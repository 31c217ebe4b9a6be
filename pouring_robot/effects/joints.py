"""Effects of the U joints: centres displaced, axes tilted."""

from __future__ import annotations

import numpy as np

from pouring_robot.effects.base import Effect, EffectParameter, Form
from pouring_robot.effects.conditions import Conditions
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.poses import MM, MRAD
from pouring_robot.robot.pouring.names import CHAIN_JOINTS, LEGS, SEATS
from pouring_robot.robot.tolerances import LEFT_BY_WORKMANSHIP_MM, LEFT_BY_WORKMANSHIP_MRAD, Tolerances

_TILTED = ("xz", "yz", "xy", "yz", "xz")
"""Directions across the axis of each joint of a leg."""


def centre_parameters(one: FloatArray, prior_std_mm: float | None = None) -> dict[str, tuple[EffectParameter, ...]]:
    """Return three parameters for each U-joint centre, by the joint that places it; ``one`` is 1 for every row.

    They are as large as the tolerance of a part that nobody has measured, unless a size is given.
    """
    std_mm = prior_std_mm or Tolerances.load().kinds.joint_centre.std
    return {
        joint: tuple(
            EffectParameter(f"{joint}.t{axis}", "mm", std_mm, {f"{joint}.t{axis}": MM * one}) for axis in "xyz"
        )
        for joint in (*(joints[0] for joints in CHAIN_JOINTS), *SEATS)
    }


def axis_parameters(one: FloatArray, prior_std_mrad: float | None = None) -> dict[str, tuple[EffectParameter, ...]]:
    """Return the tilts of each joint's axis, by joint: only this axis turns, the next joint stays where it was.

    They are as large as the tolerance of a part that nobody has measured, unless a size is given.
    """
    std_mrad = prior_std_mrad or Tolerances.load().kinds.joint_axis.std
    found = {}
    for joints, seat in zip(CHAIN_JOINTS, SEATS, strict=True):
        for name, after, directions in zip(joints, (*joints[1:], seat), _TILTED, strict=True):
            back = 1.0 if after == seat else -1.0  # the seat is placed on the platform, against the chain's direction
            found[name] = tuple(
                EffectParameter(
                    f"{name}.tilt_{axis}",
                    "mrad",
                    std_mrad,
                    {f"{name}.r{axis}": MRAD * one, f"{after}.r{axis}": back * MRAD * one},
                )
                for axis in directions
            )
    return found


class JointCentreOffset(Effect):
    """U-joint centres displaced on either platform."""

    id = "joint_centre_offset"
    story = "U joints sit elsewhere on their platforms than drawn"
    driven_by = "tilt_rad"
    small = 0.035  # mm

    def background(self, rows: int) -> tuple[EffectParameter, ...]:
        """All centres, after adjustment."""
        return tuple(p for found in centre_parameters(np.ones(rows), LEFT_BY_WORKMANSHIP_MM).values() for p in found)

    def forms(self, conditions: Conditions) -> tuple[Form, ...]:
        """All centres, those of one platform, or a single one."""
        by_joint = centre_parameters(np.ones(len(conditions)))
        upper = [p for joint, found in by_joint.items() if joint.endswith("_s1") for p in found]
        lower = [p for joint, found in by_joint.items() if joint.endswith("_seat_mount") for p in found]
        single = (Form(f"{joint}_alone", found) for joint, found in by_joint.items())
        whole = (
            Form("all", (*upper, *lower)),
            Form("fixed_platform", tuple(upper)),
            Form("moving_platform", tuple(lower)),
        )
        return (*whole, *single)


class JointAxisTilt(Effect):
    """U-joint axes tilted, yokes of a leg twisted."""

    id = "joint_axis_tilt"
    story = "axes of the U joints are not parallel as drawn, or the yokes of a leg are twisted"
    driven_by = "tilt_rad"
    small = 0.08  # mrad
    loosened_by_load = True

    def background(self, rows: int) -> tuple[EffectParameter, ...]:
        """All axes, after adjustment."""
        return tuple(p for found in axis_parameters(np.ones(rows), LEFT_BY_WORKMANSHIP_MRAD).values() for p in found)

    def forms(self, conditions: Conditions) -> tuple[Form, ...]:
        """All axes, twisted legs, or bores of the platforms."""
        one = np.ones(len(conditions))
        by_joint = axis_parameters(one)
        every = [p for joint, found in by_joint.items() if not joint.endswith("_s3") for p in found]
        twist = [EffectParameter(f"{leg}_twist", "mrad", 1.0, {f"{leg}_s4.rz": MRAD * one}) for leg in LEGS]
        bores = [p for joint, found in by_joint.items() if joint.endswith(("_s1", "_s5")) for p in found]
        return (Form("all", tuple(every)), Form("twisted_legs", tuple(twist)), Form("bores", tuple(bores)))
