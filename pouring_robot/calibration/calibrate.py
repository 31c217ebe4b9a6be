"""From a campaign to a calibrated robot: check, split, choose, fit, judge on rows nobody has looked at."""

import functools
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from pouring_robot.calibration.findings import CalibrationFindings
from pouring_robot.calibration.metrics import Misfit, ladle_uncertainty, pose_performance, workspace_rows
from pouring_robot.calibration.selection import Refusal, Selection, acceptable, row_scores, select_groups
from pouring_robot.campaign.data import Campaign
from pouring_robot.checks.check import check_campaign
from pouring_robot.checks.flags import usable_without, where
from pouring_robot.effects.nominal_rows import nominal_rows
from pouring_robot.effects.stack import changes_by_stack, rows_untold
from pouring_robot.estimation.first_frames import first_frames
from pouring_robot.estimation.frames.outer import FRAMES
from pouring_robot.estimation.frames.sessions import session_parameters
from pouring_robot.estimation.identifiability import base_parameters
from pouring_robot.estimation.map_fit import (
    Fit,
    FitOptions,
    campaign_and_model,
    identify,
    noise_left_over,
    seen_from_one_place,
)
from pouring_robot.estimation.measurement import MeasurementModel, ModelledRows, Unknowns
from pouring_robot.estimation.noise import noise_beforehand, repeats
from pouring_robot.estimation.residuals import MeasuredPoses, regressor, whiten
from pouring_robot.estimation.splits import BLOCKS, HoldOut, blocks, split
from pouring_robot.exceptions import CalibrationError
from pouring_robot.io.given import expect
from pouring_robot.io.progress import Progress, say_nothing
from pouring_robot.io.threads import one_blas_thread
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.parameter_catalogue import ParameterCatalogue, ParameterGroup, all_parameters
from pouring_robot.robot.tolerances import Tolerances


