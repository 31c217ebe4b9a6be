"""The measurement model: what the tracker sees of the robot as built, and how every unknown moves it.

    Y = T_tracker_to_fixed ∘ D(base) ∘ X(drives, parameters) ∘ D(tool) ∘ T_platform_to_target

X closes the loops of the present robot with its local parameters added; D(v, w) = SE3(exp(w), v). The unknowns stand
in the order [base tx ty tz rx ry rz | tool tx ty tz rx ry rz | parameters], in m and rad. ``base`` displaces the fixed
platform in its own axes against where the tracker was taken to see it; ``tool`` displaces the target in the moving
platform's axes. A local parameter displaces the *present* placement of its joint (see
:mod:`pouring_robot.mechanism.parameters`), several at one joint by D of the sum of their twists.

    model = MeasurementModel(RobotModel(), parameters)
    poses = model.at(drives)                       # rows to predict, (n, 4) in m and rad
    seen = poses.linearise(Unknowns.zero(frames, len(parameters)))
    seen.position_m, seen.rotation, seen.jacobian, seen.status
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from pouring_robot.batch import BatchClosure, BatchEngine, BatchStart
from pouring_robot.campaign.nominal import nominal_poses
from pouring_robot.exceptions import BadInputError
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.parameters import (
    COMPONENTS,
    DriveParameter,
    FrameParameter,
    GeometricParameter,
    LocalParameter,
    PlacementParameter,
)
from pouring_robot.mechanism.rotations import right_jacobian, skew
from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.pouring.kinematics import FourUPUKinematics

BoolArray = NDArray[np.bool_]
FRAME_PARAMETERS: tuple[FrameParameter, ...] = (
    *(FrameParameter("base", component) for component in COMPONENTS),
    *(FrameParameter("tool", component) for component in COMPONENTS),
)
"""The twelve unknowns of the two outer frames, first in every vector of unknowns."""
FRAMES = len(FRAME_PARAMETERS)


@dataclass(frozen=True, eq=False)
class Unknowns:
    """A value for everything unknown.

    Attributes:
        pose_tracker_to_fixed_platform: where the tracker is taken to see the fixed platform.
        pose_platform_to_target: where the target is taken to sit on the moving platform.
        values: displacements from there and parameter values, shape (12 + P,), in m and rad; see the module.
    """

    pose_tracker_to_fixed_platform: pin.SE3
    pose_platform_to_target: pin.SE3
    values: FloatArray

    @classmethod
    def zero(cls, outer: pin.SE3, inner: pin.SE3, parameters: int) -> Unknowns:
        """Return the given frames and all parameters zero."""
        return cls(outer, inner, np.zeros(FRAMES + parameters))

    def at(self, values: FloatArray) -> Unknowns:
        """Return other values from the same frames."""
        return replace(self, values=np.asarray(values, dtype=float))

    @property
    def parameters(self) -> FloatArray:
        """Parameter values, shape (P,), in m and rad."""
        return self.values[FRAMES:]

    @property
    def outer(self) -> pin.SE3:
        """The fixed platform in the tracker frame, its displacement included."""
        return self.pose_tracker_to_fixed_platform * _displacement(self.values[:6])

    @property
    def inner(self) -> pin.SE3:
        """The target on the moving platform, its displacement included."""
        return _displacement(self.values[6:FRAMES]) * self.pose_platform_to_target


@dataclass(frozen=True, eq=False)
class Prediction:
    """What the tracker should see of n rows; a row that does not close is NaN and has a status.

    Attributes:
        position_m: origin of the target in the tracker frame, shape (n, 3), in m.
        rotation: its axes, shape (n, 3, 3).
        status: 0 closed, 1 not converged or singular, 2 left open too far, 3 no pose has these drives; shape (n,).
        closure: the closed loops.
        jacobian: shape (n, 6, 12 + P): displacement of the target's origin (m) and rotation vector (rad), both in
            tracker axes, per unit of each unknown; None where only the prediction was asked for.
    """

    position_m: FloatArray
    rotation: FloatArray
    status: NDArray[np.uint8]
    closure: BatchClosure
    jacobian: FloatArray | None = None

    @property
    def closed(self) -> BoolArray:
        """Which rows have a prediction, shape (n,)."""
        return np.asarray(self.status == 0)


class MeasurementModel:
    """Predicts measurements of one robot with a chosen set of parameters. Safe to use from several threads.

    Args:
        model: the present robot; parameters act on top of its errors.
        parameters: placement parameters (DH parameters too, as :attr:`DHParameter.local`) and drive parameters.
        threads: how many share the work; by default one a core. Results do not depend on it.

    Raises:
        UnknownJointError: a parameter names a joint that is in no chain.
        BadInputError: a parameter is of another kind, or stands twice.
    """

    def __init__(self, model: RobotModel, parameters: Sequence[GeometricParameter], threads: int | None = None) -> None:
        """Build the batch engine of the present robot and the map from parameters to placement errors."""
        self.model = model
        self.engine = BatchEngine(model.mechanism(), threads)
        self.kinematics = FourUPUKinematics(model.nominal_mechanism())
        self._choose(parameters)

    def _choose(self, parameters: Sequence[GeometricParameter]) -> None:
        structure = self.engine.structure
        self.parameters = tuple(parameters)
        self.names = tuple(p.name for p in (*FRAME_PARAMETERS, *self.parameters))
        self.units = tuple(p.unit for p in (*FRAME_PARAMETERS, *self.parameters))
        twice = {name for name in self.names if self.names.count(name) > 1}
        if twice:
            raise BadInputError(f"parameter '{min(twice)}' stands twice; name each parameter once")
        drives = structure.mechanism.loops.drives
        self._sites = np.full(len(self.parameters), -1)
        self._twists = np.zeros((structure.site_count, 6, len(self.parameters)))
        self._drives = np.zeros((len(drives), len(self.parameters)))
        for k, parameter in enumerate(self.parameters):
            if isinstance(parameter, PlacementParameter):
                self._sites[k] = structure.site(parameter.joint)
                self._twists[self._sites[k], :, k] = parameter.twist
            elif isinstance(parameter, DriveParameter) and parameter.joint in drives:
                self._drives[drives.index(parameter.joint), k] = 1.0
            else:
                raise BadInputError(f"'{getattr(parameter, 'name', parameter)}' is no placement or drive parameter")

    def with_parameters(self, parameters: Sequence[GeometricParameter]) -> MeasurementModel:
        """Return the same robot with another choice of parameters, sharing the engine.

        Raises:
            UnknownJointError: a parameter names a joint that is in no chain.
            BadInputError: a parameter is of another kind, or stands twice.
        """
        other = MeasurementModel.__new__(MeasurementModel)
        other.model, other.engine, other.kinematics = self.model, self.engine, self.kinematics
        other._choose(parameters)
        return other

    def starts(self, drives: FloatArray) -> BatchStart:
        """Return the drawing's closed poses for commanded drives (n, 4) in m and rad; NaN where no pose has them."""
        poses = nominal_poses(self.kinematics, drives)
        tilt = np.arctan2(poses.rotation[:, 0, 2], poses.rotation[:, 2, 2])
        return self.kinematics.commands(np.column_stack([poses.position_m, tilt])).start

    def at(self, drives: FloatArray, start: BatchStart | None = None) -> ModelledRows:
        """Return rows to predict.

        Args:
            drives: commanded drives, shape (n, 4), in m and rad; the model's own drive offsets come on top.
            start: where to start closing, if known; by default :meth:`starts`.

        Raises:
            BadInputError: the shape is wrong.
        """
        drives = np.asarray(drives, dtype=float)
        count = len(self.engine.structure.mechanism.loops.drives)
        if drives.ndim != 2 or drives.shape[1] != count:
            raise BadInputError(f"drives must have the shape (n, {count}), not {drives.shape}")
        return ModelledRows(self, drives, self.starts(drives) if start is None else start)

    def placement_errors(self, values: FloatArray) -> FloatArray:
        """Return the displacement of every site for parameter values (P,): shape (sites, 6), in m and rad."""
        return np.asarray(self._twists @ values)

    def drive_errors(self, values: FloatArray) -> FloatArray:
        """Return what is added to the commanded drives for parameter values (P,): shape (4,), in m and rad."""
        offsets = self.model.drive_offset_values()
        names = self.engine.structure.mechanism.loops.drives
        return np.asarray(self._drives @ values + np.array([offsets.get(name, 0.0) for name in names]))

    def moved_parameters(self, errors: FloatArray) -> tuple[LocalParameter, ...]:
        """Return the parameters as twists on top of placements displaced by ``errors`` (sites, 6).

        exp(w + dw) turns by the right Jacobian of w, and dv is seen in the turned axes.
        """
        moved: list[LocalParameter] = []
        for parameter, site in zip(self.parameters, self._sites.tolist(), strict=True):
            if isinstance(parameter, PlacementParameter) and errors[site, 3:].any():
                turn = errors[site, 3:]
                linear = pin.exp3(turn).T @ np.array(parameter.twist[:3])
                angular = right_jacobian(turn) @ np.array(parameter.twist[3:])
                moved.append(replace(parameter, twist=tuple(np.r_[linear, angular].tolist())))
            else:
                moved.append(parameter)
        return tuple(moved)


