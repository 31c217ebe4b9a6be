"""The measurement model: what the tracker sees of the robot as built, and its derivatives by every unknown.

    Y = T_tracker_base ∘ D(base) ∘ X(drives, parameters) ∘ D(tool) ∘ T_end_target

X closes the loops of the present robot with its local parameters added; D(v, w) = SE3(exp(w), v). The unknowns are in
the order [base tx ty tz rx ry rz | tool tx ty tz rx ry rz | parameters], in m and rad. ``base`` displaces the fixed
platform in its own axes from where the tracker was assumed to see it; ``tool`` displaces the target in the moving
platform's axes. A local parameter displaces the *present* placement of its joint (see
:mod:`pouring_robot.mechanism.local_parameters`), several at one joint by D of the sum of their twists.

    model = MeasurementModel(RobotModel(), parameters)
    poses = model.at(drives)                       # rows to predict, (n, 4) in m and rad
    seen = poses.linearise(Unknowns.zero(frames, len(parameters)))
    seen.position_m, seen.rotation, seen.jacobian, seen.status
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from pouring_robot.batch import BatchClosure, BatchStart, Engine, engine_for
from pouring_robot.campaign.nominal import PoseStack
from pouring_robot.estimation.changes import RowChanges
from pouring_robot.estimation.frames.outer import FRAME_PARAMETERS, FRAME_STD, FRAMES, OuterFrames, displaced_columns
from pouring_robot.estimation.frames.sessions import SessionParameter, base_displacements, numbers_of
from pouring_robot.exceptions import BadInputError, CalibrationError
from pouring_robot.mechanism.arrays import BoolArray, FloatArray, Indices
from pouring_robot.mechanism.closure.solver import DEFAULT_OPTIONS
from pouring_robot.mechanism.closure.status import CLOSED
from pouring_robot.mechanism.local_parameters import (
    DriveParameter,
    GeometricParameter,
    LocalParameter,
    PlacementParameter,
    placements,
)
from pouring_robot.mechanism.rotations import rotation_matrices, skew
from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.tolerances import Tolerances

_HELD_STD = 1e-9  # m and rad: of frames where nothing was measured from outside


@dataclass(frozen=True, eq=False)
class Unknowns:
    """Values of all unknowns."""

    start: OuterFrames  # the outer frames to which displacements are relative
    # displacements from there, parameter values, and six displacements of the base per session that has frames of its
    # own, shape (12 + P,), in m and rad; see the module
    values: FloatArray

    @classmethod
    def zero(cls, frames: OuterFrames, parameters: int) -> Unknowns:
        """Return the given frames with all parameters, and displacements of sessions, zero."""
        return cls(frames, np.zeros(FRAMES + parameters))

    def at(self, values: FloatArray) -> Unknowns:
        """Return other values relative to the same frames."""
        return replace(self, values=np.asarray(values, dtype=float))

    @property
    def parameters(self) -> FloatArray:
        """Parameter values, shape (P,), in m and rad."""
        return self.values[FRAMES:]

    @property
    def frames(self) -> OuterFrames:
        """The outer frames, their displacements included."""
        return self.start.moved(self.values)


class Differentiated:
    """Something that may have a Jacobian by the unknowns."""

    jacobian: FloatArray | None

    @property
    def derivatives(self) -> FloatArray:
        """The Jacobian; raises BadInputError if only the prediction was requested."""
        if self.jacobian is None:
            raise BadInputError("the prediction holds no Jacobian; ask for it with linearise")
        return self.jacobian


@dataclass(frozen=True, eq=False)
class Prediction(PoseStack, Differentiated):
    """What the tracker should see in n rows: poses of the target in its frame, NaN where a row does not close."""

    status: NDArray[np.uint8]  # codes of :mod:`~pouring_robot.mechanism.closure.status`
    closure: BatchClosure  # the closed loops
    # displacement of the target's origin (m) and rotation vector (rad), both in tracker axes, per unit of each unknown,
    # shape (n, 6, 12 + P); None where only the prediction was requested
    jacobian: FloatArray | None = None
    disagreement: FloatArray | None = None  # likewise for what r redundant drives disagree by, in m, (n, r, 12 + P)

    @classmethod
    def of(
        cls, closure: BatchClosure, frames: OuterFrames, base: FloatArray | None = None, scale: FloatArray | None = None
    ) -> Prediction:
        """Return closed loops as seen by the tracker; displacements row by row as in :meth:`OuterFrames.seen`."""
        seen = frames.seen(PoseStack(closure.position, closure.rotation), base, scale)
        return cls(seen.position_m, seen.rotation, closure.status, closure)

    @property
    def poses(self) -> PoseStack:
        """The poses of the end body in the base."""
        return PoseStack(self.closure.position, self.closure.rotation)

    @property
    def closed(self) -> BoolArray:
        """Which rows have a prediction, shape (n,)."""
        return np.asarray(self.status == CLOSED)


class MeasurementModel:
    """Predicts measurements of one robot with a chosen set of parameters. Safe to use from several threads.

    Parameters of placements (also DH parameters, as :attr:`DHParameter.local`) and drives are added to the errors of
    the present robot; unknowns of sessions with frames of their own, six each, come after all others. By default one
    thread per core shares the work; results do not depend on it.

    Raises:
        UnknownJointError: a parameter names a joint that is in no chain.
        BadInputError: a parameter is of another kind, or is given twice.
    """

    def __init__(
        self,
        model: RobotModel,
        parameters: Sequence[GeometricParameter],
        threads: int | None = None,
        sessions: Sequence[SessionParameter] = (),
    ) -> None:
        self.model, self.threads, self.sessions = model, threads, tuple(sessions)
        # A trial step of a search may change the robot far; no assembly mode needs to be followed there.
        self.engine = engine_for(model.mechanism(), threads, replace(DEFAULT_OPTIONS, most_steps=1))
        self.drawing = model.definition.drawing()
        self._choose(parameters)

    def _choose(self, parameters: Sequence[GeometricParameter]) -> None:
        structure = self.engine.structure
        self.parameters = tuple(parameters)
        unknowns = (*FRAME_PARAMETERS, *self.parameters, *self.sessions)
        self.names, self.units = tuple(p.name for p in unknowns), tuple(p.unit for p in unknowns)
        twice = {name for name in self.names if self.names.count(name) > 1}
        if twice:
            of_frames = twice & {p.name for p in FRAME_PARAMETERS}
            mend = "the joint is called as an outer frame is, rename it in the URDF" if of_frames else "name each once"
            raise BadInputError(f"parameter '{min(of_frames or twice)}' is given twice; {mend}")
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
        """Return the same robot with another choice of parameters, sharing the engine; raises as the class."""
        other = copy.copy(self)
        other._choose(parameters)
        return other

    def prior_std(self, tolerances: Tolerances, *, framed: bool = True) -> FloatArray:
        """Return the standard deviations of all unknowns before measuring, shape (12 + P,), in m and rad.

        Those of parameters are the tolerances of the robot's parts. Hardly anything is known about the frames, also
        those of sessions; the outer ones are held unless something was measured from outside (``framed``).
        """
        frames, others = np.full(FRAMES, FRAME_STD if framed else _HELD_STD), np.full(len(self.sessions), FRAME_STD)
        return np.concatenate([frames, tolerances.std(self.parameters, self.model.definition), others])

    def at(
        self, drives: FloatArray, start: BatchStart | None = None, sessions: Sequence[str] | None = None
    ) -> ModelledRows:
        """Return rows to predict: commanded drives (n, drives), in m and rad; the model's own offsets are added.

        Closing starts at the drawing's closed poses if no ``start`` is given. ``sessions`` are those of the rows where
        some have frames of their own; by default all are in the largest. Raises BadInputError for another shape.
        """
        drives = np.asarray(drives, dtype=float)
        count = len(self.engine.structure.mechanism.loops.drives)
        if drives.ndim != 2 or drives.shape[1] != count:
            raise BadInputError(f"drives must have the shape (n, {count}), not {drives.shape}")
        session = numbers_of(sessions or [""] * len(drives), self.sessions)
        return ModelledRows(self, drives, self.drawing.starts(drives) if start is None else start, session)

    def placement_errors(self, values: FloatArray) -> FloatArray:
        """Return the displacements of all sites for parameter values (P,): shape (sites, 6), in m and rad."""
        return np.asarray(self._twists @ values[: len(self.parameters)])

    def drive_errors(self, values: FloatArray) -> FloatArray:
        """Return what parameter values (P,) add to the drives: shape (drives,), in m and rad."""
        return np.asarray(self._drives @ values[: len(self.parameters)])

    def amended(self, values: FloatArray) -> RobotModel:
        """Return the present robot with parameter values (P,), in m and rad, added.

        Placements are composed exactly, drive offsets summed. Raises CalibrationError if the result is too large to be
        an error of a robot.
        """
        structure = self.engine.structure
        placed = placements(structure.site_joints, self.placement_errors(values))
        added = zip(structure.mechanism.loops.drives, self.drive_errors(values).tolist(), strict=True)
        drives = {name: own for name, own in added if own}
        amended = self.model.displaced(placed, drives)
        try:
            amended.check_errors()
        except BadInputError as problem:
            mend = "check units, drive zeros and stated noise of the campaign, or the model's layout"
            raise CalibrationError(f"the fit is not credible: {problem}", mend) from problem
        return amended

    def moved_parameters(self, errors: FloatArray) -> tuple[LocalParameter, ...]:
        """Return the parameters as twists of placements already displaced by ``errors`` (sites, 6).

        exp(w + dw) turns by the right Jacobian of w, and dv is expressed in the rotated axes.
        """
        maps = {
            site: (pin.exp3(errors[site, 3:]).T, pin.Jexp3(errors[site, 3:]))
            for site in np.flatnonzero(errors[:, 3:].any(axis=1)).tolist()
        }
        moved: list[LocalParameter] = []
        for parameter, site in zip(self.parameters, self._sites.tolist(), strict=True):
            if isinstance(parameter, PlacementParameter) and site in maps:
                linear, angular = maps[site]
                twist = (*(linear @ parameter.twist[:3]).tolist(), *(angular @ parameter.twist[3:]).tolist())
                moved.append(PlacementParameter(parameter.name, parameter.unit, parameter.joint, twist))
            else:
                moved.append(parameter)
        return tuple(moved)

    def differentiated(
        self,
        prediction: Prediction,
        frames: OuterFrames,
        parameters: Sequence[LocalParameter],
        errors: FloatArray,
        base: FloatArray | None = None,
    ) -> Prediction:
        """Return a prediction, for the same frames and base, with its Jacobian by the frames at zero and by parameters.

        Each parameter has a column after the frames and is added to ``errors``, the displacements of all sites,
        (sites * 6,) or row by row (n, sites * 6), in m and rad. Singular rows have that status and no Jacobian.
        """
        transfer, poses = self.engine.transfer(prediction.closure, parameters, errors), prediction.poses
        jacobian = np.empty((len(poses), 6, FRAMES + len(parameters)))
        jacobian[:, :, :FRAMES] = frames.jacobian(poses, base)
        frames.carried(transfer.matrix, poses, base, out=jacobian[:, :, FRAMES:])
        jacobian[transfer.status != CLOSED] = np.nan
        disagreement = transfer.disagreement
        if disagreement is not None:  # it does not depend on the frames
            disagreement = np.pad(disagreement, ((0, 0), (0, 0), (FRAMES, 0)))
        return replace(prediction, jacobian=jacobian, disagreement=disagreement, status=transfer.status)


@dataclass(frozen=True, eq=False)
class ModelledRows:
    """Rows of a campaign or plan, ready to be predicted."""

    model: MeasurementModel  # the measurement model
    drives: FloatArray  # commanded drives, with what is changed in each row, shape (n, drives), in m and rad
    start: BatchStart  # where to start closing
    session: Indices  # number of each row's session among those with frames of their own, (n,); -1: none
    changes: RowChanges | None = None  # what the effects of the robot's model change in each row; None: nothing

    def __len__(self) -> int:
        return len(self.drives)

    def __getitem__(self, rows: Indices | BoolArray) -> ModelledRows:
        index: NDArray[np.int64] = np.arange(len(self))[rows]
        changes = self.changes[index] if self.changes else None
        return ModelledRows(self.model, self.drives[index], self.start[index], self.session[index], changes)

    def with_changes(self, changes: RowChanges) -> ModelledRows:
        """Return the same rows with the changes in each, to first order in the rotations at one joint."""
        return replace(self, drives=self.drives + changes.drives, changes=changes)

    def with_parameters(self, parameters: Sequence[GeometricParameter]) -> ModelledRows:
        """Return the same rows of the same robot with another choice of parameters."""
        return replace(self, model=self.model.with_parameters(parameters))

    def present(self) -> BatchClosure:
        """Close the loops of the present robot, with all parameters zero."""
        placed = self.changes.placements if self.changes else None
        return self.model.engine.close(self.model.model.actual_drive_values(self.drives), self.start, placed)

    def by_drawing(self) -> tuple[Engine, BatchClosure]:
        """Close the loops of the drawing, which has no errors; return its engine, too."""
        present, model = self.model, self.model.model
        engine = present.engine
        if not model.is_drawing:
            engine = engine_for(model.definition.mechanism(), present.threads)
        return engine, engine.close(self.drives, self.start)

    def predict(self, unknowns: Unknowns) -> Prediction:
        """Close the loops and return what the tracker should see; raises BadInputError for values of a wrong shape."""
        model = self.model
        if unknowns.values.shape != (len(model.names),) or not np.isfinite(unknowns.values).all():
            raise BadInputError(f"the unknowns must be {len(model.names)} finite values, not {unknowns.values.shape}")
        errors = model.placement_errors(unknowns.parameters)
        drives = model.model.actual_drive_values(self.drives) + model.drive_errors(unknowns.parameters)
        closure = model.engine.close(drives, self.start, self._placed(errors))
        scale = self.changes.scale if self.changes else None
        return Prediction.of(closure, unknowns.frames, self._base(unknowns), scale)

    def _placed(self, errors: FloatArray) -> FloatArray:
        """Return the displacements of sites, (sites * 6,), or row by row, (n, sites * 6), from those by parameters."""
        return errors.ravel() + self.changes.placements if self.changes else errors.ravel()

    def _base(self, unknowns: Unknowns) -> FloatArray | None:
        """Return the displacement of the base in each row, (n, 6); None where all rows see it in the same place."""
        count = len(self.model.sessions)
        if not count:
            return self.changes.base if self.changes else None
        own = base_displacements(unknowns.values[-count:], self.session)
        return own + self.changes.base if self.changes else own

    def linearise(self, unknowns: Unknowns) -> Prediction:
        """Return the same with the analytic Jacobian, exact at any residual of the loops; raises as :meth:`predict`.

        To first order in the row-by-row changes: their rotation of a joint leaves the axes of parameters unchanged.
        """
        return self.differentiate(unknowns, self.predict(unknowns))

    def differentiate(self, unknowns: Unknowns, prediction: Prediction) -> Prediction:
        """Return a prediction for these unknowns with its Jacobian added; singular rows get that status."""
        errors = self.model.placement_errors(unknowns.parameters)
        parameters = self.model.moved_parameters(errors)
        base = self._base(unknowns)
        found = self.model.differentiated(prediction, unknowns.frames, parameters, self._placed(errors), base)
        jacobian, disagreement = found.derivatives, found.disagreement
        if base is not None:
            jacobian = self._by_session(jacobian, unknowns, prediction, base)
            if disagreement is not None:
                disagreement = np.pad(disagreement, ((0, 0), (0, 0), (0, len(self.model.sessions))))
        if self.changes:
            jacobian[:, :3] *= 1.0 + self.changes.scale[:, None, None]
        jacobian[:, :, :FRAMES] = jacobian[:, :, :FRAMES] @ displaced_columns(unknowns.values)
        return replace(found, jacobian=jacobian, disagreement=disagreement)

    def _by_session(
        self, jacobian: FloatArray, unknowns: Unknowns, prediction: Prediction, base: FloatArray
    ) -> FloatArray:
        """Return the Jacobian with the columns of sessions; a turn of the base then also turns their displacements."""
        outer = unknowns.frames.T_tracker_base.rotation
        places = unknowns.frames.places(prediction.poses)
        displaced = (rotation_matrices(base[:, 3:]) @ places[..., None])[..., 0] + base[:, :3]
        own = jacobian[:, :, :6].copy()
        own[:, :, 3:] = own[:, :, 3:] @ np.array([pin.Jexp3(turn) for turn in base[:, 3:]])
        jacobian[:, :3, 3:6], jacobian[:, 3:, 3:6] = -outer @ skew(displaced), outer
        count = len(self.model.sessions) // 6
        columns = [own * (self.session == k)[:, None, None] for k in range(count)]
        return np.concatenate([jacobian, *columns], axis=2)
