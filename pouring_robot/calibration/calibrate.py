"""From a campaign to a calibrated robot: check, split, choose, fit, judge on rows nobody has looked at."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
import scipy.special
from numpy.typing import NDArray

from pouring_robot.calibration.acceptance import Refusal, acceptable, row_scores
from pouring_robot.calibration.amend import amended_model
from pouring_robot.calibration.findings import CalibrationFindings
from pouring_robot.calibration.ladle import LadleUncertainty, ladle_uncertainty, workspace_rows
from pouring_robot.calibration.metrics import Misfit, pose_performance
from pouring_robot.calibration.selection import Selection, select_groups
from pouring_robot.campaign.data import Campaign
from pouring_robot.checks.check import check_campaign
from pouring_robot.checks.flags import DataFlag, FlagCode, Severity, outlier_rows
from pouring_robot.estimation.frames import FRAMES
from pouring_robot.estimation.identifiability import base_parameters
from pouring_robot.estimation.measurement import MeasurementModel, ModelledRows, Unknowns
from pouring_robot.estimation.noise import NoiseLevel, fit_with_noise, repeats, stated_noise
from pouring_robot.estimation.priors import prior_std
from pouring_robot.estimation.residuals import MeasuredPoses, regressor
from pouring_robot.estimation.solver import Fit, FitOptions, first_frames, identify
from pouring_robot.estimation.splits import HoldOut, Rows, Split, split
from pouring_robot.exceptions import CampaignError
from pouring_robot.io.progress import Status, say_nothing
from pouring_robot.io.threads import one_blas_thread
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.report.result import Result
from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.parameters import ParameterGroup, all_parameters
from pouring_robot.robot.robot import PouringRobot

if TYPE_CHECKING:
    import pandas
from pouring_robot.robot.tolerances import Tolerances

_ROW_FLAGS = (FlagCode.OUTLIER, FlagCode.UNREACHABLE_POSE, FlagCode.UNREACHABLE_DRIVES)
_SURE = 1e-3  # chance at which residuals count as larger than the noise


@dataclass(frozen=True)
class CalibrationOptions:
    """What to identify and how.

    Attributes:
        parameters: sets, groups or patterns; each becomes a group that is kept or dropped as a whole.
        tolerances: priors; by default the shipped ones.
        hold_out: what kind of blocks to hold out.
        choose: whether groups are kept only where they help held-out rows; otherwise all are kept.
        fit: loss and limits.
        threads: how many share the work; by default one a core.
    """

    parameters: tuple[str, ...] = ("geometry",)
    tolerances: Tolerances | None = None
    hold_out: HoldOut = "auto"
    choose: bool = True
    fit: FitOptions = field(default_factory=FitOptions)
    threads: int | None = None


@dataclass(frozen=True, eq=False, repr=False)
class Calibration(Result, CalibrationFindings):
    """A calibrated robot and everything that says how far to trust it; fields as :class:`CalibrationFindings`."""

    @property
    def verdict(self) -> Literal["accepted", "unchanged", "refused"]:
        """Whether parameters are in the model: none helped (``unchanged``), or held-out rows refused them."""
        if self.refused:
            return "refused"
        return "accepted" if self.changed else "unchanged"

    @property
    def headline(self) -> str:
        """The outcome in one sentence: held-out error before and after, and the noise."""
        from pouring_robot.calibration.report import headline

        return headline(self)

    def to_frame(self) -> pandas.DataFrame:
        """Return the parameters kept, one a row, in mm and mrad as column ``unit`` says; 95 % intervals."""
        import pandas

        from pouring_robot.calibration.lines import parameter_lines

        content = [
            {
                "parameter": line.name,
                "group": line.group,
                "unit": line.unit,
                "value": line.value,
                "std": line.std,
                "low95": line.interval[0],
                "high95": line.interval[1],
                "prior_std": line.prior_std,
                "learnt": line.learnt,
                "verdict": line.verdict,
            }
            for line in parameter_lines(self)
        ]
        names = ["parameter", "group", "unit", "value", "std", "low95", "high95", "prior_std", "learnt", "verdict"]
        return pandas.DataFrame(content, columns=names)

    def save(self, folder: Path | str) -> list[Path]:
        """Write model file, URDF with meshes, ``calibration.json`` and ``report.html`` into a folder, all or none.

        Returns:
            The files.

        Raises:
            OutputError: the folder cannot be written to.
        """
        from pouring_robot.calibration.export import write_calibration

        return write_calibration(self, folder)


@one_blas_thread()
def calibrate(
    campaign: Campaign,
    model: RobotModel | None = None,
    options: CalibrationOptions | None = None,
    progress: Status = say_nothing,
) -> Calibration:
    """Calibrate a robot.

    Args:
        campaign: the data.
        model: the present robot; parameters come on top of its errors. By default the drawing.
        options: what to identify and how.
        progress: is told what is being done.

    Raises:
        CampaignError: the data are wrong as a whole (units, frames, columns); ``campaign check`` says more.
        FrameFitError: too few rows.
        CalibrationError: too few rows, or the fit fails; nothing is to be exported.
        BadInputError: the parameters or tolerances are wrong.
    """
    options, model = options or CalibrationOptions(), model or RobotModel()
    tolerances = options.tolerances or Tolerances.load()
    robot = PouringRobot(model)
    candidates = robot.parameters.groups(options.parameters)
    progress("checking the data")
    flags, left_out = _checked(campaign, robot)
    parts = split(campaign, left_out, options.hold_out)
    everything = MeasurementModel(model, all_parameters(candidates), options.threads)
    rows = everything.at(campaign.drives)
    noise = stated_noise(campaign, parts.train)
    measured = _measured(campaign, left_out, noise)
    if noise.from_residuals:
        progress("estimating the noise from residuals")
        noise = _residual_noise(rows, measured, parts, tolerances, noise, options.fit)
        measured = measured.with_noise(noise.position_m, noise.rotation_rad)
    progress("choosing parameters")
    selection = Selection(candidates, ())
    if options.choose:
        selection = select_groups(rows, measured, parts, candidates, tolerances, options.fit, progress)
    full = MeasuredPoses.from_campaign(campaign, noise.position_m, noise.rotation_rad)
    frames_only = rows.with_model(everything.with_parameters(()))
    before = full.difference(frames_only.predict(_before(frames_only, measured, parts, tolerances, options.fit)))
    progress("fitting")
    chosen, start, fit = _fitted(rows, measured, parts, selection.groups, tolerances, options.fit)
    after = full.difference(chosen.predict(fit.unknowns))
    progress("judging")
    refused = _refused(before, after, parts, left_out, selection, full.sigma) if options.choose else None
    if refused:
        selection = replace(selection, groups=())
        chosen, start, fit = _fitted(rows, measured, parts, (), tolerances, options.fit)
        after = full.difference(chosen.predict(fit.unknowns))
    calibrated = amended_model(model, chosen.model, fit.unknowns.parameters)
    inflation = _inflation(fit)
    alike = repeats(campaign, np.setdiff1d(np.flatnonzero(campaign.usable), left_out))
    seen = regressor(chosen[parts.train].linearise(start), measured.sigma, measured[parts.train].known)
    workspace = workspace_rows(chosen.model, robot.layout)
    return Calibration(
        campaign=campaign,
        present=model,
        calibrated=calibrated,
        flags=flags,
        left_out=left_out,
        split=parts,
        noise=noise,
        candidates=candidates,
        selection=selection,
        refused=refused,
        fit=fit,
        inflation=inflation,
        unknown_names=chosen.model.names,
        unknown_units=chosen.model.units,
        before=before,
        after=after,
        base=base_parameters(seen, chosen.model.names, lead=chosen.model.names[:FRAMES]),
        rank_anywhere=_rank_anywhere(seen, workspace[1], start, measured),
        ladle=_ladle(workspace, chosen.model, fit, inflation, turned=bool(measured.known[parts.train, 3:].any())),
        performance=pose_performance(measured, before, after, alike),
    )


def _checked(campaign: Campaign, robot: PouringRobot) -> tuple[tuple[DataFlag, ...], NDArray[np.intp]]:
    """Return what the checks found and the rows to leave out; refuse data that are wrong as a whole."""
    flags = tuple(check_campaign(campaign, robot))
    for flag in flags:
        if flag.severity == Severity.ERROR and flag.code not in _ROW_FLAGS:
            raise CampaignError(campaign.path, f"{flag.message}; {flag.remedy}")
    return flags, outlier_rows(flags)


def _measured(campaign: Campaign, left_out: NDArray[np.intp], noise: NoiseLevel) -> MeasuredPoses:
    """Return what was measured, rows left out as missing."""
    measured = MeasuredPoses.from_campaign(campaign, noise.position_m, noise.rotation_rad)
    measured.position_m[left_out], measured.rotation[left_out] = np.nan, np.nan
    return measured


def _residual_noise(
    rows: ModelledRows,
    measured: MeasuredPoses,
    parts: Split,
    tolerances: Tolerances,
    noise: NoiseLevel,
    options: FitOptions,
) -> NoiseLevel:
    """Return the noise as what the richest model leaves over of the training rows."""
    train, seen = rows[parts.train], measured[parts.train]
    start = first_frames(train, seen)
    _, found = fit_with_noise(train, seen, start, prior_std(rows.model.parameters, tolerances), noise, options)
    return found


def _fitted(
    rows: ModelledRows,
    measured: MeasuredPoses,
    parts: Split,
    groups: Sequence[ParameterGroup],
    tolerances: Tolerances,
    options: FitOptions,
) -> tuple[ModelledRows, Unknowns, Fit]:
    """Return the rows as a choice of groups models them, where its fit to the training rows began, and that fit."""
    chosen = rows.with_model(rows.model.with_parameters(all_parameters(groups)))
    train, seen = chosen[parts.train], measured[parts.train]
    start = first_frames(train, seen)
    prior = prior_std(chosen.model.parameters, tolerances)
    return chosen, start, identify(train, seen, start, prior, replace(options, curvature=True))


def _refused(
    before: FloatArray, after: FloatArray, parts: Split, left_out: Rows, selection: Selection, sigma: FloatArray
) -> Refusal | None:
    """Return what held-out rows refuse, or None."""
    test = np.setdiff1d(parts.test, left_out)
    if not selection.groups or acceptable(row_scores(before[test], sigma), row_scores(after[test], sigma)):
        return None
    names = tuple(group.name for group in selection.groups)
    return Refusal(names, Misfit.of(before[test]), Misfit.of(after[test]))


def _before(
    frames_only: ModelledRows, measured: MeasuredPoses, parts: Split, tolerances: Tolerances, options: FitOptions
) -> Unknowns:
    """Return the frames alone, fitted to the training rows with the present robot."""
    train, seen = frames_only[parts.train], measured[parts.train]
    start = first_frames(train, seen)
    return identify(train, seen, start, prior_std((), tolerances), options).unknowns


def _inflation(fit: Fit) -> float:
    """Return by how much residuals exceed the noise, where that is no accident; else 1."""
    freedom = fit.freedom()
    if freedom < 1.0:
        return 1.0
    ratio = fit.chi_square() / freedom
    return float(np.sqrt(ratio)) if scipy.special.chdtrc(freedom, fit.chi_square()) < _SURE else 1.0


def _rank_anywhere(seen: FloatArray, workspace: ModelledRows, start: Unknowns, measured: MeasuredPoses) -> int:
    """Return the rank of a campaign's regressor with poses of the workspace added, measured as the campaign was."""
    known = np.broadcast_to(measured.known.any(axis=0), (len(workspace), 6))
    added = regressor(workspace.linearise(start), measured.sigma, known)
    return base_parameters(np.vstack([seen, added]), workspace.model.names).rank


def _ladle(
    workspace: tuple[FloatArray, ModelledRows], model: MeasurementModel, fit: Fit, inflation: float, *, turned: bool
) -> LadleUncertainty:
    poses, rows = workspace
    lip = model.engine.structure.mechanism.T_end_tool
    return ladle_uncertainty(rows, poses, fit.unknowns, fit.covariance * inflation**2, lip, turned=turned)
