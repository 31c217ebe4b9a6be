"""From a campaign to a calibrated robot: check, split, choose, fit, test on held-out rows, fit to all rows."""

import functools
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np

from pouring_robot.calibration.findings import CalibrationFindings
from pouring_robot.calibration.metrics import (
    LadleUncertainty,
    Misfit,
    ladle_uncertainty,
    pose_performance,
    workspace_rows,
)
from pouring_robot.calibration.outliers import explains, outlier_flags, outlying_rows
from pouring_robot.calibration.selection import Refusal, Selection, acceptable, row_scores, select_groups
from pouring_robot.calibration.unfitted_parameters import UnfittedParameters
from pouring_robot.campaign.data import Campaign
from pouring_robot.checks.check import check_campaign
from pouring_robot.checks.flags import usable_without, where
from pouring_robot.effects.nominal_rows import nominal_rows
from pouring_robot.effects.stack_in_rows import changes_by_stack, rows_lacking_conditions
from pouring_robot.estimation.first_frames import first_frames
from pouring_robot.estimation.frames.outer import FRAMES
from pouring_robot.estimation.frames.sessions import session_parameters
from pouring_robot.estimation.identifiability import BaseParameters, base_parameters
from pouring_robot.estimation.map_fit import (
    Fit,
    FitOptions,
    campaign_and_model,
    identify,
    seen_from_one_place,
    settled_noise,
)
from pouring_robot.estimation.measurement import MeasurementModel, ModelledRows, Unknowns
from pouring_robot.estimation.noise import NoiseLevel, noise_beforehand, repeats
from pouring_robot.estimation.residuals import MeasuredPoses, regressor, whiten
from pouring_robot.estimation.splits import BLOCKS, HoldOut, Split, blocks, split
from pouring_robot.exceptions import CalibrationError
from pouring_robot.inference.gross_errors import ROUNDS
from pouring_robot.io.argument_checks import Options, expect
from pouring_robot.io.progress import Progress, say_nothing
from pouring_robot.io.threads import one_blas_thread
from pouring_robot.mechanism.arrays import FloatArray, Indices
from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.parameter_catalogue import ParameterCatalogue, ParameterGroup, all_parameters
from pouring_robot.robot.tolerances import Tolerances


@dataclass(frozen=True)
class CalibrationOptions(Options):
    """What to identify and how; values of a wrong type raise BadInputError."""

    parameters: str | tuple[str, ...] = ("geometry",)  # sets, groups, patterns; each a group kept or dropped as a whole
    tolerances: Tolerances | None = None  # priors, such as Tolerances.load reads; by default the shipped ones
    hold_out: HoldOut = "auto"  # what kind of blocks to hold out
    choose: bool = True  # whether groups are kept only where they help held-out rows; otherwise all are kept
    fit: FitOptions = field(default_factory=FitOptions)
    threads: int | None = None  # how many share the work; by default one per core


@dataclass(frozen=True, eq=False, repr=False)
class Calibration(CalibrationFindings):
    """A calibrated robot and everything that says how far to trust it; fields as :class:`CalibrationFindings`."""

    def save(self, folder: Path | str, *, overwrite: bool = False) -> list[Path]:
        """Write model file, URDF with meshes, ``calibration.json`` and ``report.html`` into a folder, all or none.

        Returns the files; raises OutputError if the folder cannot be written to, or one of them is there already and
        ``overwrite`` is not set.
        """
        from pouring_robot.calibration.report import write_calibration

        return write_calibration(self, folder, overwrite=overwrite)


