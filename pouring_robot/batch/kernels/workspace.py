"""Working arrays of the kernels: one room a thread, made outside, so that kernels allocate nothing."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pouring_robot.batch.structure import ByteArray, CountArray, IntArray, Star
from pouring_robot.mechanism.arrays import FloatArray

# Where things stand in a row of ``gaps``. All vectors are in base axes; the residual's parts v and w are those of log6
# turned from frame b into base axes.
ORIGIN_B = 0  # origin of frame b
GAP = 3  # origin of b minus origin of a
TURN = 6  # w
SHIFT = 9  # v
FORCE = 12
TORQUE = 15  # about the origin of b
AXES_A = 18  # rotation of frame a
_GAPS_WIDTH = 27


class Room(NamedTuple):
    """Working arrays of one thread, for C chains of J joints with P passive places."""

    sites: FloatArray  # present placements, as in ``Star``, (C, J + 2, 12)
    joints: FloatArray  # values chain by chain, m or rad, (C J,)
    circle: FloatArray  # their sines, then their cosines, (2 C J,)
    before: FloatArray  # joints before the step, (C J,)
    platform: FloatArray  # rotation and position of the end frame in the base frame, (12,)
    platform_before: FloatArray  # before the step, (12,)
    frames: FloatArray  # z axis (the joint's own), origin and x axis of each joint's placement, in base axes, (C, J, 9)
    gaps: FloatArray  # what ``evaluate`` finds about each loop, by the offsets above, (C, 27)
    columns: FloatArray  # joint twists of the passive places about the chain's reference point, (C, 6 P)
    stiff: FloatArray  # W times the columns, (C, 6 P)
    factor: FloatArray  # unit lower triangle and inverse diagonal of each chain's L D L^T, (C, P P)
    coupling: FloatArray  # L^-1 times the chain's coupling to the platform, about the platform's origin, (C, 6 P)
    schur: FloatArray  # Cholesky factor of the platform's Schur complement, lower, with inverse diagonal, (36,)
    step: FloatArray  # of the platform, (6,)
    joint_step: FloatArray  # of the passive places, (C, P)
    matrix: FloatArray  # W of one chain, (36,)
    blocks: FloatArray  # (6, 9)
    # Of G, whose letters are those of ``transfer``:
    unit: FloatArray  # u, one row of six an output, (36,)
    multipliers: FloatArray  # lambda of the present chain, P an output, (6 P,)
    front: FloatArray  # the matrix in front of J, column by column, (36,)
    through: FloatArray  # ``E + L``, one row of six an output, (36,)
    answer: FloatArray  # ``front J`` of the present site, column by column, (36,)


class Samples(NamedTuple):
    """Where n samples start, as in ``BatchStart``, and their errors, as in ``SiteErrors``."""

    position: FloatArray
    rotation: FloatArray
    joints: FloatArray
    errors: FloatArray
    site: IntArray


class Closures(NamedTuple):
    """What is written of n samples, as in ``BatchClosure``."""

    position: FloatArray
    rotation: FloatArray
    joints: FloatArray
    residual: FloatArray
    iterations: CountArray
    status: ByteArray


def make_room(star: Star) -> Room:
    """Return working arrays for a star; its sites are those without errors."""
    chains, joints = star.revolute.shape
    places = len(star.passive_count)
    count, six = chains * joints, (chains, 6 * places)
    shapes = (count, 2 * count, count, 12, 12, (chains, joints, 9), (chains, _GAPS_WIDTH), six, six)
    more = ((chains, places * places), six, 36, 6, (chains, places), 36, (6, 9), 36, 6 * places, 36, 36, 36)
    return Room(star.placements.copy(), *(np.zeros(shape) for shape in (*shapes, *more)))
