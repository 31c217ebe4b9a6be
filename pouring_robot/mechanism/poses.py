"""Differences of poses, and poses of bodies as figures."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
import pinocchio as pin

from pouring_robot.io.argument_checks import expect
from pouring_robot.io.units import MM, MRAD
from pouring_robot.mechanism.arrays import FloatArray, ReadOnly


@dataclass(frozen=True, eq=False)
class PoseDifference(ReadOnly):
    """Difference of an actual frame from its nominal pose, in the axes of the base."""

    translation_m: FloatArray  # actual minus nominal origin, shape (3,), in m
    rotation_rad: FloatArray  # rotation vector that turns the nominal axes into the actual ones, shape (3,), in rad

    @classmethod
    def between(cls, nominal: pin.SE3, actual: pin.SE3) -> Self:
        """Compare two poses of one frame in the same base."""
        for pose in (nominal, actual):
            expect(pose, pin.SE3, "a pose is a pinocchio.SE3")
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
    """Return the poses of a model's joints in the world, shape (k, joints, 4, 4), for k configurations (nq,)."""
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
