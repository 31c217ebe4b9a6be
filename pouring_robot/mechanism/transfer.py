r"""The error-transfer matrix G: how local parameters move the ladle, exactly to first order.

Closed chain. At the energy minimum the gradient g over the free joints vanishes; with H its Hessian,

.. math:: G = T_p - T_f H_{ff}^{-1}\, \partial g_f / \partial p

where T turns joint (f) and parameter (p) twists into the twist of the observed frame. G is exact whether or not the
loops close, with weight and yielding drives in the model. (One chain alone, its joints held, as in the paper's
Section 4: :meth:`pouring_robot.batch.compiled.CompiledEngine.transfer_open_branch`.)

Rows are the displacement of the frame's origin, then the rotation vector, both in the axes of the base frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import eigenpy
import numpy as np
import pinocchio as pin

from pouring_robot.exceptions import BadInputError, SingularPoseError, UnknownJointError
from pouring_robot.mechanism.arrays import FloatArray, ReadOnly, as_columns
from pouring_robot.mechanism.closure.energy import ClosureEnergy, EnergyState
from pouring_robot.mechanism.closure.null_space import SINGULAR_RATIO, Spectrum, unit_scale
from pouring_robot.mechanism.closure.placement_derivatives import PlacedTwists, Weight
from pouring_robot.mechanism.closure.solver import ClosureResult, ClosureSolver
from pouring_robot.mechanism.local_parameters import (
    DriveParameter,
    FrameParameter,
    LocalParameter,
    PayloadParameter,
    StiffnessParameter,
    unit_twist,
)
from pouring_robot.report.result import Result

if TYPE_CHECKING:
    import xarray as xr

# Idle freedoms may move the observed frame by so little (m or rad per m or rad), and feel this share of a parameter:
# eigenvectors are known to round-off over the gap to the softest direction that counts, which is 1e-6 of the stiffest.
_IDLE = 1e-7


@dataclass(frozen=True, eq=False, repr=False)
class TransferMatrix(ReadOnly, Result):
    """G with its labels."""

    frame: str  # the observed frame
    parameters: tuple[LocalParameter, ...]  # one a column
    # shape (6, n): displacement of the frame's origin in m, rotation vector in rad, in base axes, per unit of each
    # parameter
    matrix: FloatArray
    joints: FloatArray  # velocity of every joint column per unit of each parameter, shape (nv, n)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return tuple(parameter.name for parameter in self.parameters)

    @property
    def headline(self) -> str:
        """Frame and parameters of the matrix."""
        return f"G of '{self.frame}' by {len(self.parameters)} local parameters"

    def to_dataarray(self) -> xr.DataArray:
        """Return the matrix with its labels: entries are in ``unit`` per ``per``."""
        import xarray as xr

        components = ["x", "y", "z", "rx", "ry", "rz"]
        labels = {
            "component": components,
            "parameter": list(self.names),
            "unit": ("component", ["m"] * 3 + ["rad"] * 3),
            "per": ("parameter", [parameter.unit for parameter in self.parameters]),
        }
        return xr.DataArray(self.matrix.copy(), labels, ("component", "parameter"), "G", {"frame": self.frame})

    def _table(self) -> Any:
        """One row a parameter; columns in m and rad, per unit of the parameter."""
        columns = ("x_m", "y_m", "z_m", "rx_rad", "ry_rad", "rz_rad")
        labels = {"parameter": self.names, "per": [parameter.unit for parameter in self.parameters]}
        return labels | dict(zip(columns, self.matrix, strict=True))


def closed_chain_transfer(
    solver: ClosureSolver, result: ClosureResult, parameters: Sequence[LocalParameter], frame: str | None = None
) -> TransferMatrix:
    """Return G of the closed mechanism at a closure of the solver, under its loads; by default of the end frame.

    Idle joints respond with their least motion. (Where an error strains the loops, an idle joint of a real machine may
    turn to where it strains them least.)

    Raises:
        UnknownJointError: a parameter names an absent joint.
        BadInputError: a parameter does not apply, such as the stiffness of a rigid drive.
        SingularPoseError: the drives do not determine the observed frame here. Idle joints inside are allowed.
    """
    energy, mechanism, end = solver.energy, solver.mechanism, solver.mechanism.loops.end_frame
    if frame is None and end is None:
        raise BadInputError("the loops file names no end_frame; say which frame is observed")
    frame = frame or str(end)
    state = energy.evaluate(result.configuration, result.commanded)
    hessian = energy.hessian(state)
    pin.updateFramePlacements(energy.model, energy.data)
    placed = PlacedTwists(mechanism, energy.data, parameters)
    twists, direct = _observed(energy, placed, frame)
    motion, gradient_change = _imposed(solver, result, state, hessian, placed)
    basis = energy.basis
    motion -= basis @ _answer(basis.T @ hessian @ basis, basis.T @ gradient_change, twists @ basis)
    return TransferMatrix(frame, placed.parameters, twists @ motion + direct, motion)


def _observed(energy: ClosureEnergy, placed: PlacedTwists, frame: str) -> tuple[FloatArray, FloatArray]:
    """Return a frame's twist against the base, in base axes: per joint velocity, (6, nv), and per parameter, (6, n).

    The latter is with all joints held. Frames in the energy's data must be up to date.
    """
    own, paths = energy.mechanism.loops.base_frame, energy.mechanism.frame_paths
    ids = [energy.mechanism.frame_id(name) for name in (frame, own)]
    tip, base = (energy.data.oMf[k] for k in ids)
    pose = base.actInv(tip)
    turn = pin.SE3(pose.rotation, np.zeros(3))
    # Turns world twists into displacement of the frame's origin and rotation, in base axes.
    to_base_axes = turn.toActionMatrix() @ tip.toActionMatrixInverse()
    of_tip, of_base = (as_columns(pin.getFrameJacobian(energy.model, energy.data, k, pin.WORLD)) for k in ids)
    direct = to_base_axes @ (placed.world * (placed.carried(paths[frame]) - placed.carried(paths[own])))
    for k, parameter in enumerate(placed.parameters):
        if isinstance(parameter, FrameParameter):
            # Turning the base swings the frame about the base's origin.
            seen = pin.SE3(np.eye(3), -pose.translation) if parameter.side == "base" else turn
            direct[:, k] = seen.toActionMatrix() @ unit_twist(parameter.component)
    return np.asarray(to_base_axes @ (of_tip - of_base)), np.asarray(direct)


def _imposed(
    solver: ClosureSolver, result: ClosureResult, state: EnergyState, hessian: FloatArray, placed: PlacedTwists
) -> tuple[FloatArray, FloatArray]:
    """Return the direct effects of parameters, (nv, n) each: motion of rigid drives, and change of the gradient."""
    energy, drives = solver.energy, solver.mechanism.loops.drives
    change = energy.gradient_derivative(state, placed.columns())
    motion = np.zeros_like(change)
    weight = Weight(energy) if energy.loads.gravity else None
    if weight:
        change += weight.placement_derivative(placed)
    for k, parameter in enumerate(placed.parameters):
        if isinstance(parameter, PayloadParameter):
            if weight is None:
                raise BadInputError("the payload's mass has no effect without gravity; switch gravity on in the loads")
            change[:, k] = weight.payload_derivative()
        elif isinstance(parameter, DriveParameter | StiffnessParameter):
            if parameter.joint not in drives:
                raise UnknownJointError(parameter.joint, drives)
            column = solver.mechanism.joint_columns[parameter.joint].start
            spring = energy.springs[column]
            if isinstance(parameter, StiffnessParameter):
                if not spring:
                    raise BadInputError(f"drive '{parameter.joint}' is rigid in this model; give it a stiffness first")
                change[column, k] = pin.difference(energy.model, result.commanded, result.configuration)[column]
            elif spring:  # a yielding drive is pulled towards its command
                change[column, k] = -spring
            else:  # a rigid one moves, and everything with it
                motion[:, k] = solver.mechanism.coupling[:, column]
                change[:, k] = hessian @ motion[:, k]
    return motion, change


def _answer(hessian: FloatArray, wanted: FloatArray, twists: FloatArray) -> FloatArray:
    """Return the free joints' response to a change of their gradient, (free, n); idle ones must not show in ``twists``.

    All are over the free joints: the Hessian, (free, free), and the observed frame's twists, (6, free).
    """
    if not hessian.size or not wanted.size:
        return wanted
    scale = unit_scale(hessian)
    scaled = hessian * scale[:, None] * scale
    values = np.linalg.eigvalsh(scaled)
    if values[0] > SINGULAR_RATIO * values[-1]:
        factor = eigenpy.LLT(scaled)
        wanted = scale[:, None] * wanted
        # One column comes back from Eigen as a vector.
        solution = factor.solve(wanted).reshape(wanted.shape)
        solution += factor.solve(wanted - scaled @ solution).reshape(wanted.shape)
        return np.asarray(scale[:, None] * solution)
    spectrum = Spectrum.of(hessian)
    shown = np.abs(twists @ spectrum.idle).max(initial=0.0)
    if not spectrum.is_semidefinite or shown > _IDLE or spectrum.left_out(wanted).max() > _IDLE:
        raise SingularPoseError(spectrum.ratio)
    return spectrum.solve(wanted)
