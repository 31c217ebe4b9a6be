"""Nominal poses of a campaign's commands, and stacks of poses as plain arrays."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from pouring_robot.mechanism.arrays import BoolArray, FloatArray, Indices
from pouring_robot.mechanism.rotations import rotation_vectors
from pouring_robot.robot.description.drawing import Drawing


@dataclass(frozen=True, eq=False)
class PoseStack:
    """n poses as arrays; rows that have no pose are NaN."""

    position_m: FloatArray  # origins, (n, 3), in m
    rotation: FloatArray  # rotation matrices, (n, 3, 3)

    def __len__(self) -> int:
        return int(self.position_m.shape[0])

    def __getitem__(self, rows: BoolArray | Indices) -> Self:
        return type(self)(self.position_m[rows], self.rotation[rows])

    @property
    def complete(self) -> BoolArray:
        """Which rows hold a whole pose, (n,)."""
        complete = np.isfinite(self.position_m).all(axis=1) & np.isfinite(self.rotation).all(axis=(1, 2))
        return np.asarray(complete, dtype=np.bool_)

    def difference(self, expected: Self) -> FloatArray:
        """Return these poses minus others, (n, 6), in m and rad; NaN where either is missing.

        The rotation part is the rotation vector that turns the expected axes into these; both parts in fixed axes.
        """
        turn = rotation_vectors(self.rotation, since=expected.rotation)
        return np.concatenate([self.position_m - expected.position_m, turn], axis=1)

    def inverse(self) -> Self:
        """Return the inverse of every pose."""
        transposed = np.swapaxes(self.rotation, 1, 2)
        return type(self)(-np.einsum("nij,nj->ni", transposed, self.position_m), transposed)


def nominal_poses(drawing: Drawing, drives: FloatArray) -> PoseStack:
    """Return the pose of the end body in the base of the drawing for drives (n, drives), in m and rad.

    Rows with missing drives, or drives out of reach, are NaN.
    """
    start = drawing.starts(drives)
    return PoseStack(start.position, start.rotation)
