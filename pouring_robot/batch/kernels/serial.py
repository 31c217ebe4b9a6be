"""Compiled: where a serial arm carries its end frame, by forward kinematics."""

from __future__ import annotations

import math

from pouring_robot.batch.kernels.compiler import outermost
from pouring_robot.batch.kernels.loops import sines_cosines
from pouring_robot.batch.kernels.newton import CLOSED, NOT_FINITE
from pouring_robot.batch.kernels.samples import load_drives, place_errors
from pouring_robot.batch.kernels.transfer import branch_end
from pouring_robot.batch.kernels.workspace import Room
from pouring_robot.batch.structure import IntArray, Star
from pouring_robot.mechanism.arrays import FloatArray


@outermost
def carry_samples(
    star: Star,
    room: Room,
    axes: FloatArray,
    first: int,
    last: int,
    drives: FloatArray,
    start_joints: FloatArray,
    errors: FloatArray,
    single_site: IntArray,
    position: FloatArray,
    rotation: FloatArray,
    joints: FloatArray,
    status: IntArray,
) -> None:
    """Write the end frame's pose and the joints of samples ``first`` to ``last``.

    Of ``start_joints`` (n, 1, J) only the locked joints count.
    """
    count = star.revolute.shape[1]
    for row in range(first, last):
        for k in range(count):
            room.joints[k] = start_joints[row, 0, k]
        load_drives(star, room, drives, row)
        sound = place_errors(star, room, axes, errors, single_site, row, first)
        sines_cosines(room.joints, room.circle)
        axes_of_end, _, origin = branch_end(star, room, 0)
        total = origin[0] + origin[1] + origin[2]
        for k in range(count):
            total += room.joints[k]
        sound = sound and math.isfinite(total)
        status[row] = CLOSED if sound else NOT_FINITE
        for c in range(3):
            position[row, c] = origin[c] if sound else math.nan
        for c in range(9):
            rotation[row, c // 3, c % 3] = axes_of_end[c] if sound else math.nan
        for k in range(count):
            joints[row, 0, k] = room.joints[k] if sound else math.nan