@one_blas_thread()
def calibrate(
    campaign: Campaign | Path | str,
    model: RobotModel | Path | str | None = None,
    options: CalibrationOptions | None = None,
    progress: Progress = say_nothing,
) -> Calibration:
    """Calibrate a robot with a campaign, or the table of one; parameters are added to the errors of its model.

    Effects of the model that depend on conditions are applied under those of the campaign.

    Raises:
        CampaignError: the data are wrong as a whole (units, frames, columns); ``campaign check`` says more.
        FrameFitError: too few rows.
        CalibrationError: too few rows, the fit fails, or an effect of the model needs a condition that the campaign
            does not have; there is nothing to export.
        BadInputError: the parameters or tolerances are wrong.
    """
    options = options or CalibrationOptions()
    expect(options, CalibrationOptions, "options of a calibration are CalibrationOptions")
    campaign, model = campaign_and_model(campaign, model)
    tolerances = options.tolerances or Tolerances.of(model.definition)
    candidates = ParameterCatalogue(model.definition).groups(options.parameters)
    sessions = session_parameters(campaign)
    campaign = seen_from_one_place(campaign, model)
    progress("checking the data", 0, 0)
    flags = tuple(check_campaign(campaign, model.definition.drawing()))
    lost = rows_lacking_conditions(model, campaign)
    left_out = functools.reduce(np.union1d, lost.values(), usable_without(campaign, flags))
    parts = split(campaign, left_out, options.hold_out)
    everything = MeasurementModel(model, all_parameters(candidates), options.threads, sessions)
    rows = everything.at(campaign.drives, sessions=campaign.sessions)
    rows, not_learned = _under_effects(rows, campaign) if model.conditional else (rows, ())
    said = "left out, as effects of the model depend on {} and other rows do not determine it: {}"
    not_learned += tuple(said.format(heading, where(campaign, some)) for heading, some in lost.items())
    noise = noise_beforehand(campaign, parts.train)
    task = _Task(campaign, rows, parts, left_out, tolerances, options.fit, noise).with_noise_settled(progress)
    task = task.without_gross_errors(options.hold_out, progress)
    parts, wrong = task.parts, np.setdiff1d(task.left_out, left_out)
    left_out = task.left_out
    selection = Selection(candidates, ())
    if options.choose:
        selection = select_groups(rows, task.measured, parts, candidates, tolerances, options.fit, progress)
    present = task.fitted(())
    progress("fitting", 0, 0)
    answer = task.fitted(selection.groups) if selection.groups else present
    progress("judging", 0, 0)
    refused = task.refusal(selection, present, answer) if options.choose and selection.groups else None
    if refused:
        selection, answer = replace(selection, groups=()), present
    alike = repeats(campaign, np.setdiff1d(np.flatnonzero(campaign.usable), left_out))
    progress("fitting all rows", 0, 0)
    # What held-out rows have tested is delivered as all rows determine it.
    whole = task.of_all_rows().with_noise_settled(progress)
    final = whole.fitted(selection.groups)
    base, rank_anywhere = whole.identifiable(final)
    dropped = whole.dropped(final, [group for group in candidates if group not in selection.groups])
    ladle, ladle_measured = whole.ladle(final, dropped)
    return Calibration(
        campaign=campaign,
        present=model,
        calibrated=final.rows.model.amended(final.fit.unknowns.parameters),
        flags=(*flags, *outlier_flags(campaign, wrong, task.off(wrong))),
        left_out=left_out,
        split=parts,
        noise=whole.noise,
        noise_of_test=task.noise,
        candidates=candidates,
        selection=selection,
        refused=refused,
        not_learned=not_learned,
        fit=final.fit,
        unknown_units=final.rows.model.units,
        before=present.left,
        after=answer.left,
        base=base,
        rank_anywhere=rank_anywhere,
        in_place_of_dropped=dropped.kept_moves,
        ladle=ladle,
        ladle_measured=ladle_measured,
        performance=pose_performance(task.measured, present.left, answer.left, alike),
    )


class _Answer(NamedTuple):
    """The result of a fit of some groups."""

    rows: ModelledRows  # all rows with these groups
    fit: Fit
    left: FloatArray  # measured minus predicted in all rows, (n, K)


