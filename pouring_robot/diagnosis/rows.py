"""Rows of a campaign as the robot predicts them, with local parameters changed row by row; linearised at any state.

    seen_i = T_tracker_base ∘ D(base_i) ∘ X(drives + dq_i, placements ∘ D(e_i)) ∘ T_end_target

X closes the loops exactly; positions are then multiplied by (1 + scale_i), about the tracker's own origin. The columns
of an effect are the Jacobian by local parameters times the changes that one unit of each parameter makes.
"""

from __future__ import annotations

import copy
import functools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Self

import numpy as np
import scipy.sparse

from pouring_robot.campaign.data import Campaign
from pouring_robot.effects.base import EffectParameter, channel
from pouring_robot.effects.conditions import conditions_of, of_commands
from pouring_robot.effects.nominal_rows import NominalRows, nominal_rows
from pouring_robot.effects.stack_in_rows import changes_by_stack, local_changes, stack_of
from pouring_robot.estimation.changes import SCALE, RowChanges
from pouring_robot.estimation.first_frames import first_frames
from pouring_robot.estimation.frames.outer import FRAME_STD, FRAMES, OuterFrames
from pouring_robot.estimation.frames.sessions import base_displacements, numbers_of, session_parameters
from pouring_robot.estimation.kinds import are
from pouring_robot.estimation.measurement import MeasurementModel, ModelledRows, Prediction
from pouring_robot.estimation.noise import NoiseLevel
from pouring_robot.estimation.residuals import MeasuredPoses, WhitenedEquations, whiten
from pouring_robot.exceptions import BadInputError, DiagnosisError
from pouring_robot.inference.gaussian_processes.processes import Channel
from pouring_robot.mechanism.arrays import BoolArray, FloatArray, Indices
from pouring_robot.mechanism.local_parameters import COMPONENTS, GeometricParameter, LocalParameter
from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.parameter_catalogue import ParameterCatalogue

_FRAME_STEPS = 3


def local_parameters(model: RobotModel) -> tuple[GeometricParameter, ...]:
    """Return all local parameters an effect may change inside the mechanism."""
    catalogue = ParameterCatalogue(model.definition)
    return (*catalogue.drives, *catalogue.placements)


def channel_names(inside: Iterable[LocalParameter]) -> frozenset[str]:
    """Return the names of what effects may change: local parameters, the base, the device's scale."""
    return frozenset((*(p.name for p in inside), *(f"base.{component}" for component in COMPONENTS), SCALE))


@dataclass(frozen=True, eq=False)
class OuterAndSessionFrames(OuterFrames):
    """The two frames, and the displacement of the base in sessions that have frames of their own."""

    sessions: FloatArray  # displacement of the base for each session but the largest, (6 s,), in m and rad

    def moved(self, values: FloatArray) -> OuterAndSessionFrames:
        """Return them displaced by the twelve unknowns, then six for each session, (12 + 6 s,), in m and rad."""
        outer = super().moved(values[:FRAMES])
        return OuterAndSessionFrames(outer.T_tracker_base, outer.T_end_target, self.sessions + values[FRAMES:])


@dataclass(frozen=True, eq=False)
class WhitenedRows:
    """Residuals at one state."""

    residual: FloatArray  # measured minus predicted, divided by the noise, shape (m,)
    row: Indices  # row of each equation, (m,)
    component: Indices  # component of each equation, as in ``estimation/kinds.py``, (m,)
    sigma: FloatArray  # noise of each equation's component, (m,), in m or rad

    def of(self, rows: BoolArray) -> Self:
        """Return the equations of some rows, by a mask (n,); of all rows itself, as derivatives take much memory."""
        return self if rows.all() else self.some(rows[self.row])

    def some(self, equations: slice | BoolArray) -> Self:
        """Return some of the equations."""
        return replace(self, **{field.name: getattr(self, field.name)[equations] for field in fields(self)})

    @property
    def alone(self) -> WhitenedRows:
        """The same rows without derivatives."""
        return WhitenedRows(self.residual, self.row, self.component, self.sigma)


