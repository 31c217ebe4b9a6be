"""Drive and passive-joint Jacobians of the closed mechanism, and how far it is from a singular pose.

At the energy minimum the gradient over the free joints vanishes. Moving a drive keeps it zero, so by the implicit
function theorem ``dq_free = -H_ff^-1 H_fd dq_drive`` with the exact Hessian H of the closure energy. This holds
whether or not the loops close exactly.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import pinocchio as pin

from pouring_robot.closure import ClosureResult, ClosureSolver
from pouring_robot.exceptions import SingularPoseError
from pouring_robot.mechanism import FloatArray

# Rows of the platform twist that the four drives control: x, y, z and the tilt about y.
TASK_ROWS = (0, 1, 2, 4)
_SINGULAR_RATIO = 1e-13


@dataclass(frozen=True)
class DriveJacobians:
    """How the closed mechanism moves with its drives (columns, in the order of the loops file).

    Attributes:
        platform: twist of the end frame (linear velocity of its origin, angular velocity, both in the axes of the
            base frame) per unit drive velocity, shape (6, drives).
        joints: velocity of every joint column of the model per unit drive velocity, shape (nv, drives).
        closure_margin: smallest singular value of the loops' Jacobian over the free joints (m, rad); zero where
            the platform can move with the drives locked.
    """

    platform: FloatArray
    joints: FloatArray
    closure_margin: float


@dataclass(frozen=True)
class Dexterity:
    """How well the drives command the four freedoms; lengths and angles compared through ``length_m``.

    Attributes:
        condition: condition number of the scaled 4 x 4 Jacobian (1 is best).
        singularity: the nearer kind; ``serial``: the platform loses a freedom, ``parallel``: it gains one.
        distance: smallest factor between task and drive motion, or its inverse, whichever is smaller; zero is
            singular.
        length_m: characteristic length by which angles were scaled, in m.
    """

    condition: float
    singularity: Literal["serial", "parallel"]
    distance: float
    length_m: float


def drive_jacobians(solver: ClosureSolver, result: ClosureResult) -> DriveJacobians:
    """Return the exact Jacobians at a closed configuration.

    Args:
        solver: the solver that found ``result`` (its loads count).
        result: the closed configuration.

    Raises:
        SingularPoseError: the free joints are not determined by the drives here.
        BadInputError: the loops file names no end frame.
    """
    energy, mechanism = solver.energy, solver.mechanism
    state = energy.evaluate(result.configuration, result.configuration)
    hessian = energy.hessian(state)
    free, drives = energy.free_columns, mechanism.drive_columns
    motion = np.zeros((energy.model.nv, drives.size))
    right_side = np.zeros((free.size, drives.size))
    for k, column in enumerate(drives):
        if column in free:  # a yielding drive: its spring pulls the joint towards the command
            right_side[free == column, k] = energy.springs[column]
        else:
            motion[column, k] = 1.0
            right_side[:, k] = -hessian[free, column]
    block = hessian[energy.free_block]
    values, vectors = np.linalg.eigh(block)
    if values[0] <= _SINGULAR_RATIO * values[-1]:
        raise SingularPoseError(float(values[0] / values[-1]))
    motion[free] += vectors @ ((vectors.T @ right_side) / values[:, None])
    loops = state.jacobian.reshape(-1, energy.model.nv)[:, free]
    margin = float(np.linalg.svd(loops, compute_uv=False)[-1])
    return DriveJacobians(_end_twists(solver, result) @ motion, motion, margin)


def _end_twists(solver: ClosureSolver, result: ClosureResult) -> FloatArray:
    """Return the end frame's twist in base axes per joint velocity, shape (6, nv)."""
    mechanism, model, data = solver.mechanism, solver.energy.model, solver.energy.data
    pose = result.pose_base_to_end
    base, end = (mechanism.frame_id(name) for name in (mechanism.loops.base_frame, mechanism.loops.end_frame or ""))
    pin.computeJointJacobians(model, data, result.configuration)
    pin.updateFramePlacements(model, data)
    relative = pin.getFrameJacobian(model, data, end, pin.LOCAL) - data.oMf[end].actInv(
        data.oMf[base]
    ).toActionMatrix() @ pin.getFrameJacobian(model, data, base, pin.LOCAL)
    axes = np.zeros((6, 6))
    axes[:3, :3] = axes[3:, 3:] = pose.rotation
    return np.asarray(axes @ relative)


def dexterity(jacobians: DriveJacobians, prismatic: tuple[bool, ...], length_m: float) -> Dexterity:
    """Return condition and distance to singularity of the four task freedoms.

    Args:
        jacobians: of a mechanism with four drives.
        prismatic: which drives are lengths.
        length_m: characteristic length that turns angles into lengths, for instance the mean distance of the
            moving U-joint centres from the platform's origin.
    """
    task = jacobians.platform[list(TASK_ROWS)].copy()
    task[3] *= length_m
    task[:, [not is_length for is_length in prismatic]] /= length_m
    factors = np.linalg.svd(task, compute_uv=False)
    smallest, largest = float(factors[-1]), float(factors[0])
    if smallest <= 1.0 / largest:
        return Dexterity(largest / smallest if smallest else np.inf, "serial", smallest, length_m)
    return Dexterity(largest / smallest, "parallel", 1.0 / largest, length_m)
