r"""The energy whose minimum is the closed pose of an over-constrained mechanism, with exact derivatives.

.. math:: E(q) = \sum_i \tfrac12 e_i^T K e_i + \tfrac12 \sum_d k_d (q_d - \bar q_d)^2 + V(q)

``e_i = log6(M_i)``, with :math:`M_i` the pose of frame b in frame a of loop i, in m and rad; K holds the loop's
translation and rotation stiffness (N/m, Nm/rad); the second sum is over drives that yield, and V is gravity. For a
3d loop, ``e_i`` is the position of frame b in frame a.

First order. Pinocchio's anchor Jacobian gives the relative twist seen in frame a, so the residual's Jacobian is
``Jlog6(M) Ad(M)^-1 J_anchor``. It differs from the anchor Jacobian as soon as the loop is not exactly closed.

Second order. With :math:`w = J_{log}^T K e` the wrench of a loop and D its relative twist columns in world
coordinates, the Hessian is :math:`J^T W J` plus the wrench times the motion of the columns themselves, where
:math:`\partial S_k / \partial q_j = S_j \times S_k` for every joint j before joint k (Lie bracket of twists; see
Featherstone, Rigid Body Dynamics Algorithms, 2008, ch. 2). W contains the derivative of Jlog6 by its Bernoulli
series. Motions are ordered (linear, angular), as in Pinocchio.
"""

from __future__ import annotations

import functools
import threading
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import eigenpy
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from pouring_robot.exceptions import BadInputError
from pouring_robot.io.argument_checks import expect
from pouring_robot.mechanism.arrays import FloatArray, finite, locked
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.rotations import skew

# Bernoulli series of the inverse right Jacobian: ad/2 + ad^2/12 - ad^4/720 + ad^6/30240 - ad^8/1209600.
_JLOG_SERIES = {1: 1 / 2, 2: 1 / 12, 4: -1 / 720, 6: 1 / 30240, 8: -1 / 1209600}
# Terms kept by the size of the residual (m or rad): those left out are below 2e-12 of those kept.
_SERIES_LENGTHS = ((1e-3, 2), (1e-2, 4), (np.inf, 8))


@dataclass(frozen=True)
class Loads:
    """Loads on the mechanism: weight and yielding drives, none by default. Invalid ones raise BadInputError."""

    gravity: bool = False  # whether the links' weight acts, along -z of the world
    payload_kg: float = 0.0  # mass carried in addition to the URDF's links
    payload_frame: str | None = None  # that carries it; None: the robot file's, else the loops file's end frame
    payload_centre_m: tuple[float, float, float] = (0.0, 0.0, 0.0)  # its centre of mass in that frame, in m
    # stiffness of yielding drives by joint, in N/m or Nm/rad; others are rigid
    drive_stiffness: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))

    def __post_init__(self) -> None:
        expect(self.gravity, bool | np.bool_, "gravity is True or False: whether weight acts, along -z of the world")
        said = f"the payload must be a finite mass in kg, zero or positive, not {self.payload_kg}"
        payload = finite(self.payload_kg, (), said)
        if payload < 0.0:
            raise BadInputError(said)
        if payload and not self.gravity:
            raise BadInputError(f"a payload of {payload:g} kg weighs nothing without gravity; switch gravity on")
        said = f"the payload's centre must be three finite numbers, in m, not {self.payload_centre_m}"
        centre = tuple(finite(self.payload_centre_m, (3,), said).tolist())
        expect(self.drive_stiffness, Mapping, "the stiffness of drives is a mapping by their joints")
        soft = {}
        for joint, stiffness in self.drive_stiffness.items():
            said = f"the stiffness of drive '{joint}' must be positive and finite, not {stiffness}"
            soft[joint] = finite(stiffness, (), said).item()
            if soft[joint] <= 0.0:
                raise BadInputError(said)
        # What was given is the caller's, and may change.
        plain = {"payload_kg": payload.item(), "payload_centre_m": centre, "drive_stiffness": locked(soft)}
        for name, value in plain.items():
            object.__setattr__(self, name, value)


NO_LOADS = Loads()


def motion_cross(twists: FloatArray) -> FloatArray:
    """Return the matrices ad(x) with ad(x) y = x × y; twists (..., 6) give (..., 6, 6)."""
    linear, angular = skew(twists[..., :3]), skew(twists[..., 3:])
    matrix = np.zeros((*twists.shape[:-1], 6, 6))
    matrix[..., :3, :3] = matrix[..., 3:, 3:] = angular
    matrix[..., :3, 3:] = linear
    return matrix