@dataclass(frozen=True, eq=False)
class _Task:
    """A campaign, which of its rows are fitted, and how."""

    campaign: Campaign
    rows: ModelledRows  # all rows, with all candidate parameters
    parts: Split
    left_out: Indices
    tolerances: Tolerances
    options: FitOptions
    noise: NoiseLevel
    with_held_out: bool = False  # whether held-out rows are fitted, too

    @property
    def fitted_rows(self) -> Indices:
        """The rows that are fitted, ascending."""
        return self.parts.rows if self.with_held_out else self.parts.train

    @functools.cached_property
    def every(self) -> MeasuredPoses:
        """What was measured in all rows."""
        return MeasuredPoses.from_campaign(self.campaign, self.noise)

    @functools.cached_property
    def measured(self) -> MeasuredPoses:
        """The same without the rows that are left out."""
        return self.every.without(self.left_out)

    @functools.cached_property
    def fit_data(self) -> tuple[Indices, MeasuredPoses]:
        """The rows that are fitted, and what was measured in them."""
        return self.measured.among(self.fitted_rows)

    def _begun(self, rows: ModelledRows) -> tuple[ModelledRows, MeasuredPoses, Unknowns, FloatArray]:
        """Return what a fit starts from: fitted rows, what was measured in them, unknowns and their priors."""
        used, seen = self.fit_data
        fitted = rows[used]
        prior_std = rows.model.prior_std(self.tolerances, framed=self.measured.framed)
        return fitted, seen, first_frames(fitted, seen), prior_std

    def of_all_rows(self) -> Self:
        """Return the task with held-out rows fitted, too."""
        return replace(self, with_held_out=True, noise=noise_beforehand(self.campaign, self.parts.rows))

    def with_noise_settled(self, progress: Progress) -> Self:
        """Return the task with unstated noise taken from the residuals of a fit of all candidates."""
        if not self.noise.from_residuals:
            return self
        progress("estimating the noise from residuals", 0, 0)
        return replace(self, noise=settled_noise(*self._begun(self.rows), self.noise, self.options))

    def without_gross_errors(self, hold_out: HoldOut, progress: Progress) -> Self:
        """Return the task without the rows that a fit of all candidates does not explain, if it explains the others.

        Otherwise the model lacks something that shows in many rows, and none is known to be wrong.
        """
        found = tried = self
        for _ in range(ROUNDS):
            more = tried._outlying(np.setdiff1d(tried.left_out, self.left_out).size)
            if not more.size:
                break
            progress("leaving out rows that fit nothing", 0, 0)
            tried = tried._without(more, hold_out).with_noise_settled(progress)
            found = tried if tried.everything and explains(tried.everything) else found
        return found

    def _without(self, rows: Indices, hold_out: HoldOut) -> Self:
        """Return the task with more rows left out."""
        left_out = np.union1d(self.left_out, rows)
        try:
            parts = split(self.campaign, left_out, hold_out)
        except CalibrationError as few:
            said = f"without the rows that fit nothing ({where(self.campaign, rows)}) {few.problem}"
            raise CalibrationError(said, few.mend) from few
        return replace(self, parts=parts, left_out=left_out, noise=noise_beforehand(self.campaign, parts.train))

    def _outlying(self, gone: int) -> Indices:
        """Return the rows that are gross errors by a fit of all candidates; none where there is no such fit."""
        if self.everything is None:
            return np.zeros(0, dtype=np.intp)
        data = self.campaign, self.rows, self.measured, self.parts
        return outlying_rows(*data, self.everything, gone)

    @functools.cached_property
    def everything(self) -> Fit | None:
        """A fit of all candidates to the training rows; None where these do not allow one."""
        try:
            return identify(*self._begun(self.rows), self.options)
        except CalibrationError:
            return None

    def off(self, rows: Indices) -> FloatArray:
        """Return the largest error of each of rows (k,), over the noise, from a fit of all candidates to other rows."""
        if self.everything is None or not rows.size:
            return np.zeros(rows.size)
        left = self.every.residual(self.rows.predict(self.everything.unknowns))[rows]
        return np.asarray(np.nan_to_num(np.abs(left) / self.every.sigma).max(axis=1))

    def fitted(self, groups: Sequence[ParameterGroup]) -> _Answer:
        """Fit groups to the rows that are fitted."""
        chosen = self.rows.with_parameters(all_parameters(groups))
        fit = identify(*self._begun(chosen), replace(self.options, curvature=True))
        fit = replace(fit, noise=self.noise, stretches=self._stretches)
        return _Answer(chosen, fit, self.every.residual(chosen.predict(fit.unknowns)))

    @functools.cached_property
    def _stretches(self) -> tuple[Indices, ...]:
        """Stretches of time among the fitted rows, by index in these, which the jackknife leaves out in turn."""
        aside = np.setdiff1d(np.arange(len(self.campaign)), self.fitted_rows)
        stretches = [*blocks(self.campaign, "time", aside).values()]
        if self.rows.model.sessions:  # a part of each: without a whole session its frame would be unknown
            apart = (np.array_split(own, BLOCKS) for own in blocks(self.campaign, "session", aside).values())
            stretches = [np.concatenate(some) for some in zip(*apart, strict=True)]
        return tuple(np.flatnonzero(np.isin(self.fit_data[0], stretch)) for stretch in stretches)

    def refusal(self, selection: Selection, present: _Answer, answer: _Answer) -> Refusal | None:
        """Return why groups that were chosen are not kept; None where the held-out rows accept them."""
        test = self.parts.test
        scores = (row_scores(one.left[test], self.every.sigma) for one in (present, answer))
        if acceptable(*scores):
            return None
        names = tuple(group.name for group in selection.groups)
        return Refusal(names, Misfit.of(present.left[test]), Misfit.of(answer.left[test]))

    def identifiable(self, answer: _Answer) -> tuple[BaseParameters, int]:
        """Return what the fitted rows determine of the groups, and the rank with all the workspace measured, too."""
        used, seen = self.fit_data
        model, unknowns = answer.rows.model, answer.fit.unknowns
        start = unknowns.at(np.zeros_like(unknowns.values))
        shown = -whiten(seen, answer.rows[used].linearise(start)).derivatives
        workspace = self._anywhere(answer.rows)
        as_here = np.broadcast_to(self.measured.known[:, :6].any(axis=0), (len(workspace), 6))
        added = regressor(workspace.linearise(start), self.measured.sigma[:6], as_here)
        own_frames = [parameter.name for parameter in model.sessions]
        return (
            base_parameters(shown, model.names, lead=(*model.names[:FRAMES], *own_frames)),
            base_parameters(np.vstack([shown, added]), model.names).rank,
        )

    def _anywhere(self, rows: ModelledRows) -> ModelledRows:
        """Return commands all over the workspace; with redundant drives only the rows' are known to be consistent."""
        return rows if self.campaign.redundant_drives else workspace_rows(rows.model)

    def dropped(self, answer: _Answer, groups: Sequence[ParameterGroup]) -> UnfittedParameters:
        """Return how the groups that an answer lacks affect it."""
        return UnfittedParameters.beside(
            answer.fit, answer.rows, self.fit_data, all_parameters(groups), self.tolerances
        )

    def ladle(self, answer: _Answer, dropped: UnfittedParameters) -> tuple[LadleUncertainty, LadleUncertainty]:
        """Return how well the ladle is known anywhere, and in the fitted rows."""
        position, rotation = (instrument[self.fitted_rows].known for instrument in self.measured.instruments[:2])
        known = functools.partial(
            ladle_uncertainty,
            unknowns=dropped.unknowns,
            covariances=dropped.covariances(answer.fit.covariances),
            dof=answer.fit.interval_dof,
            located=bool(position.any(axis=0).all()),
            turned=bool(rotation.any()),
        )
        return known(self._anywhere(dropped.rows)), known(dropped.rows[self.fit_data[0]])


def _under_effects(rows: ModelledRows, campaign: Campaign) -> tuple[ModelledRows, tuple[str, ...]]:
    """Return the rows with the changes by the model's effects, and which effects are taken as zero in some rows.

    Rows that the fit leaves out are included: their residuals are shown, and the robot passed through them.
    """
    used = np.flatnonzero(campaign.usable & np.isfinite(rows.start.position).all(axis=1))  # that the drawing closes at
    model, known = rows.model.model, campaign.subset(used)
    nominal = nominal_rows(model.definition, *rows[used].by_drawing())

    def refusal(problem: str, mend: str) -> CalibrationError:
        return CalibrationError(f"{campaign.path}: {problem}", mend)

    changes, not_learned = changes_by_stack(model, known, nominal, rows.model.engine.structure, refusal)
    return rows.with_changes(changes.among(used, len(rows))), not_learned
