"""Working arrays of the kernels: one room a thread, made outside, so that kernels allocate nothing."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pouring_robot.batch.kernels.compiler import compiled
from pouring_robot.batch.kernels.loops import GAPS_WIDTH, evaluate, move_platform
from pouring_robot.batch.structure import Star
from pouring_robot.mechanism.arrays import FloatArray


class Room(NamedTuple):
    """Working arrays of one thread; see :mod:`pouring_robot.batch.kernels.loops` for the first ones.

    Attributes:
        joints: joint values, m or rad, (C J,); ``before`` the ones before the step.
        platform: (12,); ``platform_before`` the one before the step.
        columns: joint twists of the passive places about the chain's reference point, (C, 6 P).
        stiff: W times the columns, (C, 6 P).
        factor: unit lower triangle and inverse diagonal of each chain's L D L^T, (C, P P).
        coupling: L^-1 times the chain's coupling to the platform, about the platform's origin, (C, 6 P).
        schur: Cholesky factor of the platform's Schur complement, lower triangle with inverse diagonal, (36,).
        step: of the platform, (6,); ``joint_step`` of the passive places, (C, P).
        matrix: W of one chain, (36,).
        blocks: (6, 9).
    """

    sites: FloatArray
    joints: FloatArray
    circle: FloatArray
    before: FloatArray
    platform: FloatArray
    platform_before: FloatArray
    frames: FloatArray
    gaps: FloatArray
    columns: FloatArray
    stiff: FloatArray
    factor: FloatArray
    coupling: FloatArray
    schur: FloatArray
    step: FloatArray
    joint_step: FloatArray
    matrix: FloatArray
    blocks: FloatArray


def make_room(star: Star) -> Room:
    """Return working arrays for a star; its sites are those without errors."""
    chains, joints = star.revolute.shape
    places = len(star.passive_count)
    return Room(
        star.placements.copy(),
        np.zeros(chains * joints),
        np.zeros(2 * chains * joints),
        np.zeros(chains * joints),
        np.zeros(12),
        np.zeros(12),
        np.zeros((chains, joints, 9)),
        np.zeros((chains, GAPS_WIDTH)),
        np.zeros((chains, 6 * places)),
        np.zeros((chains, 6 * places)),
        np.zeros((chains, places * places)),
        np.zeros((chains, 6 * places)),
        np.zeros(36),
        np.zeros(6),
        np.zeros((chains, places)),
        np.zeros(36),
        np.zeros((6, 9)),
    )


@compiled
def evaluate_room(star: Star, room: Room) -> tuple[float, float]:
    """Evaluate the present state; see :func:`~pouring_robot.batch.kernels.loops.evaluate`."""
    return evaluate(
        room.sites,
        star.revolute,
        star.stiffness,
        room.joints,
        room.circle,
        room.platform,
        room.frames,
        room.gaps,
    )


@compiled
def keep_state(room: Room) -> None:
    """Keep the present state, to step back to."""
    for c in range(12):
        room.platform_before[c] = room.platform[c]
    for at in range(room.joints.size):
        room.before[at] = room.joints[at]


@compiled
def move(star: Star, room: Room, scale: float) -> None:
    """Move by a share of the step."""
    move_platform(room.platform, room.step, scale)
    joints = star.revolute.shape[1]
    for i in range(star.revolute.shape[0]):
        for n in range(len(star.passive_count)):
            if star.passive[i, n] >= 0:
                room.joints[i * joints + star.passive[i, n]] += scale * room.joint_step[i, n]


@compiled
def step_back(room: Room) -> None:
    """Return to the state before the step."""
    for c in range(12):
        room.platform[c] = room.platform_before[c]
    for at in range(room.joints.size):
        room.joints[at] = room.before[at]
