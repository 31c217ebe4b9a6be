"""Local parameters: the common concept of geometric errors, heat, calibration and diagnosis.

A local parameter is a number that changes the mechanism at one place. Every effect is a combination of them, and the
error-transfer matrix (:mod:`pouring_robot.mechanism.transfer`) maps them all to the ladle in the same way.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
import pinocchio as pin

from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism

COMPONENTS = ("tx", "ty", "tz", "rx", "ry", "rz")
"""Components of a placement error: translation in m, rotation vector in rad, in the joint's own placement."""

Twist = tuple[float, float, float, float, float, float]


@dataclass(frozen=True)
class PlacementParameter:
    """Displaces the placement of one joint, fixed or moving, before the joint's own motion."""

    name: str  # ``<joint>.<component>``, such as ``elbow.tx``.
    unit: str  # ``m`` or ``rad``
    joint: str  # the URDF joint that is displaced
    twist: Twist  # displacement per unit, (linear, angular) in the joint's present placement, m and rad


@dataclass(frozen=True)
class _OfDrive:
    kind: ClassVar[str]
    joint: str  # the driven joint
    unit: str

    @property
    def name(self) -> str:
        """Kind and joint, such as ``drive.elbow``."""
        return f"{self.kind}.{self.joint}"


class DriveParameter(_OfDrive):
    """Error of a commanded drive value, in ``m`` or ``rad``: the drive's value is command plus error."""

    kind = "drive"


class StiffnessParameter(_OfDrive):
    """Stiffness of a yielding drive, in ``N/m`` or ``Nm/rad``."""

    kind = "stiffness"


@dataclass(frozen=True)
class PayloadParameter:
    """Mass of the payload, in kg, at the place given in the loads."""

    name: str = "payload"
    unit: str = "kg"


@dataclass(frozen=True)
class FrameParameter:
    """Displaces a whole frame: the mechanism's base, or the observed frame on the end body, in its own axes."""

    side: Literal["base", "tool"]  # ``base`` or ``tool``
    component: str  # one of :data:`COMPONENTS`

    @property
    def name(self) -> str:
        """Such as ``base.tx``."""
        return f"{self.side}.{self.component}"

    @property
    def unit(self) -> str:
        """Unit of the component."""
        return component_unit(self.component)


GeometricParameter = PlacementParameter | DriveParameter
"""Parameters that shift or turn something inside the mechanism: calibration identifies them, sweeps draw them."""
LocalParameter = GeometricParameter | StiffnessParameter | PayloadParameter | FrameParameter


def component_unit(component: str) -> str:
    """Return the unit of one of :data:`COMPONENTS`."""
    return "m" if component.startswith("t") else "rad"


def unit_twist(component: str) -> FloatArray:
    """Return the unit twist of one of :data:`COMPONENTS`; shape (6,)."""
    return np.asarray(np.eye(6)[COMPONENTS.index(component)])


def placements(joints: Iterable[str], errors: FloatArray) -> dict[str, pin.SE3]:
    """Return the displacements of joints whose errors, (joints, 6) in m and rad, are not zero, in their placements."""
    pairs = zip(joints, errors, strict=True)
    return {joint: pin.SE3(pin.exp3(error[3:]), error[:3]) for joint, error in pairs if error.any()}


def drive_parameters(mechanism: ClosedChainMechanism) -> tuple[DriveParameter, ...]:
    """Return the error of each drive as a parameter, in the order of the loops file."""
    return tuple(DriveParameter(joint, mechanism.unit_of(joint)) for joint in mechanism.loops.drives)


def placement_parameters(joints: Iterable[str]) -> tuple[PlacementParameter, ...]:
    """Return all six components of the placement error of each joint, in the order of :data:`COMPONENTS`."""
    return tuple(
        PlacementParameter(f"{joint}.{c}", component_unit(c), joint, tuple(unit_twist(c).tolist()))
        for joint in joints
        for c in COMPONENTS
    )