def bracket_form(wrenches: FloatArray) -> FloatArray:
    """Return the antisymmetric matrices F with ``wrench . (x × y) = x^T F y``; wrenches (..., 6) give (..., 6, 6)."""
    force, torque = skew(wrenches[..., :3]), skew(wrenches[..., 3:])
    form = np.zeros((*wrenches.shape[:-1], 6, 6))
    form[..., :3, 3:] = form[..., 3:, :3] = -force
    form[..., 3:, 3:] = -torque
    return form


def log_wrench_derivative(residual: FloatArray, stiff_residual: FloatArray, jlog: FloatArray) -> FloatArray:
    """Return the part of d(Jlog^T K e)/d(body twist) that comes from the change of Jlog, (n, 6, 6).

    From e = log6(M) and K e, (n, 6), and Jlog6(M), (n, 6, 6); exact to machine precision below 0.3 rad of e.
    """
    transposed = np.swapaxes(motion_cross(residual), -1, -2)
    # d(ad^n)^T w = sum_k (ad^T)^(n-1-k) B((ad^T)^k w) de, summed over n by Horner's rule in ad^T.
    size = np.abs(residual).max()
    highest = next(terms for limit, terms in _SERIES_LENGTHS if size <= limit)
    vectors = [stiff_residual[..., None]]
    for _ in range(highest - 1):
        vectors.append(transposed @ vectors[-1])
    forms = -bracket_form(np.stack(vectors)[..., 0])
    weighted = np.zeros_like(forms)  # what stands beside each power of ad^T
    for power, factor in _JLOG_SERIES.items():
        if power <= highest:
            weighted[:power] += factor * forms[power - 1 :: -1]
    total = np.zeros_like(transposed)
    for part in weighted[::-1]:
        total = transposed @ total + part
    return np.asarray(total @ jlog)


@dataclass(frozen=True)
class EnergyState:
    """Energy and first derivatives at one configuration, over all velocity columns of the model."""

    configuration: FloatArray  # shape (nq,)
    energy: float  # in J
    elastic: float  # its part in the loops, in J
    residual: FloatArray  # e of each loop, shape (loops, 6), m and rad (3d loops: last three zero)
    jacobian: FloatArray  # de/dq, shape (loops, 6, nv)
    wrench: FloatArray  # K e of each loop, shape (loops, 6), in N and Nm
    gradient: FloatArray  # dE/dq, shape (nv,)
    jlog: FloatArray  # d e / d(relative twist in frame b), shape (loops, 6, 6)


@dataclass(frozen=True)
class TwistColumns:
    """Twists that displace the tree at some place, in world coordinates, as they act on each loop."""

    on_a: FloatArray  # twist of what carries frame a of each loop, zero where it is not displaced, shape (loops, 6, n)
    on_b: FloatArray  # the same for frame b
    # how deep in the tree each twist acts, shape (n,): a joint's placement at the number of frames before it, its
    # motion half a step later
    depth: FloatArray


def _dual(left: FloatArray, form: FloatArray, right: FloatArray) -> FloatArray:
    return np.asarray(np.swapaxes(left, 1, 2) @ form @ right)


class _Workspace(threading.local):
    """Working data of an evaluation; each thread has its own."""

    factors: eigenpy.LLT | None = None  # of the Hessian of the last Newton step; Eigen's: nothing to load, no threads

    def __init__(self, model: pin.Model, constraints: pin.StdVec_ConstraintModel) -> None:
        self.data, self.constraints = model.createData(), pin.StdVec_ConstraintData()
        for constraint in constraints:
            self.constraints.append(constraint.createData())
        self.anchors = [data.extract() for data in self.constraints]


