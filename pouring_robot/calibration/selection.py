"""Which groups of parameters to keep: only those that help rows the fit has not used. And the final test.

Groups are chosen on training blocks. What only looks like geometry (a drift, a worn screw, a shift between sessions)
can be fitted well there and mislead elsewhere; the held-out block shows that. It is not used for the choice, but may
refuse the whole: a single yes or no to what was chosen without it, so there is nothing to overfit; the robot then stays
as it was.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pouring_robot.calibration.metrics import Misfit
from pouring_robot.estimation.first_frames import first_frames
from pouring_robot.estimation.frames.outer import FRAMES
from pouring_robot.estimation.intervals import student
from pouring_robot.estimation.kinds import KINDS, kind_of
from pouring_robot.estimation.map_fit import FitOptions, identify
from pouring_robot.estimation.measurement import ModelledRows, Unknowns
from pouring_robot.estimation.residuals import MeasuredPoses
from pouring_robot.estimation.splits import Split
from pouring_robot.exceptions import CalibrationError
from pouring_robot.io.progress import Progress, say_nothing
from pouring_robot.mechanism.arrays import FloatArray, evenly_spaced
from pouring_robot.robot.parameter_catalogue import ParameterGroup, all_parameters
from pouring_robot.robot.tolerances import Tolerances

_FAILED = 1e6
_STANDARD_ERRORS = 2.0
_NEGLIGIBLE = 0.01  # of the noise's variance: half a per cent of the noise, which does not matter
_ROUGH, _ROUGH_EVALUATIONS = 0.3, 100
# In a block that is fitted or judged while groups are chosen: what so many rows do not show is far below their noise.
_MOST_ROWS = 1000


@dataclass(frozen=True)
class SelectionStep:
    """One candidate that was tried."""

    kept: tuple[str, ...]  # groups that were already kept
    tried: str  # the group added to them; "" for the start
    rms: float  # root mean square of the validation rows' residuals over their noise; 1 is pure noise
    # mean over the rows of log(1 + s²) without the group minus with it; s² is a row's mean squared residual over its
    # noise. The logarithm keeps single rows from deciding. ``gain_error`` is its standard error.
    gain: float
    gain_error: float
    accepted: bool  # whether it was kept in this round


@dataclass(frozen=True, eq=False)
class Selection:
    """The groups kept, in the order they were found, and every candidate that was tried."""

    groups: tuple[ParameterGroup, ...]
    steps: tuple[SelectionStep, ...]


@dataclass(frozen=True)
class Refusal:
    """The groups that were chosen and refused, and the misfit of the held-out rows without and with them."""

    groups: tuple[str, ...]
    before: Misfit
    after: Misfit


def row_scores(residual: FloatArray, sigma: FloatArray) -> FloatArray:
    """Return each row's mean squared residual over its noise, (n, kinds) in the order of ``KINDS``; NaN: unmeasured.

    ``residual`` is measured minus predicted, (n, K), NaN where missing; ``sigma`` the noise, (K,); both in m and rad.
    """
    squared = (residual / sigma) ** 2
    share = (kind_of(np.arange(len(sigma)))[:, None] == np.arange(len(KINDS))).astype(float)
    count = np.isfinite(squared) @ share
    return np.where(count > 0.0, np.nan_to_num(squared) @ share / np.maximum(count, 1.0), np.nan)


def mean_and_error(values: FloatArray) -> tuple[float, float]:
    """Return the mean of the finite values and its standard error, infinite for one; zeros if there are none."""
    known = values[np.isfinite(values)]
    if known.size < 2:
        return (float(known[0]), math.inf) if known.size else (0.0, 0.0)
    return float(known.mean()), float(known.std(ddof=1) / np.sqrt(known.size))


def chance_margin(values: FloatArray, standard_errors: float) -> float:
    """Return by how much the mean of the finite values may be off by chance, by so many of its standard errors.

    It is off by more as rarely as a normal value is by so many; Student's t allows for the small number of values.
    """
    dof = int(np.isfinite(values).sum()) - 1
    return student(standard_errors, dof) * mean_and_error(values)[1] if dof >= 0 else 0.0


def harmless(before: FloatArray, after: FloatArray, standard_errors: float) -> bool:
    """Return whether no kind of measurement gets worse, by the scores of rows (n, kinds) before and after.

    Each may get worse by so many standard errors of the row-by-row difference, as less is chance, or by a hundredth of
    the noise's variance, as less is negligible: a tiny change of the rotations may be the same in every row, and its
    standard error is then smaller still.
    """
    harm = (after - before).T
    return all(mean_and_error(one)[0] <= max(chance_margin(one, standard_errors), _NEGLIGIBLE) for one in harm)


def acceptable(before: FloatArray, after: FloatArray) -> bool:
    """Return whether held-out rows accept a calibration, by their scores (n, kinds) without and with it.

    They do unless all kinds of measurement together get worse, or one of them by more than two standard errors; see
    :func:`harmless`. A row that closes without the calibration but not with it counts as worse.
    """
    after = np.where(np.isfinite(before) & np.isnan(after), _FAILED, after)
    together = sum(mean_and_error(column)[0] for column in (after - before).T)
    return together <= 0.0 and harmless(before, after, _STANDARD_ERRORS)


class _CrossValidation:
    """Scores of a choice of groups: fitted to some training blocks and judged on another, in turn."""

    def __init__(
        self, rows: ModelledRows, measured: MeasuredPoses, split: Split, tolerances: Tolerances, options: FitOptions
    ) -> None:
        self.rows, self.measured = rows, measured
        # Scores need predictions, not parameters: a tenth of a standard deviation of these does not show in them.
        # A choice that still takes long is hardly determined by a part of the rows, and is rejected.
        most = min(options.max_evaluations, _ROUGH_EVALUATIONS)
        rough = replace(options, step_tolerance=_ROUGH, max_evaluations=most, curvature=False)
        self.tolerances, self.options = tolerances, rough
        frames_only = rows.with_parameters(())
        self._folds = [
            [measured.among(part[evenly_spaced(part.size, _MOST_ROWS)]) for part in fold] for fold in split.validations
        ]
        if not self._folds:
            raise CalibrationError(
                "no block of the fitted rows can be predicted from others, so it cannot be tested which groups help",
                "measure each attitude of the target in several places, or keep all groups (--keep-all)",
            )
        self._frames = [first_frames(frames_only[used], seen) for (used, seen), _ in self._folds]

    def __call__(self, groups: Sequence[ParameterGroup]) -> FloatArray:
        """Return the mean squared whitened residual of each judged row, by kind, shape (rows, kinds)."""
        rows, measured = self.rows.with_parameters(all_parameters(groups)), self.measured
        prior_std = rows.model.prior_std(self.tolerances, framed=measured.framed)
        scores = np.full((len(rows), len(KINDS)), np.nan)
        for frames, ((train, fitted), (judged, seen)) in zip(self._frames, self._folds, strict=True):
            start, known = Unknowns.zero(frames.frames, prior_std.size - FRAMES), seen.known.any(axis=1)
            try:
                fit = identify(rows[train], fitted, start, prior_std, self.options)
            except CalibrationError:  # a choice that cannot be fitted is no choice
                scores[judged[known]] = _FAILED
                continue
            prediction = rows[judged].predict(fit.unknowns)
            found = row_scores(seen.residual(prediction), seen.sigma)
            # The row itself does not close, or the one that its reading starts from.
            found[~prediction.closed | np.isnan(found).all(axis=1)] = _FAILED
            scores[judged[known]] = found[known]
        return np.asarray(scores[np.isfinite(scores).any(axis=1)])


def select_groups(
    rows: ModelledRows,
    measured: MeasuredPoses,
    split: Split,
    candidates: Sequence[ParameterGroup],
    tolerances: Tolerances,
    options: FitOptions | None = None,
    progress: Progress = say_nothing,
) -> Selection:
    """Choose groups by forward selection on the training blocks; the test block is not used.

    A group is kept when the rows held out in turn improve by more than two standard errors of that gain, and neither
    their positions nor their rotations get worse by more than one standard error and noticeably; of several, the one
    that gains most. The round is repeated until none helps. What still misleads is refused at the end.

    Raises CalibrationError where no block can be predicted from others, so that nothing would be tried.
    """
    validate = _CrossValidation(rows, measured, split, tolerances, options or FitOptions())
    kept: list[ParameterGroup] = []
    left = list(candidates)
    present = validate(kept)
    steps = [SelectionStep((), "", _rms(present), 0.0, 0.0, True)]
    while left:
        names = tuple(group.name for group in kept)
        trials = []
        for tried, group in enumerate(left):
            progress(f"choosing group {len(kept) + 1}", tried, len(left))
            trials.append(validate([*kept, group]))
        judged = [_judge(present, trial) for trial in trials]
        best = max(range(len(left)), key=lambda k: (judged[k][2], judged[k][0]))
        for k, (group, trial, (gain, error, helps)) in enumerate(zip(left, trials, judged, strict=True)):
            steps.append(SelectionStep(names, group.name, _rms(trial), gain, error, helps and k == best))
        if not judged[best][2]:
            break
        present = trials[best]
        kept.append(left.pop(best))
    return Selection(tuple(kept), tuple(steps))


def _judge(present: FloatArray, trial: FloatArray) -> tuple[float, float, bool]:
    """Return gain, its standard error and whether the group helps; scores have the shape (rows, kinds)."""
    gains = np.nanmean(np.log1p(present) - np.log1p(trial), axis=1)
    gain, error = mean_and_error(gains)
    return gain, error, gain > chance_margin(gains, _STANDARD_ERRORS) > 0.0 and harmless(present, trial, 1.0)


def _rms(scores: FloatArray) -> float:
    return float(np.sqrt(np.nanmean(scores)))
