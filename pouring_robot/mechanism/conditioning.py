"""Conditioning of a pose, from G: how far the mechanism is from a singular pose, and which tilted axis acts most."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.closure.solver import ClosureResult, ClosureSolver
from pouring_robot.mechanism.local_parameters import placement_parameters
from pouring_robot.mechanism.transfer import closed_chain_transfer


@dataclass(frozen=True)
class Dexterity:
    """How well the drives command the end body; lengths and angles are compared by ``length_m``."""

    condition: float  # condition number of the scaled Jacobian (1 is best)
    # the nearer kind; ``serial``: the end body loses a freedom, ``parallel``: it gains one, which takes a loop
    singularity: Literal["serial", "parallel"]
    # smallest factor between task and drive motion, or its inverse, whichever is smaller; zero is singular
    distance: float
    length_m: float  # characteristic length by which angles were scaled, in m


@dataclass(frozen=True)
class AxisWeakness:
    """How far one tilted joint axis moves a frame sideways (along y of the base frame), at the worst joint."""

    parameter: str  # the placement parameter that moves it most, such as ``leg1_s2.rz``.
    m_per_rad: float  # what it does, in m per rad (the same number in mm per mrad); never negative


def axis_weakness(solver: ClosureSolver, result: ClosureResult, frame: str) -> AxisWeakness:
    """Return the largest sideways entry of a frame's G over all axis tilts of the chains; raises SingularPoseError."""
    mechanism = solver.mechanism
    chains = dict.fromkeys(name for end in mechanism.loops.loop_frames for name in mechanism.frame_paths[end])
    tilts = [p for p in placement_parameters(n for n in chains if n in mechanism.seen_joints) if p.unit == "rad"]
    sideways = np.abs(closed_chain_transfer(solver, result, tilts, frame).matrix[1])
    worst = int(np.argmax(sideways))
    return AxisWeakness(tilts[worst].name, float(sideways[worst]))


def dexterity(
    jacobian: FloatArray,
    prismatic: tuple[bool, ...],
    length_m: float,
    rows: Sequence[int] = range(6),
    redundant: int = 0,
    closed: bool = True,
) -> Dexterity:
    """Return condition number and distance to singularity of the drives' Jacobian.

    Args:
        jacobian: twist of the end body per drive, shape (6, drives): its transfer matrix by the drives.
        prismatic: which drives are lengths.
        length_m: characteristic length that turns angles into lengths, for instance the mean distance of the
            moving U-joint centres from the platform's origin.
        rows: rows of the end body's twist that count; by default all six.
        redundant: number of drives beyond the freedoms: in that many directions they strain the parts and move nothing,
            which is no singularity.
        closed: whether the robot has loops; without one there is no parallel singularity.
    """
    scales = np.where(np.array(rows) < 3, 1.0, length_m)
    task = jacobian[list(rows)] * scales[:, None]
    task[:, [not is_length for is_length in prismatic]] /= length_m
    factors = np.linalg.svd(task, compute_uv=False)[: len(prismatic) - redundant]
    smallest, largest = float(factors[-1]), float(factors[0])
    if not closed or smallest <= 1.0 / largest:
        return Dexterity(largest / smallest if smallest else np.inf, "serial", smallest, length_m)
    return Dexterity(largest / smallest, "parallel", 1.0 / largest, length_m)