@dataclass(frozen=True, eq=False)
class LinearRows(WhitenedRows):
    """Residuals and their derivatives at one state."""

    # derivative of the *prediction*, over the noise, by frames and local parameters, shape (m, 12 + P)
    jacobian: FloatArray
    # likewise by the frames, without the motion of the base from row to row that was found, (m, 12)
    still: FloatArray
    scale: FloatArray  # derivative of the prediction by the device's scale, (m,)
    own: BoolArray  # whether an equation is of a session with frames of its own, (m, s)
    start: Indices  # row from which an equation's reading starts, (m,); its own row where there is none
    # that row's part of jacobian and scale, (m, 12 + P + 1); without columns where no reading starts from another row
    by_start: FloatArray

    @property
    def frame_columns(self) -> FloatArray:
        """Columns of the frames, then of the base in each session, (m, 12 + 6 s), in units of 1/m and 1/rad."""
        return self._with_sessions(self.jacobian[:, :FRAMES])

    def _with_sessions(self, frames: FloatArray) -> FloatArray:
        """Return columns of the frames, (m, 12), and those of the base in each session with its own, (m, 12 + 6 s)."""
        return np.hstack([frames, *(frames[:, :6] * own[:, None] for own in self.own.T)])

    @functools.cached_property
    def observable(self) -> FloatArray:
        """Directions of the frames that are free, (12 + 6 s, r); see :func:`observable_directions`.

        The motion of the base from row to row is excluded: where the base turns with time, an error of the target's
        position changes the readings with time, too. Left free, that position would be metres off to fit the drift.
        """
        return observable_directions(self._with_sessions(self.still))

    @property
    def free(self) -> FloatArray:
        """Columns of the frames along the directions that are free, (m, r)."""
        return self.frame_columns @ self.observable

    @property
    def held(self) -> FloatArray:
        """Columns of the frames along the other directions, (m, 12 + 6 s), times their prior standard deviation.

        They change the prediction only as far as the base turns from row to row.
        """
        return FRAME_STD * (self.frame_columns - self.free @ self.observable.T)

    def frame_step(self, left: FloatArray) -> FloatArray:
        """Return the least-squares step of the frames for residuals (m,), (12 + 6 s,), in m and rad.

        Along the directions that are free. The prior :data:`FRAME_STD` makes the solution unique, as in calibration.
        """
        columns = self.free
        prior = np.eye(columns.shape[1]) / FRAME_STD
        padded = np.concatenate([left, np.zeros(len(prior))])
        return np.asarray(self.observable @ np.linalg.lstsq(np.vstack([columns, prior]), padded, rcond=None)[0])


@dataclass(frozen=True, eq=False)
class ClosedRows:
    """Rows with changes put in: their loops closed, but not differentiated yet."""

    frames: OuterAndSessionFrames  # for the prediction
    before: RowChanges  # changes that were there before
    total: RowChanges  # with the changes put in
    prediction: Prediction  # of the readings
    alone: WhitenedRows  # residuals against it


def observable_directions(columns: FloatArray) -> FloatArray:
    """Return the directions (k, r) of unknowns about which rows say more than the prior, from columns (m, k).

    Along one about which they say less than :data:`FRAME_STD`, the prediction changes by less than its noise. Left
    free, such a direction (tracker and target about an axis that all rows share) would explain second-order terms.
    """
    _, sizes, directions = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(directions[sizes > 1.0 / FRAME_STD].T)