@dataclass(frozen=True, eq=False)
class ModelledRows:
    """Rows of a campaign or plan, ready to be predicted.

    Attributes:
        model: the measurement model.
        drives: commanded drives, shape (n, 4), in m and rad.
        start: where to start closing.
    """

    model: MeasurementModel
    drives: FloatArray
    start: BatchStart

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.drives)

    def __getitem__(self, rows: NDArray[np.intp] | BoolArray) -> ModelledRows:
        """Return some rows, by index or mask."""
        index: NDArray[np.int64] = np.arange(len(self))[rows]
        return ModelledRows(self.model, self.drives[index], self.start[index])

    def with_model(self, model: MeasurementModel) -> ModelledRows:
        """Return the same rows for another measurement model of the same robot."""
        return ModelledRows(model, self.drives, self.start)

    def predict(self, unknowns: Unknowns) -> Prediction:
        """Close the loops and return what the tracker should see.

        Raises:
            BadInputError: the number of values does not fit, or one is not finite.
        """
        closure, _ = self._close(unknowns)
        outer, inner = unknowns.outer, unknowns.inner
        arm = closure.position + closure.rotation @ inner.translation
        return Prediction(
            outer.translation + arm @ outer.rotation.T,
            outer.rotation @ closure.rotation @ inner.rotation,
            closure.status,
            closure,
        )

    def linearise(self, unknowns: Unknowns) -> Prediction:
        """Return the same with the analytic Jacobian, exact at any residual of the loops.

        Raises:
            BadInputError: the number of values does not fit, or one is not finite.
        """
        return self.differentiate(unknowns, self.predict(unknowns))

    def differentiate(self, unknowns: Unknowns, prediction: Prediction) -> Prediction:
        """Return a prediction for these unknowns with its Jacobian added; rows that are singular get status 1."""
        errors = self.model.placement_errors(unknowns.parameters)
        closure = prediction.closure
        parameters = self.model.moved_parameters(errors)
        transfer = self.model.engine.transfer(closure, parameters, errors.ravel())
        outer, inner = unknowns.outer, unknowns.inner
        jacobian = np.zeros((len(self), 6, FRAMES + len(parameters)))
        arm = closure.rotation @ inner.translation
        base_turn = outer.rotation @ right_jacobian(unknowns.values[3:6])
        jacobian[:, :3, 0:3] = unknowns.pose_tracker_to_fixed_platform.rotation
        jacobian[:, :3, 3:6] = -outer.rotation @ skew(closure.position + arm) @ right_jacobian(unknowns.values[3:6])
        jacobian[:, 3:, 3:6] = base_turn
        carried = outer.rotation @ closure.rotation
        turn = unknowns.values[9:12]
        left = right_jacobian(-turn)  # the left Jacobian of w is the right one of -w
        lever = pin.exp3(turn) @ unknowns.pose_platform_to_target.translation
        jacobian[:, :3, 6:9] = carried
        jacobian[:, :3, 9:12] = -carried @ skew(lever) @ left
        jacobian[:, 3:, 9:12] = carried @ left
        matrix = transfer.matrix
        shifted = matrix[:, :3] - skew(arm) @ matrix[:, 3:]
        jacobian[:, :3, FRAMES:] = outer.rotation @ shifted
        jacobian[:, 3:, FRAMES:] = outer.rotation @ matrix[:, 3:]
        jacobian[transfer.status != 0] = np.nan
        return replace(prediction, jacobian=jacobian, status=transfer.status)

    def _close(self, unknowns: Unknowns) -> tuple[BatchClosure, FloatArray]:
        model = self.model
        if unknowns.values.shape != (FRAMES + len(model.parameters),) or not np.isfinite(unknowns.values).all():
            raise BadInputError(
                f"the unknowns must be {FRAMES + len(model.parameters)} finite values, not {unknowns.values.shape}"
            )
        errors = model.placement_errors(unknowns.parameters)
        drives = self.drives + model.drive_errors(unknowns.parameters)
        return model.engine.close(drives, self.start, errors.ravel()), errors


def _displacement(twist: FloatArray) -> pin.SE3:
    return pin.SE3(pin.exp3(np.asarray(twist[3:], dtype=float)), np.asarray(twist[:3], dtype=float))
