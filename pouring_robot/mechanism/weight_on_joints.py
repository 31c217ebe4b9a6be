"""Generalised forces of weight on drives, by virtual work: a weight W at height h exerts -W ∂h/∂q on the drive q.

Also moments of weight on the joints of an open chain, across their axes, too: of all that a joint carries.
"""

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.closure.solver import ClosureSolver
from pouring_robot.mechanism.local_parameters import drive_parameters
from pouring_robot.mechanism.rotations import moved_point
from pouring_robot.mechanism.transfer import closed_chain_transfer


def up_in_base(mechanism: ClosedChainMechanism) -> FloatArray:
    """Return the direction opposite to gravity in the base, (3,)."""
    frames, gravity = mechanism.frames_at(mechanism.neutral_configuration()).oMf, mechanism.shared_model.gravity.linear
    axes = frames[mechanism.frame_id(mechanism.loops.base_frame)].rotation
    return np.asarray(axes.T @ (-gravity / np.linalg.norm(gravity)))


def force_per_newton(up: FloatArray, moved: FloatArray, rotation: FloatArray, place: ArrayLike) -> FloatArray:
    """Return the forces that a newton of weight on the end body exerts on what moves it, (n, p), in N/N and Nm/N.

    Args:
        up: direction opposite to gravity in the base, (3,).
        moved: derivative of the pose of a frame on the end body, in base axes, (n, 6, p).
        rotation: axes of the end body, (n, 3, 3).
        place: position of the weight from that frame's origin in axes of the end body, (3,), in m.
    """
    return np.asarray(-np.einsum("c,ncp->np", up, moved_point(moved, rotation @ np.asarray(place))))


def own_force(mechanism: ClosedChainMechanism, configurations: FloatArray) -> FloatArray:
    """Return the forces of the links' weight on every drive, (n, D), in N and Nm, at or near configurations (n, nq).

    Pinocchio's generalised gravity is the force that the joints must exert; the weight exerts the opposite on each
    drive, through the joints that the drive moves.
    """
    model, drives = mechanism.shared_model, drive_parameters(mechanism)
    data, solver = model.createData(), ClosureSolver(mechanism)
    found = np.empty((len(configurations), len(drives)))
    # Without loops a drive moves its own joint, those that mimic it, and no other.
    moved = mechanism.coupling[:, mechanism.drive_columns]
    for row, near in enumerate(configurations):
        if mechanism.anchors:
            closed = solver.solve_from(near)
            at, moved = closed.configuration, closed_chain_transfer(solver, closed, drives).joints
        else:
            at = near
        found[row] = -moved.T @ pin.computeGeneralizedGravity(model, data, at)
    return found


def own_moments(mechanism: ClosedChainMechanism, configurations: FloatArray, joints: Sequence[str]) -> FloatArray:
    """Return the moments of the links' weight on joints of open chains, (n, 3 J), in Nm, at configurations (n, nq).

    Each is that of all links behind the joint, about origin and axes of its placement, x, y and z joint by joint.
    """
    model = mechanism.shared_model
    data, numbers = model.createData(), [model.getJointId(name) for name in joints]
    found = np.empty((len(configurations), len(joints), 3))
    for row, at in enumerate(configurations):
        pin.computeGeneralizedGravity(model, data, at)
        for k, joint in enumerate(numbers):  # what holds up all behind it, seen before its own motion
            moved = model.jointPlacements[joint].actInv(data.liMi[joint])
            found[row, k] = -moved.act(data.f[joint]).angular
    return found.reshape(len(configurations), -1)