class ClosureEnergy:
    """The closure energy of a mechanism under loads, evaluated with Pinocchio; threads may share it."""

    def __init__(self, mechanism: ClosedChainMechanism, loads: Loads = NO_LOADS) -> None:
        self.mechanism, self.loads = mechanism, loads
        self.model = mechanism.shared_model
        if loads.payload_kg:
            self.model = mechanism.copy_model()
            frame = self.model.frames[mechanism.frame_id(self.payload_frame)]
            point_mass = pin.Inertia(loads.payload_kg, np.array(loads.payload_centre_m), np.zeros((3, 3)))
            self.model.appendBodyToJoint(frame.parentJoint, point_mass, frame.placement)
        self._constraints = pin.StdVec_ConstraintModel()
        for a, b in mechanism.anchors:
            frames = a.parentJoint, a.placement, b.parentJoint, b.placement
            self._constraints.append(pin.ConstraintModel(pin.FrameAnchorConstraintModel(self.model, *frames)))
        self.workspace = _Workspace(self.model, self._constraints)
        self._is_3d = [loop.type == "3d" for loop in mechanism.loops.loops]
        translation, rotation = mechanism.loops.stiffness_si
        self._stiffness = np.tile(np.repeat([translation, rotation], 3), (len(self._is_3d), 1))
        self.root_stiffness = np.sqrt(self._stiffness).reshape(-1, 1)
        self.springs = np.zeros(self.model.nv)
        for joint, stiffness in loads.drive_stiffness.items():
            if joint not in mechanism.loops.drives:
                raise BadInputError(f"drive_stiffness: '{joint}' is not a drive; drives: {mechanism.loops.drives}")
            self.springs[self.model.idx_vs[mechanism.joint_id(joint)]] = stiffness

    @property
    def data(self) -> pin.Data:
        """Pinocchio's data at the configuration that this thread evaluated last."""
        return self.workspace.data

    @property
    def payload_frame(self) -> str:
        """The frame that carries the payload; raises BadInputError where neither loads nor loops file name one."""
        frame = self.loads.payload_frame or self.mechanism.loops.end_frame
        if frame is None:
            raise BadInputError("the loops file names no end_frame: say in the loads which payload_frame is loaded")
        return frame

    @functools.cached_property
    def free_columns(self) -> NDArray[np.intp]:
        """Velocity columns that minimise the energy: passive joints and yielding drives."""
        yielding = np.flatnonzero(self.springs)
        return np.sort(np.concatenate([self.mechanism.passive_columns, yielding]))

    @functools.cached_property
    def basis(self) -> FloatArray:
        """How all velocity columns move with the free ones, (nv, free)."""
        return np.asarray(self.mechanism.coupling[:, self.free_columns])

    def evaluate(self, configuration: FloatArray, commanded: FloatArray) -> EnergyState:
        """Return energy and derivatives at a configuration (nq,); drives yield from the commanded one (nq,)."""
        model, workspace = self.model, self.workspace
        data = workspace.data
        pin.computeJointJacobians(model, data, configuration)
        for constraint, room in zip(self._constraints, workspace.constraints, strict=True):
            constraint.calc(model, data, room)
        anchors = pin.getConstraintsJacobian(model, data, self._constraints, workspace.constraints)
        count = len(workspace.anchors)
        residual = np.zeros((count, 6))
        inverse_actions, jlog = np.empty((count, 6, 6)), np.empty((count, 6, 6))
        for i, anchor in enumerate(workspace.anchors):
            pose = anchor.c1Mc2
            inverse_actions[i] = pose.toActionMatrixInverse()
            if self._is_3d[i]:
                residual[i, :3], jlog[i] = pose.translation, 0.0
                jlog[i, :3, :3] = pose.rotation
            else:
                residual[i], jlog[i] = pin.log6(pose).vector, pin.Jlog6(pose)
        jacobian = (jlog @ inverse_actions) @ anchors.reshape(count, 6, model.nv)
        wrench = self._stiffness * residual
        gradient = wrench.ravel() @ jacobian.reshape(6 * count, model.nv)
        elastic = energy = 0.5 * float(np.vdot(residual, wrench))
        if self.loads.drive_stiffness:
            stretch = pin.difference(model, commanded, configuration)
            gradient += self.springs * stretch
            energy += 0.5 * float(self.springs @ stretch**2)
        if self.loads.gravity:
            gradient += pin.computeGeneralizedGravity(model, data, configuration)
            energy += pin.computePotentialEnergy(model, data, configuration)
        return EnergyState(configuration, energy, elastic, residual, jacobian, wrench, gradient, jlog)

    def gauss_newton_hessian(self, state: EnergyState) -> FloatArray:
        """Return the positive part J^T K J of the Hessian, plus drive springs; shape (nv, nv)."""
        scaled = state.jacobian.reshape(-1, self.model.nv) * self.root_stiffness
        hessian = scaled.T @ scaled
        hessian.flat[:: self.model.nv + 1] += self.springs
        return np.asarray(hessian)

    def hessian(self, state: EnergyState) -> FloatArray:
        """Return the exact Hessian at the state's configuration, where :meth:`evaluate` was last called.

        It is the derivative of the gradient by joint twists where the gradient vanishes; shape (nv, nv).
        """
        hessian = self.gradient_derivative(state)
        hessian.flat[:: self.model.nv + 1] += self.springs
        if self.loads.gravity:
            configuration = state.configuration
            hessian += pin.computeGeneralizedGravityDerivatives(self.model, self.data, configuration)
        return np.asarray(0.5 * (hessian + hessian.T))

    def gradient_derivative(self, state: EnergyState, columns: TwistColumns | None = None) -> FloatArray:
        """Return how the loops' part of the gradient changes when n twists displace the tree; shape (nv, n).

        By default the twists are those of the joints. Valid at the state's configuration, where :meth:`evaluate` was
        last called. Springs and weight are not included.
        """
        mask_a, mask_b = self._support
        joints = TwistColumns(self.data.J * mask_a[:, None, :], self.data.J * mask_b[:, None, :], self.joint_depths)
        columns = columns or joints
        if not self.mechanism.anchors:
            return np.zeros((self.model.nv, columns.depth.size))
        body = np.stack([a.oMc2.toActionMatrixInverse() for a in self.workspace.anchors])
        relative_wrench = (state.wrench[:, None, :] @ state.jlog)[:, 0]
        form = bracket_form((relative_wrench[:, None, :] @ body)[:, 0])
        motion = joints.on_b - joints.on_a
        local = body @ motion
        displaced = local if columns is joints else body @ (columns.on_b - columns.on_a)
        stiff = np.swapaxes(state.jlog, 1, 2) @ (self._stiffness[:, :, None] * state.jlog)
        curvature = stiff + self._relative_curvature(state, relative_wrench)
        change = np.swapaxes(local, 1, 2) @ (curvature @ displaced)
        # What turns the column of a joint: twists before it on its path to frame a or frame b.
        own = _dual(joints.on_b, form, columns.on_b) - _dual(joints.on_a, form, columns.on_a)
        change += _dual(motion, form, columns.on_b) - (columns.depth < joints.depth[:, None]) * own
        return np.asarray(change.sum(axis=0))

    def residual_change(self, state: EnergyState, columns: TwistColumns) -> FloatArray:
        """Return how the loops' residual changes when twists displace the tree, (loops * 6, n); valid as above."""
        body = np.stack([a.oMc2.toActionMatrixInverse() for a in self.workspace.anchors])
        return np.asarray((state.jlog @ body @ (columns.on_b - columns.on_a)).reshape(6 * len(body), -1))

    def _relative_curvature(self, state: EnergyState, relative_wrench: FloatArray) -> FloatArray:
        """Return how each loop's wrench changes with its relative pose, beyond Jlog^T K Jlog; (loops, 6, 6)."""
        if all(self._is_3d):  # of these no logarithm is taken
            curvature = np.zeros_like(state.jlog)
        else:
            curvature = log_wrench_derivative(state.residual, state.wrench, state.jlog)
        for i, is_3d in enumerate(self._is_3d):
            if is_3d:  # the wrench is R^T K p; turning frame b turns it back: d(R^T p) = (R^T p) × omega
                curvature[i] = 0.0
                curvature[i, :3, 3:] = skew(relative_wrench[i, :3])
        return curvature

    @functools.cached_property
    def _support(self) -> tuple[FloatArray, FloatArray]:
        """Return which columns move frame a and frame b of each loop; (loops, nv) of ones and zeros."""
        paths, frames = self.mechanism.frame_paths, self.mechanism.loops.loop_frames
        masks = np.reshape([self.mechanism.columns_on(paths[frame]) for frame in frames], (-1, 2, self.model.nv))
        return masks[:, 0], masks[:, 1]

    @functools.cached_property
    def joint_depths(self) -> FloatArray:
        """Return how deep in the tree each joint column acts; (nv,)."""
        paths, columns = self.mechanism.joint_paths, self.mechanism.joint_columns
        return np.array([len(paths[name]) - 0.5 for name, own in columns.items() for _ in own])
