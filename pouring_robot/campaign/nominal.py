"""Nominal poses of a campaign's commands, and stacks of poses as plain arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pouring_robot.exceptions import BadInputError, NoSolutionError
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.rotations import rotation_vectors
from pouring_robot.robot.pouring.kinematics import FourUPUKinematics
from pouring_robot.robot.pouring.names import DRIVE_JOINTS


@dataclass(frozen=True, eq=False)
class PoseStack:
    """n poses as arrays; rows that have no pose are NaN.

    Attributes:
        position_m: (n, 3) origins, in m.
        rotation: (n, 3, 3) rotation matrices.
    """

    position_m: FloatArray
    rotation: FloatArray

    def __len__(self) -> int:
        """Return the number of poses."""
        return int(self.position_m.shape[0])

    @property
    def complete(self) -> NDArray[np.bool_]:
        """Which rows hold a whole pose, (n,)."""
        complete = np.isfinite(self.position_m).all(axis=1) & np.isfinite(self.rotation).all(axis=(1, 2))
        return np.asarray(complete, dtype=np.bool_)

    def difference(self, expected: PoseStack) -> FloatArray:
        """Return these poses minus others, (n, 6), in m and rad; NaN where either is missing.

        The rotation part is the rotation vector that turns the expected axes into these; both parts in fixed axes.
        """
        turn = rotation_vectors(self.rotation @ np.swapaxes(expected.rotation, 1, 2))
        return np.concatenate([self.position_m - expected.position_m, turn], axis=1)

    def inverse(self) -> PoseStack:
        """Return the inverse of every pose."""
        transposed = np.swapaxes(self.rotation, 1, 2)
        return PoseStack(-np.einsum("nij,nj->ni", transposed, self.position_m), transposed)


def planar_poses(position_m: FloatArray, tilt_rad: FloatArray) -> PoseStack:
    """Return poses turned about y only: positions (n, 3) in m, tilts (n,) in rad."""
    cos, sin = np.cos(tilt_rad), np.sin(tilt_rad)
    rotation = np.zeros((tilt_rad.size, 3, 3))
    rotation[:, 0, 0] = rotation[:, 2, 2] = cos
    rotation[:, 0, 2], rotation[:, 2, 0] = sin, -sin
    rotation[:, 1, 1] = 1.0
    rotation[~np.isfinite(tilt_rad)] = np.nan
    return PoseStack(np.array(position_m), rotation)


def nominal_poses(kinematics: FourUPUKinematics, drives: FloatArray) -> PoseStack:
    """Return the pose moving platform → fixed platform of the drawing for drives (n, 4) in m and rad.

    Rows with missing drives, or drives that no pose has, are NaN.
    """
    rows = drives.shape[0]
    position, tilt = np.full((rows, 3), np.nan), np.full(rows, np.nan)
    for row in np.flatnonzero(np.isfinite(drives).all(axis=1)):
        try:
            pose = kinematics.forward(dict(zip(DRIVE_JOINTS, drives[row].tolist(), strict=True)))
        except (NoSolutionError, BadInputError):
            continue
        position[row], tilt[row] = pose.position_m, pose.tilt_rad
    return planar_poses(position, tilt)