class CampaignRows:
    """The rows of a campaign, all usable and sound, against one robot with its errors, to which effects are added.

    Raises:
        FrameFitError: too few rows.
        DiagnosisError: a row does not close, here or with the changes that it is linearised with.
    """

    def __init__(self, campaign: Campaign, model: RobotModel, noise: NoiseLevel) -> None:
        self.campaign, self.model, self.noise = campaign, model, noise
        self.measurement = MeasurementModel(model, local_parameters(model))
        self._places = {name: k for k, name in enumerate(self.measurement.names)}
        self.measured = MeasuredPoses.from_campaign(campaign, noise)
        modelled = self.measurement.at(campaign.drives)
        self._drives = model.actual_drive_values(campaign.drives)
        sessions = session_parameters(campaign)
        self._session = numbers_of(campaign.sessions, sessions)
        first = first_frames(modelled, self.measured).frames
        self.frames = OuterAndSessionFrames(first.T_tracker_base, first.T_end_target, np.zeros(len(sessions)))
        self._nominal = self._by_the_drawing(modelled)
        self.conditions = conditions_of(campaign, self._nominal)
        structure = self.measurement.engine.structure
        self._given, self.not_learned = changes_by_stack(model, campaign, self._nominal, structure, DiagnosisError)

    def __len__(self) -> int:
        return len(self.campaign)

    def with_noise(self, noise: NoiseLevel) -> CampaignRows:
        """Return the same rows with another noise; they share all else."""
        other = copy.copy(self)
        other.noise, other.measured = noise, MeasuredPoses.from_campaign(self.campaign, noise)
        return other

    def _by_the_drawing(self, modelled: ModelledRows) -> NominalRows:
        """Return the rows of the drawing: conditions from it do not change when errors are put into the model."""
        engine, closure = modelled.by_drawing()
        if not closure.closed.all():
            raise DiagnosisError(
                f"{np.count_nonzero(~closure.closed)} of {len(self)} rows have drive values that no pose has",
                "leave them out (`pouring-robot campaign check` lists them)",
            )
        self._start = closure.as_start()
        return nominal_rows(self.model.definition, engine, closure)

    def not_told_by_commands(self, model: RobotModel) -> tuple[str, ...]:
        """Return the effects of a model that commands alone do not determine in these rows, by id.

        Effects of the measuring device do not change a command.
        """
        bare = replace(self.campaign, approach=None, force=None, conditions={}, sessions=("",) * len(self))
        found = []
        for effect in model.conditional:
            single = model.model_copy(update={"effects": [e for e in model.effects if e.effect == effect]})
            mine, _ = stack_of(single, self.campaign, self._nominal, seen=False)
            try:
                theirs, _ = stack_of(single, bare, self._nominal, of_commands, seen=False)
            except BadInputError:  # the model as a whole was accepted, so a condition is missing
                found.append(effect)
                continue
            if any(not np.array_equal(change, theirs[name]) for name, change in mine.items()):
                found.append(effect)
        return tuple(found)

    def unchanged(self) -> RowChanges:
        """Return an empty change."""
        return RowChanges.of({}, self.measurement.engine.structure, len(self))

    def changes(self, parameters: Sequence[EffectParameter], values: FloatArray) -> RowChanges:
        """Return the total change by effects' parameters under this campaign's conditions.

        There is one value for each parameter, in its unit.
        """
        local = local_changes(parameters, values.tolist())
        return RowChanges.of(local, self.measurement.engine.structure, len(self))

    def refined_frames(self, fitted: BoolArray) -> OuterAndSessionFrames:
        """Return the least-squares frames of some rows, by a mask (n,), with the effects that the model has."""
        frames = self.frames
        for _ in range(_FRAME_STEPS):
            linear = self.linearise(self.unchanged(), frames).of(fitted)
            step = linear.frame_step(linear.residual)
            frames = frames.moved(step)
            if not step.any():  # closures do not depend on them
                break
        return frames

    def linearise(self, changes: RowChanges, frames: OuterAndSessionFrames) -> LinearRows:
        """Close the loops with changes put in, and differentiate."""
        return self.linearised(self.seen(changes, frames))

    def seen(self, changes: RowChanges, frames: OuterAndSessionFrames) -> ClosedRows:
        """Close the loops with changes put in; raises DiagnosisError where some rows do not."""
        before = replace(self._given, base=self._given.base + base_displacements(frames.sessions, self._session))
        total = before + changes
        prediction = self._predicted(total, frames)
        left = self._whitened(prediction)
        alone = WhitenedRows(left.residual, left.rows, left.components, self.measured.sigma[left.components])
        return ClosedRows(frames, before, total, prediction, alone)

    def _whitened(self, prediction: Prediction) -> WhitenedEquations:
        """Return the equations of all rows; raises DiagnosisError where some have no prediction."""
        equations = whiten(self.measured, prediction)
        if equations.failed.size:
            raise DiagnosisError(
                f"{equations.failed.size} rows do not close with the changes found",
                "check the campaign with `pouring-robot campaign check`",
            )
        return equations

    def linearised(self, there: ClosedRows) -> LinearRows:
        """Differentiate rows at their state; raises DiagnosisError where some are singular there."""
        frames, total, model = there.frames, there.total, self.measurement
        seen = model.differentiated(there.prediction, frames, model.parameters, total.placements, total.base)
        equations = self._whitened(seen)
        jacobian = equations.derivatives
        # The device's scale multiplies positions about the tracker's own origin.
        stretched = self.measured.stretched(seen) / (1.0 + total.scale[:, None])
        sigma = self.measured.sigma[equations.components]
        scale = stretched[equations.rows, equations.components] / sigma
        own = self._session[equations.rows, None] == np.arange(len(frames.sessions) // 6)
        disagreement = seen.disagreement if seen.disagreement is None else seen.disagreement[..., :FRAMES]
        at_rest = replace(seen, jacobian=frames.jacobian(seen.poses, there.before.base), disagreement=disagreement)
        still = whiten(self.measured, at_rest).derivatives
        prediction = np.negative(jacobian, out=jacobian)
        rows, start, by_start = equations.rows, equations.rows.copy(), np.zeros((len(sigma), 0))
        for instrument in self.measured.others:
            if (found := instrument.starts(seen)) is None:
                continue
            some = np.flatnonzero(are(instrument.kind, equations.components) & (found.row[rows] >= 0))
            start[some], by_start = found.row[rows[some]], np.zeros((len(sigma), prediction.shape[1] + 1))
            stretched = found.stretched[rows[some]] / (1.0 + total.scale[start[some]])
            by_start[some] = np.column_stack([found.jacobian[rows[some]], stretched]) / sigma[some, None]
        return LinearRows(
            equations.residual,
            rows,
            equations.components,
            sigma,
            prediction,
            -still,
            scale,
            own,
            start,
            by_start,
        )

    def predicted(self, changes: RowChanges, frames: OuterFrames) -> Prediction:
        """Close the loops with changes put in and return the prediction; rows that do not close are NaN."""
        return self._predicted(self._given + changes, frames)

    def _predicted(self, total: RowChanges, frames: OuterFrames) -> Prediction:
        closure = self.measurement.engine.close(self._drives + total.drives, self._start, total.placements)
        return Prediction.of(closure, frames, total.base, total.scale)

    @property
    def channels(self) -> frozenset[str]:
        """Names of all local parameters that effects may change in these rows."""
        return channel_names(self.measurement.parameters)

    def column(self, parameter: EffectParameter, linear: LinearRows) -> FloatArray:
        """Return the whitened signature of one parameter, times its usual size, shape (m,)."""
        return parameter.prior_std * self.signature(parameter.changes, linear)

    def signature(self, changes: Mapping[str, FloatArray], linear: LinearRows) -> FloatArray:
        """Return the first-order change of the whitened prediction, (m,), by changes of local parameters, (n,) each."""
        total = np.zeros(linear.residual.size)
        for name, change in changes.items():
            total += self.channel(name, linear) * change[linear.row]
            if linear.by_start.size:  # the change may differ in that row
                total += self._by_start(name, linear) * (change[linear.start] - change[linear.row])
        return total

    def _by_start(self, name: str, linear: LinearRows) -> FloatArray:
        """Return the part of :meth:`channel` that is due to the rows from which readings start, (m,)."""
        return linear.by_start[:, -1 if name == SCALE else self._places[name]]

    def moving(
        self, name: str, changes: Mapping[str, FloatArray], linear: LinearRows, sums: scipy.sparse.csr_array
    ) -> Channel:
        """Return the channel of changes of local parameters, (n,) each, of which some rows may have more.

        ``sums`` (n, m) are the row of each equation, as in a :class:`Channel`; a reading that starts from another row
        is moved by the change in that row, too.
        """
        column = self.signature(changes, linear)
        if not linear.by_start.size:
            return Channel(name, column, sums)
        by_start = np.zeros(len(column))
        for parameter, change in changes.items():
            by_start += self._by_start(parameter, linear) * change[linear.start]
        ends = np.concatenate([linear.row, linear.start]), np.tile(np.arange(len(column)), 2)
        shares = scipy.sparse.csr_array((np.concatenate([column - by_start, by_start]), ends), sums.shape)
        return Channel(name, np.sign(np.abs(column) + np.abs(by_start)), shares)

    def channel(self, name: str, linear: LinearRows) -> FloatArray:
        """Return the whitened signature of one local parameter, equal in all rows, shape (m,), per m or rad."""
        if name == SCALE:
            return linear.scale
        return np.ascontiguousarray(linear.jacobian[:, self._places[name]])  # a copy: a view would keep all columns

    def moving_drives(self, linear: LinearRows, sums: scipy.sparse.csr_array) -> tuple[Channel, ...]:
        """Return :meth:`moving` for a m or rad of every drive."""
        names, unit = map(channel, self.conditions.robot.drives), np.ones(len(self))
        return tuple(self.moving(name, {name: unit}, linear, sums) for name in names)


@dataclass(frozen=True, eq=False)
class Signatures:
    """Whitened signatures of parameters, times their usual size, (m, k), computed on request."""

    rows: CampaignRows
    parameters: Sequence[EffectParameter]
    linear: LinearRows

    @property
    def shape(self) -> tuple[int, ...]:
        """Equations and parameters, (m, k)."""
        return len(self.linear.residual), len(self.parameters)

    def __getitem__(self, some: slice | BoolArray) -> FloatArray:
        """Return the signatures in some equations, (some, k)."""
        linear = self.linear.some(some)
        return np.column_stack([self.rows.column(p, linear) for p in self.parameters])
