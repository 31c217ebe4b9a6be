"""Differences of poses, and how joints stand within their limits."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, Self

import numpy as np
import pinocchio as pin

from pouring_robot.exceptions import UnreachablePoseError
from pouring_robot.io.units import MM, MRAD
from pouring_robot.mechanism.arrays import FloatArray, ReadOnly
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism

ROUND_OFF = 1e-9
"""Joint values are known to this, in m or rad: shorter steps of closures and of Newton are round-off, if they no longer
shrink. What stands beyond a limit by no more stands on it."""


@dataclass(frozen=True, eq=False)
class PoseDifference(ReadOnly):
    """Where the actual frame stands, seen from where it should be; both axes of the fixed platform."""

    translation_m: FloatArray  # actual minus nominal origin, shape (3,), in m
    rotation_rad: FloatArray  # rotation vector that turns the nominal axes into the actual ones, shape (3,), in rad

    @classmethod
    def between(cls, nominal: pin.SE3, actual: pin.SE3) -> Self:
        """Compare two poses of one frame in the same base."""
        rotation = pin.log3(actual.rotation @ nominal.rotation.T)
        return cls(actual.translation - nominal.translation, np.asarray(rotation))

    @property
    def distance_m(self) -> float:
        """Length of the translation, in m."""
        return float(np.linalg.norm(self.translation_m))

    @property
    def angle_rad(self) -> float:
        """Angle of the rotation, in rad."""
        return float(np.linalg.norm(self.rotation_rad))

    def to_mm_mrad(self) -> tuple[FloatArray, FloatArray]:
        """Return the translation in mm and the rotation vector in mrad; shape (3,) each."""
        return self.translation_m / MM, self.rotation_rad / MRAD


def bodies_at(model: pin.Model, configurations: Sequence[FloatArray]) -> FloatArray:
    """Return where the joints of a model stand in the world, shape (k, joints, 4, 4), for k configurations (nq,)."""
    data, places = model.createData(), []
    for configuration in configurations:
        pin.forwardKinematics(model, data, np.array(configuration))
        places.append([pose.homogeneous for pose in data.oMi])
    return np.array(places)


def pose_figures(pose: pin.SE3) -> dict[str, list[float]]:
    """Return a pose for JSON: its origin in mm, its rotation vector in rad."""
    return {
        "translation_mm": (pose.translation / MM).tolist(),
        "rotation_vector_rad": np.asarray(pin.log3(pose.rotation)).tolist(),
    }


@dataclass(frozen=True)
class JointReach:
    """How one joint stands within its limits at a pose."""

    joint: str
    unit: Literal["m", "rad"]  # ``m`` or ``rad``, of the three values
    value: float  # where it stands
    lower: float  # lower limit
    upper: float  # upper limit

    @property
    def margin(self) -> float:
        """Distance to the nearer limit, negative beyond it."""
        return min(self.value - self.lower, self.upper - self.value)

    @property
    def relative_margin(self) -> float:
        """The margin as a share of the joint's range, so that lengths and angles compare."""
        return self.margin / (self.upper - self.lower)

    @property
    def beyond(self) -> bool:
        """Whether it stands beyond a limit, and by more than round-off."""
        return self.margin < -ROUND_OFF

    @property
    def inside(self) -> float:
        """Where it stands, or the limit that it stands beyond."""
        return min(max(self.value, self.lower), self.upper)


def joint_reach(mechanism: ClosedChainMechanism, values: Mapping[str, float]) -> tuple[JointReach, ...]:
    """Return how joints of given values (m, rad) stand within their limits, the most limiting first.

    Joints without limits, locked ones, what follows these, and those that cannot move are left out.
    """
    limits, locked = mechanism.joint_limits(), {*mechanism.loops.locked_joints}
    locked |= {mimic.joint for mimic in mechanism.mimics if mimic.leader in locked}
    moving = [name for name in values if name in limits and name not in locked and limits[name][0] < limits[name][1]]
    reaches = [JointReach(name, mechanism.unit_of(name), values[name], *limits[name]) for name in moving]
    return tuple(sorted(reaches, key=lambda reach: reach.relative_margin))


def refuse_beyond(reaches: Sequence[JointReach]) -> None:
    """Refuse joints beyond their limits; raises UnreachablePoseError, which names the first of them.

    As :func:`joint_reach` sorts them, that is the one furthest beyond as a share of its range.
    """
    if worst := next((reach for reach in reaches if reach.beyond), None):
        raise UnreachablePoseError(worst.joint, worst.value, worst.lower, worst.upper, worst.unit)