@dataclass(frozen=True)
class CalibrationOptions:
    """What to identify and how."""

    parameters: str | tuple[str, ...] = ("geometry",)  # sets, groups, patterns; each a group kept or dropped as a whole
    tolerances: Tolerances | None = None  # priors; by default the shipped ones
    hold_out: HoldOut = "auto"  # what kind of blocks to hold out
    choose: bool = True  # whether groups are kept only where they help held-out rows; otherwise all are kept
    fit: FitOptions = field(default_factory=FitOptions)
    threads: int | None = None  # how many share the work; by default one a core

    def __post_init__(self) -> None:
        expect(self.fit, FitOptions, "how a calibration fits are FitOptions")
        expect(self.tolerances, Tolerances | None, "tolerances are Tolerances, such as Tolerances.load reads")


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
    """Calibrate a robot with a campaign, or the table of one; parameters come on top of the errors of its model.

    So do its effects that depend on conditions: the campaign says under which.

    Raises:
        CampaignError: the data are wrong as a whole (units, frames, columns); ``campaign check`` says more.
        FrameFitError: too few rows.
        CalibrationError: too few rows, the fit fails, or an effect of the model needs a condition that the campaign
            does not say; nothing is to be exported.
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
    lost = rows_untold(model, campaign)
    left_out = functools.reduce(np.union1d, lost.values(), usable_without(campaign, flags))
    parts = split(campaign, left_out, options.hold_out)
    everything = MeasurementModel(model, all_parameters(candidates), options.threads, sessions)
    rows = everything.at(campaign.drives, sessions=campaign.sessions)
    rows, untold = _under_effects(rows, campaign) if model.conditional else (rows, ())
    said = "left out, as effects of the model go by {}, and other rows do not tell what it was: {}"
    untold += tuple(said.format(heading, where(campaign, some)) for heading, some in lost.items())
    noise = noise_beforehand(campaign, parts.train)
    measured = MeasuredPoses.from_campaign(campaign, noise).without(left_out)
    used, seen = measured.among(parts.train)
    if noise.from_residuals:
        progress("estimating the noise from residuals", 0, 0)
        train = rows[used]
        prior_std = rows.model.prior_std(tolerances, framed=measured.framed)
        noise = noise_left_over(train, seen, first_frames(train, seen), prior_std, noise, options.fit)
        measured, seen = measured.with_noise(noise), seen.with_noise(noise)
    selection = Selection(candidates, ())
    if options.choose:
        selection = select_groups(rows, measured, parts, candidates, tolerances, options.fit, progress)
    full = MeasuredPoses.from_campaign(campaign, noise)
    aside = np.setdiff1d(np.arange(len(campaign)), parts.train)
    in_turn = [*blocks(campaign, "time", aside).values()]
    if sessions:  # a part of each: without the whole of one nobody would know where it was measured from
        apart = (np.array_split(own, BLOCKS) for own in blocks(campaign, "session", aside).values())
        in_turn = [np.concatenate(some) for some in zip(*apart, strict=True)]
    stretches = tuple(np.flatnonzero(np.isin(used, stretch)) for stretch in in_turn)

    def fitted(groups: Sequence[ParameterGroup]) -> tuple[ModelledRows, Fit, FloatArray]:
        """Fit groups to the training rows; return all rows as they model them, the fit, and all differences to it."""
        chosen = rows.with_parameters(all_parameters(groups))
        train = chosen[used]
        prior_std = chosen.model.prior_std(tolerances, framed=measured.framed)
        fit = identify(train, seen, first_frames(train, seen), prior_std, replace(options.fit, curvature=True))
        fit = replace(fit, noise=noise, stretches=stretches)
        return chosen, fit, full.residual(chosen.predict(fit.unknowns))

    _, _, before = fitted(())
    progress("fitting", 0, 0)
    chosen, fit, after = fitted(selection.groups)
    progress("judging", 0, 0)
    refused: Refusal | None = None
    scores = (row_scores(difference[parts.test], full.sigma) for difference in (before, after))
    if options.choose and selection.groups and not acceptable(*scores):
        names = tuple(group.name for group in selection.groups)
        refused = Refusal(names, Misfit.of(before[parts.test]), Misfit.of(after[parts.test]))
        selection = replace(selection, groups=())
        chosen, fit, after = fitted(())
    alike = repeats(campaign, np.setdiff1d(np.flatnonzero(campaign.usable), left_out))
    start = fit.unknowns.at(np.zeros_like(fit.unknowns.values))
    shown = -whiten(seen, chosen[used].linearise(start)).derivatives
    workspace = chosen if campaign.redundant_drives else workspace_rows(chosen.model)
    own_frames = [parameter.name for parameter in sessions]
    position, rotation = (instrument[parts.train].known for instrument in measured.instruments[:2])
    located, turned = bool(position.any(axis=0).all()), bool(rotation.any())
    known = functools.partial(ladle_uncertainty, located=located, turned=turned)
    told = fit.unknowns, fit.covariances, fit.interval_freedoms
    return Calibration(
        campaign=campaign,
        present=model,
        calibrated=chosen.model.amended(fit.unknowns.parameters),
        flags=flags,
        left_out=left_out,
        split=parts,
        noise=noise,
        candidates=candidates,
        selection=selection,
        refused=refused,
        untold=untold,
        fit=fit,
        unknown_units=chosen.model.units,
        before=before,
        after=after,
        base=base_parameters(shown, chosen.model.names, lead=(*chosen.model.names[:FRAMES], *own_frames)),
        rank_anywhere=_rank_anywhere(shown, workspace, start, measured),
        ladle=known(workspace, *told),
        ladle_measured=known(chosen[used], *told),
        performance=pose_performance(measured, before, after, alike),
    )


def _under_effects(rows: ModelledRows, campaign: Campaign) -> tuple[ModelledRows, tuple[str, ...]]:
    """Return the rows with what the effects that the model has change in them, and which are none in some.

    Rows that the fit leaves out are among them: what is left in them is shown, and the robot came by them.
    """
    used = np.flatnonzero(campaign.usable & np.isfinite(rows.start.position).all(axis=1))  # that the drawing closes at
    model, known = rows.model.model, campaign.subset(used)
    nominal = nominal_rows(model.definition, *rows[used].by_drawing())

    def refusal(problem: str, mend: str) -> CalibrationError:
        return CalibrationError(f"{campaign.path}: {problem}", mend)

    changes, untold = changes_by_stack(model, known, nominal, rows.model.engine.structure, refusal)
    return rows.with_changes(changes.among(used, len(rows))), untold


def _rank_anywhere(seen: FloatArray, workspace: ModelledRows, start: Unknowns, measured: MeasuredPoses) -> int:
    """Return the rank of a campaign's regressor with poses of the workspace added, measured as the campaign was."""
    known = np.broadcast_to(measured.known[:, :6].any(axis=0), (len(workspace), 6))
    added = regressor(workspace.linearise(start), measured.sigma[:6], known)
    return base_parameters(np.vstack([seen, added]), workspace.model.names).rank
