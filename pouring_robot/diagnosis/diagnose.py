"""Diagnosis of a campaign: is there a gap, which effect is missing, and what residual the amended model leaves."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pouring_robot.campaign.data import Campaign
from pouring_robot.checks.check import examine
from pouring_robot.checks.flags import DataFlag, FlagCode, usable_without
from pouring_robot.diagnosis.conclusions import Conclusions
from pouring_robot.diagnosis.cross_validation import CrossValidatedGap, few, held_out_in_turn
from pouring_robot.diagnosis.diagnoser import Answer, Diagnoser, LinearState, State
from pouring_robot.diagnosis.disagreement import free_residuals, where_of
from pouring_robot.diagnosis.discrepancy_processes import processes_of, varied
from pouring_robot.diagnosis.doubts import FEWEST_ROWS, beyond_linearisation, few_without_wrong_rows, noise_too_large
from pouring_robot.diagnosis.gap import Gap, table_of
from pouring_robot.diagnosis.library import Library
from pouring_robot.diagnosis.report.export import write_diagnosis
from pouring_robot.diagnosis.report.sentences import headline
from pouring_robot.diagnosis.rows import CampaignRows
from pouring_robot.diagnosis.search_and_noise import Searched, Subset
from pouring_robot.diagnosis.suggest.next_measurements import MOST_COUNT, USUAL_COUNT
from pouring_robot.effects.available import chosen_effects
from pouring_robot.effects.base import Effect
from pouring_robot.effects.missing_cells import rows_without
from pouring_robot.estimation.kinds import are, component_name, kind_of
from pouring_robot.estimation.map_fit import campaign_and_model, seen_from_one_place
from pouring_robot.estimation.noise import NoiseLevel, noise_beforehand
from pouring_robot.estimation.splits import HoldOut, Split, split
from pouring_robot.exceptions import BadInputError, CalibrationError, CampaignError
from pouring_robot.inference.decision import Judgement, judge, without_minor
from pouring_robot.inference.gaussian_processes.discrepancy import Discrepancy
from pouring_robot.inference.gross_errors import ROUNDS
from pouring_robot.inference.hypotheses import Hypothesis
from pouring_robot.inference.thresholds import DEFAULT_THRESHOLDS, Thresholds
from pouring_robot.io.argument_checks import Options, expect, whole
from pouring_robot.io.background_process import forked
from pouring_robot.io.progress import Progress, say_nothing
from pouring_robot.io.threads import one_blas_thread
from pouring_robot.mechanism.arrays import Indices
from pouring_robot.report.result import Result
from pouring_robot.robot.model import RobotModel

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

_NO_ROWS: Indices = np.zeros(0, dtype=np.intp)


@dataclass(frozen=True)
class DiagnosisOptions(Options):
    """Options of a diagnosis; a value of another type or out of range raises BadInputError."""

    exclude: str | tuple[str, ...] = ()  # ids of effects that must not be named
    hold_out: HoldOut = "auto"  # kind of block that takes no part
    # accepted rate of false names where nothing is missing; the evidence that a name needs follows from it
    false_names: float = DEFAULT_THRESHOLDS.false_names
    next_count: int = USUAL_COUNT  # how many measurements to suggest
    # known upper limit of the standard deviation of joint positions, in mm, and of axis directions, in mrad, in a
    # machine in which nothing is wrong; None: it is estimated
    made_within_mm: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        said = f"the number of measurements to suggest must be a whole number from 0 to {MOST_COUNT}"
        count = whole(self.next_count, 0, said, MOST_COUNT)
        rate = Thresholds(self.false_names).false_names
        if self.made_within_mm is not None:
            if not 0.0 < self.made_within_mm < math.inf:
                said = "the accuracy of the joints must be a length in mm above 0"
                raise BadInputError(f"{said}, not {self.made_within_mm:g}")
            object.__setattr__(self, "made_within_mm", float(self.made_within_mm))
        for name, plain in {"next_count": count, "false_names": rate}.items():
            object.__setattr__(self, name, plain)  # the report's JSON cannot encode NumPy numbers


class Diagnosis(Conclusions, Result):
    """Findings and conclusions, in words, as a table and as files."""

    @property
    def headline(self) -> str:
        """The verdict in one sentence."""
        return headline(self)

    def to_frame(self) -> pd.DataFrame:
        """Return a row for each parameter of each effect, with its value and standard deviation in its unit."""
        import pandas as pd

        columns = ["effect", "form", "alternatives", "firm", "probability", "parameter", "value", "std", "unit"]
        rows = []
        for e in self.effects:
            cause = e.cause
            firm = e in self.firm
            said = cause.effect, cause.form, ", ".join(cause.alternatives), firm, cause.probability if firm else np.nan
            rows += [(*said, name, p.value, p.std, p.parameter.unit) for name, p in self.parameters_of(e)]
        return pd.DataFrame(rows, columns=columns)

    def to_dataset(self) -> xr.Dataset:
        """Return the residuals of each row of the campaign, measured minus predicted, in the tracker's axes.

        ``residual_before`` is of the given model, ``residual_after`` with what was found by the fitted rows, each with
        its frames fitted: (row, component), in m and rad, NaN where nothing was measured or a row is left out. ``used``
        says which rows were fitted, held out or left out; ``line`` is their line in the file.
        """
        import xarray as xr

        used, tables = np.full(len(self.campaign), "left out"), dict[str, Any]()
        used[self.inliers] = np.where(self.fitted, "fitted", "held out")
        for name, state in {"before": self.before, "after": self.before if self.refused else self.after}.items():
            found = table_of(state.every_row, state.every_row.residual, len(self.rows))
            whole = np.full((len(self.campaign), found.shape[1]), np.nan)
            whole[self.inliers] = found
            tables[f"residual_{name}"] = ("row", "component"), whole, {"units": "m or rad, see 'unit'"}
        components = np.arange(whole.shape[1])
        coordinates = {
            "component": [component_name(k) for k in components.tolist()],
            "unit": ("component", np.where(are("rotation", components), "rad", "m")),
            "line": ("row", self.campaign.lines),
            "used": ("row", used),
        }
        return xr.Dataset(tables, coordinates)

    @one_blas_thread()
    def save(self, folder: Path | str, *, overwrite: bool = False) -> list[Path]:
        """Write the files of :func:`~pouring_robot.diagnosis.report.export.write_diagnosis`; return their paths.

        Raises:
            OutputError: the folder cannot be written to, or a file is there already and ``overwrite`` is not set.
        """
        return write_diagnosis(self, folder, overwrite=overwrite)


@one_blas_thread()
def diagnose(
    campaign: Campaign | Path | str,
    model: RobotModel | Path | str | None = None,
    options: DiagnosisOptions | None = None,
    progress: Progress = say_nothing,
) -> Diagnosis:
    """Find where a model and a campaign disagree, name the missing effect and amend the model.

    Args:
        campaign: the data, or the path of their table.
        model: the model of the robot, or the path of its file; by default the drawing of the campaign's robot.
        options: of the diagnosis.
        progress: called with what is being done.

    Raises:
        BadInputError: an effect to leave out does not exist.
        CampaignError: the data are wrong or too few.
        DiagnosisError: rows do not close.
        FrameFitError: too few rows have a pose and a position.
    """
    options = options or DiagnosisOptions()
    expect(options, DiagnosisOptions, "options of a diagnosis are DiagnosisOptions")
    campaign, model = campaign_and_model(campaign, model)
    campaign = seen_from_one_place(campaign, model)
    effects = chosen_effects(model.definition, options.exclude)
    progress("checking the data", 0, 0)
    flags = examine(campaign, model.definition.drawing()).flags
    wrong = usable_without(campaign, flags)
    if any(flag.code is FlagCode.SESSIONS_OF_ROWS for flag in flags):
        campaign = replace(campaign, sessions=("1",) * len(campaign))
    work = _Work(campaign, model, effects, options, progress)
    subset = work.subset(wrong)
    with _located(subset.diagnoser) as located:
        found = work.without_gross_errors(work.searched(subset)).beside_unknown()
        if found.diagnoser is subset.diagnoser:
            return located(work.judged(found, tuple(flags)))
    with _located(found.diagnoser) as located:
        return located(work.judged(found, tuple(flags)))


@contextmanager
def _located(diagnoser: Diagnoser) -> Iterator[Callable[[Diagnosis], Diagnosis]]:
    """Yield a function that adds to a diagnosis where model and data disagree, computed on another core meanwhile.

    Without another core it is computed when the diagnosis is asked for it.
    """
    here = functools.partial(where_of, diagnoser)
    with forked(here) as elsewhere:

        def located(diagnosis: Diagnosis) -> Diagnosis:
            if elsewhere is not here and diagnosis.diagnoser is diagnoser:
                vars(diagnosis)["where"] = elsewhere()
            return diagnosis

        yield located


class _Concluded(NamedTuple):
    """What may be said of what was found."""

    judgement: Judgement
    after: LinearState  # the amended state
    hypothesis: Hypothesis
    in_turn: CrossValidatedGap | None  # the gap of blocks held out in turn, where rows are few


@dataclass(frozen=True)
class _Work:
    """The diagnosis of one campaign, repeated as often as needed."""

    campaign: Campaign
    model: RobotModel
    effects: dict[str, Effect]
    options: DiagnosisOptions
    say: Progress

    def subset(self, flagged: Indices, unfitting: Indices = _NO_ROWS) -> Subset:
        """Return the campaign without some rows, and without those that lack a value with no substitute."""
        kept = self.campaign.usable.copy()
        for rows_out in (flagged, unfitting, *rows_without(self.campaign).values()):
            kept[rows_out] = False
        inliers = np.flatnonzero(kept)
        if inliers.size < FEWEST_ROWS:
            raise CampaignError(
                self.campaign.path,
                f"only {inliers.size} rows can be used and {FEWEST_ROWS} are needed; measure more poses",
            )
        campaign = self.campaign.subset(inliers)
        parts, notes = _held_out(campaign, self.options.hold_out)
        fitted = np.ones(len(campaign), dtype=bool)
        if parts:
            fitted[parts.test] = False
        rows = CampaignRows(campaign, self.model, noise_beforehand(campaign, np.flatnonzero(fitted)))
        library = Library.of(rows, self.effects, self.options.made_within_mm)
        diagnoser = Diagnoser(rows, library, fitted, Thresholds(self.options.false_names))
        return Subset(flagged, unfitting, inliers, parts, tuple(notes), diagnoser)

    def searched(self, subset: Subset, start: Hypothesis | None = None) -> Searched:
        """Search, starting with what was found with more rows, if anything."""
        self.say("searching for effects", 0, 0)
        return Searched(subset, subset.diagnoser, *subset.diagnoser.found(start)).with_noise_settled()

    def without_gross_errors(self, found: Searched) -> Searched:
        """Search again without the rows that fit nothing; accepted if the residuals are then close to the noise.

        Otherwise an unknown cause acts in many rows, and none is known to be wrong.
        """
        tried = found
        for _ in range(ROUNDS):
            more = tried.gross_errors
            if not more.size or tried.asked.inliers.size - more.size < FEWEST_ROWS:
                break
            self.say("leaving out rows that fit nothing", 0, 0)
            # A fit that wrong rows have pulled towards themselves is no starting point.
            start = tried.hypothesis if tried.predictive else None
            subset = self.subset(found.asked.flagged, np.union1d(tried.asked.unfitting, more))
            tried = self.searched(subset, start)
            found = tried if tried.near_noise else found
        return found

    def judged(self, found: Searched, flags: tuple[DataFlag, ...]) -> Diagnosis:
        """Return the diagnosis of what was found."""
        self.say("testing the residuals for structure", 0, 0)
        diagnoser = found.diagnoser
        rows, before = diagnoser.rows, diagnoser.at_rest()
        free_residuals(before, rows)  # raises for too few rows now, not when ``where`` is asked for
        misfit = few_without_wrong_rows(self.campaign, found) or noise_too_large(rows, before.linear)
        unsettled = beyond_linearisation(found.after, found.hypothesis, diagnoser.asked)
        concluded = self._concluded(found, before, misfit, unsettled)
        larger = concluded.judgement.larger_noise
        if larger and not found.larger_noise:
            self.say("searching again with a larger noise", 0, 0)
            repeated = self.judged(found.under_larger(larger), flags)
            if not (repeated.judgement.clear_structures or repeated.judgement.beaten):
                return repeated
            # A process is clear under that noise, given what is found with it: it is no larger noise.
            concluded = self._concluded(found, before, misfit, unsettled, as_noise=False)
        given = before.alone
        del before  # its derivatives take much memory, and those of a last fit are to come
        doubt = unsettled or self._refuted(concluded)
        return self._believed(self._diagnosis(found, given, concluded, flags, misfit, doubt), doubt)

    def _diagnosis(
        self,
        found: Searched,
        before: State,
        concluded: _Concluded,
        flags: tuple[DataFlag, ...],
        misfit: str,
        doubt: str,
    ) -> Diagnosis:
        """Put together what is known of a campaign; without ``doubt`` its causes are fitted to held-out rows, too."""
        judgement, after, hypothesis, in_turn = concluded
        subset, diagnoser = found.asked, found.diagnoser
        rows, fitted = diagnoser.rows, diagnoser.fitted
        unknown = judgement.verdict == "unknown" and bool(judgement.causes)
        given, sigma = rows.conditions, rows.measured.sigma
        given_rows, amended_rows = before.every_row.alone, after.every_row.alone
        gaps = [Gap.between(given_rows, amended_rows, part, sigma) for part in (fitted, ~fitted) if part.any()]
        whole, final, best = diagnoser, after, hypothesis
        tests = [*gaps, in_turn.gap] if in_turn else gaps
        confirmed = judgement.names and not doubt and not any(gap.worse for gap in tests)
        if confirmed and not fitted.all():
            whole, final, best = diagnoser.fitted_to_all(after, hypothesis)
        covariances = whole.covariances(best, final, unexplained=unknown)
        parameters = whole.parameters_of(best, covariances)
        return Diagnosis(
            campaign=self.campaign,
            model=self.model,
            rows=rows,
            inliers=subset.inliers,
            left_out=subset.left_out,
            flags=flags,
            noise=found.noise,
            fitted=fitted,
            held_out_name=subset.parts.test_name if subset.parts else "",
            diagnoser=diagnoser,
            before=before,
            after=after.alone,
            hypothesis=hypothesis,
            final=Answer(whole, final.alone, best),
            judgement=judgement,
            misfit=misfit,
            covariances=covariances,
            parameters=parameters,
            effects=diagnoser.named(parameters, hypothesis, judgement),
            untestable={e.id: e.missing(given) for e in self.effects.values() if e.missing(given)},
            train=gaps[0],
            held_out=gaps[1] if len(gaps) > 1 else None,
            in_turn=in_turn,
            notes=(
                *subset.notes,
                *_noise_notes(found.noise),
                *(f"assumed: {line}" for line in given.assumed),
                *rows.not_learned,
            ),
            next_count=self.options.next_count,
        )

    def _refuted(self, concluded: _Concluded) -> str:
        """Return that causes do not predict blocks held out in turn, in words; "" where they do, or none can."""
        causes = [self.effects[cause.effect] for cause in concluded.judgement.causes if cause.indices]  # no workmanship
        lasting = not any(cause.campaign_specific for cause in causes)  # others no model predicts
        return concluded.in_turn.refuted if concluded.in_turn and causes and lasting else ""

    def _believed(self, diagnosis: Diagnosis, doubt: str) -> Diagnosis:
        """Return a diagnosis, in doubt of all causes where what was found does not do in the model what it should."""
        judgement = diagnosis.judgement
        # What no model can include, or does not do in it what it was found for, is no cause, however well it explains.
        why = (diagnosis.refused if judgement.names else "") or doubt
        if not why:
            return diagnosis
        misfit = diagnosis.misfit if judgement.verdict == "unknown" else why
        gap = diagnosis.hypothesis.problem.given_size
        return replace(diagnosis, misfit=misfit, judgement=judgement.disbelieved(why, gap))

    def _concluded(
        self, found: Searched, before: LinearState, misfit: str, unsettled: str, *, as_noise: bool = True
    ) -> _Concluded:
        """Return what may be said of what was found."""
        diagnoser, after, hypothesis = found.diagnoser, found.after, found.hypothesis
        rows, fitted = diagnoser.rows, diagnoser.fitted
        # Where the noise is not stated, scatter from row to row counts as noise.
        known = not rows.noise.from_residuals
        axes = after.frames.T_tracker_base.rotation
        judgement = judge(
            hypothesis,
            Discrepancy.of(hypothesis, processes_of(rows, after.linear, axes, chance=known)),
            diagnoser.thresholds,
            kind=kind_of(after.linear.component),
            larger_noise=found.larger_noise,
            noise_known=known and as_noise,
            unexplained=misfit,
            varied=lambda effect: varied(diagnoser.added(hypothesis, effect, after.linear), rows.conditions),
        )
        if not judgement.causes:  # nothing is named, so nothing is added: the model stays as given
            after = before
        in_turn = None
        parts = found.asked.parts
        if parts and judgement.names and not unsettled and few(before.every_row, fitted):
            names = frozenset(item.effect for item in hypothesis.items if item.cause)
            blocks = (*parts.folds, parts.test)
            in_turn = held_out_in_turn(diagnoser, before, after, blocks, names, self.say)
        if in_turn:
            judgement = replace(judgement, causes=tuple(map(in_turn.tempered, judgement.causes)))
        passing = [effect for effect in judgement.minor if self.effects[effect].campaign_specific]
        if passing and judgement.causes:  # they belong to these rows, not to the robot
            hypothesis, judgement = without_minor(hypothesis, judgement, passing)
            after, hypothesis = diagnoser.settled(after, hypothesis)
        return _Concluded(judgement, after, hypothesis, in_turn)


def _noise_notes(noise: NoiseLevel) -> list[str]:
    unjudged = (
        "the noise is not stated: the residuals are taken for it, except what clearly follows something unknown; a "
        "gap smaller than that cannot be detected"
    )
    return [*([unjudged] if noise.from_residuals else []), *(f"the noise: {doubt}" for doubt in noise.doubts)]


def _held_out(campaign: Campaign, kind: HoldOut) -> tuple[Split | None, list[str]]:
    """Return which rows are held out, None where they are too few for that, and notes."""
    try:
        return split(campaign, _NO_ROWS, kind), []
    except CalibrationError as problem:
        if kind != "auto":
            raise
        return None, [f"no rows are held out: {problem.problem}"]
