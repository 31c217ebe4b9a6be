"""What a calibration found, and what moved: parameters, and the combinations of them that a campaign determines."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np
import scipy.special

from pouring_robot.calibration.metrics import LadleUncertainty, Misfit, PosePerformance, length_columns, values_a_row
from pouring_robot.calibration.selection import Refusal, Selection, row_scores
from pouring_robot.campaign.data import Campaign
from pouring_robot.checks.flags import DataFlag
from pouring_robot.estimation.frames.outer import FRAMES
from pouring_robot.estimation.frames.sessions import SESSION
from pouring_robot.estimation.identifiability import BaseParameters, combination_text, robot_combinations
from pouring_robot.estimation.intervals import Estimate, largest_std
from pouring_robot.estimation.kinds import KINDS, are, kind_of
from pouring_robot.estimation.map_fit import Fit
from pouring_robot.estimation.noise import NoiseLevel
from pouring_robot.estimation.splits import Split
from pouring_robot.io.units import MM, MRAD, shown_in
from pouring_robot.mechanism.arrays import FloatArray, Indices, rms
from pouring_robot.report.result import Result
from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.parameter_catalogue import ParameterGroup

if TYPE_CHECKING:
    import pandas

LEARNT = 0.5  # a parameter is measured when the data removed at least this share of its prior variance
_SEEN = 0.01  # below this share no pose of the campaign shows a parameter by itself


@dataclass(frozen=True, eq=False, repr=False)
class CalibrationFindings(Result):
    """A calibrated robot and everything that says how far to trust it."""

    campaign: Campaign
    present: RobotModel  # the robot before; ``calibrated`` after: what to export
    calibrated: RobotModel
    flags: tuple[DataFlag, ...]  # findings of the data checks, and gross errors found by a fit
    left_out: Indices  # rows that are not used: gross errors, and poses or drives out of reach
    split: Split  # which rows were held out
    noise: NoiseLevel  # as stated, or from all rows; ``noise_of_test`` from the training rows alone
    noise_of_test: NoiseLevel
    candidates: tuple[ParameterGroup, ...]  # the groups to choose from
    selection: Selection  # the groups kept and what was tried
    refused: Refusal | None  # what was chosen, but made held-out rows worse and is not kept; None: nothing
    # effects of the model that were not learned where some rows are, taken as zero there; a line each
    not_learned: tuple[str, ...]
    fit: Fit  # the answer, to all rows not left out, held-out ones too; its covariance is at the noise level as given
    unknown_units: tuple[str, ...]  # unit of each unknown, frames first; ``base`` has their names
    # measured minus predicted by the present robot with its frames fitted to the training rows; all rows, shape (n, K),
    # in m and rad, tracker axes; NaN where missing. ``after`` by the robot with the groups fitted to the training rows.
    before: FloatArray
    after: FloatArray
    base: BaseParameters  # what all these rows determine of the groups kept, at the present robot
    rank_anywhere: int  # its rank if poses all over the workspace were also measured, in the same way
    # how far unknowns move in place of p dropped parameters, by what these may be off, (12 + P, p), in m and rad
    in_place_of_dropped: FloatArray
    ladle: LadleUncertainty  # over the workspace
    ladle_measured: LadleUncertainty  # in all these rows
    performance: PosePerformance | None  # ISO 9283-style figures; None without repeats

    @property
    def inflation(self) -> float:
        """Ratio of residuals to noise, see :attr:`~pouring_robot.estimation.map_fit.Fit.inflation`."""
        return self.fit.inflation

    @property
    def std(self) -> FloatArray:
        """Standard deviation of each unknown, shape (12 + P,), in m and rad, as reported to users."""
        return largest_std(np.eye(len(self.fit.prior_std)), self.fit.covariances)

    @property
    def correlation(self) -> FloatArray:
        """Correlation of the unknowns under the noise that residuals show, shape (12 + P, 12 + P)."""
        covariance = self.fit.inflated_covariance
        std = np.sqrt(np.diagonal(covariance))
        return np.asarray(covariance / np.outer(std, std))

    @property
    def changed(self) -> bool:
        """Whether any parameter was kept."""
        return bool(self.selection.groups)

    def misfit(self, rows: Indices, *, after: bool) -> Misfit:
        """Return the misfit over rows, those left out excluded."""
        return Misfit.of((self.after if after else self.before)[np.setdiff1d(rows, self.left_out)])

    def floor(self, rows: Indices) -> dict[str, float]:
        """Return the error by noise alone in rows: RMS of a value, P95 of a length; NaN where nothing was measured.

        In mm and mrad, of the same values as their :meth:`misfit`.
        """
        seen, sigma = self.before[np.setdiff1d(rows, self.left_out)], self._sigma(self.noise)
        found = dict[str, float]()
        for unit, si, columns in (("mm", MM, length_columns(seen)), ("mrad", MRAD, slice(3, 6))):
            known = np.isfinite(seen[:, columns])
            size = rms(np.broadcast_to(sigma[columns], known.shape)[known]) / si
            values = round(values_a_row(seen[:, columns]))  # that most rows have
            found |= {f"rms_{unit}": size, f"p95_{unit}": math.sqrt(float(scipy.special.chdtri(values, 0.05))) * size}
        return found

    def _sigma(self, noise: NoiseLevel) -> FloatArray:
        """Return a noise by component of a row, (K,), in m and rad."""
        return np.array([noise[KINDS[kind]].sigma for kind in kind_of(np.arange(self.before.shape[1]))])

    @property
    def held_out_scores(self) -> tuple[FloatArray, FloatArray]:
        """Scores of the held-out rows before and after, see :func:`~pouring_robot.calibration.selection.row_scores`."""
        test, sigma = self.split.test, self._sigma(self.noise_of_test)
        return row_scores(self.before[test], sigma), row_scores(self.after[test], sigma)

    @property
    def verdict(self) -> Literal["accepted", "unchanged", "refused"]:
        """Whether parameters are in the model: none helped (``unchanged``), or held-out rows refused them."""
        if self.refused:
            return "refused"
        return "accepted" if self.changed else "unchanged"

    @property
    def headline(self) -> str:
        """The outcome in one sentence: held-out error before and after, and the noise."""
        test = self.split.test
        before, after = (vars(self.misfit(test, after=a)) for a in (False, True))
        floor, units = self.floor(test), [unit for unit in ("mm", "mrad") if math.isfinite(before[f"rms_{unit}"])]
        unseen = self.noise.unseen(np.flatnonzero(np.isfinite(self.before[test]).any(axis=0)))
        noises = " and ".join(f"{floor[f'rms_{unit}']:.3f} {unit}" for unit in units)
        # With nothing in the model there is no after.
        left = {unit: f" to {after[f'rms_{unit}']:.3f}" if self.changed else "" for unit in units}
        first, *others = (f"{before[f'rms_{unit}']:.3f}{left[unit]} {unit}" for unit in units)
        errors = " and ".join((f"{first} RMS", *others))
        if self.changed:
            return f"Held-out error{unseen} {errors}; noise floor {noises}."
        what = "No geometry found that explains the error" if self.inflation > 1.0 else "Nothing to calibrate"
        return f"{what}: held-out rows{unseen} are at {errors}; noise {noises}."

    def to_frame(self) -> pandas.DataFrame:
        """Return the parameters kept, one per row, in mm and mrad by column ``unit``, with 95 % intervals."""
        import pandas

        names = ("parameter", "group", "unit", "value", "std", "low95", "high95", "prior_std", "learnt", "verdict")
        rows = [
            (p.name, p.group, p.unit, p.value, p.std, *p.interval, p.prior_std, p.learnt, p.verdict)
            for p in parameter_lines(self)
        ]
        return pandas.DataFrame(rows, columns=names)


@dataclass(frozen=True)
class Movement(Estimate):
    """A parameter, or a combination that the campaign determines, in mm or mrad, relative to the present model."""

    name: str
    unit: str
    value: float
    std: float
    prior_std: float
    dof: float = field(default=math.inf, kw_only=True)

    @property
    def surprise(self) -> float:
        """How many standard deviations it is off."""
        return abs(self.value) / self.std


@dataclass(frozen=True)
class ParameterLine(Movement):
    """One parameter: the group it was kept with, and whether any pose shows it by itself."""

    group: str
    seen: bool

    @property
    def learnt(self) -> float:
        """Share of its prior variance that the data removed; below 0 where stretches of rows make it scatter more."""
        return 1.0 - (self.std / self.prior_std) ** 2

    @property
    def verdict(self) -> str:
        """What to make of it, in words."""
        if self.learnt < LEARNT:
            return "held by its tolerance"
        return "moved" if self.moved else "not shown to be off"


def parameter_lines(calibration: CalibrationFindings) -> list[ParameterLine]:
    """Return the parameters kept, in order."""
    fit, std = calibration.fit, calibration.std
    names = [(group.name, p) for group in calibration.selection.groups for p in group.parameters]
    lines = []
    for k, (group, parameter) in enumerate(names, start=FRAMES):
        unit, factor = shown_in(parameter.unit)
        value, error, prior_std = (float(v[k]) / factor for v in (fit.unknowns.values, std, fit.prior_std))
        seen, dof = bool(fit.learnt[k] >= _SEEN), fit.interval_dof
        lines.append(ParameterLine(parameter.name, unit, value, error, prior_std, group, seen, dof=dof))
    return lines


@dataclass(frozen=True)
class GroupLine:
    """What one group of parameters does to the ladle, in words and figures of the shop floor."""

    name: str
    meaning: str
    count: int
    # by how much it moves what was measured in the fitted rows, RMS of a coordinate (where no position was measured, of
    # a distance or closure), without what a shift of the outer frames would do; ``moved_mrad`` RMS of a rotation
    # component; NaN where none was measured
    moved_mm: float
    moved_mrad: float


def group_effects(calibration: CalibrationFindings) -> list[GroupLine]:
    """Return what each group kept does at the target, to first order about the answer; the largest first."""
    fit, noise = calibration.fit, calibration.noise
    jacobian, components = fit.equations.derivatives, fit.equations.components
    parameters = sum(len(group.parameters) for group in calibration.selection.groups)
    frames = np.delete(jacobian, slice(FRAMES, FRAMES + parameters), axis=1)  # those of sessions are last
    turned, long = are("rotation", components), are(noise.length_kind, components)
    lines, first = [], FRAMES
    for group in calibration.selection.groups:
        columns = slice(first, first + len(group.parameters))
        first = columns.stop
        effect = jacobian[:, columns] @ fit.unknowns.values[columns]
        effect -= frames @ np.linalg.lstsq(frames, effect, rcond=None)[0]
        move, turn = rms(effect[long]) * noise.length_m / MM, rms(effect[turned]) * noise.rotation_rad / MRAD
        lines.append(GroupLine(group.name, group.meaning, len(group.parameters), move, turn))
    return sorted(lines, key=lambda line: -line.moved_mm)


def combination_lines(calibration: CalibrationFindings) -> list[Movement]:
    """Return the combinations that the campaign determines, the most significant movement first.

    Combinations that include an outer frame say nothing about the robot.
    """
    base, fit = calibration.base, calibration.fit
    # The frames, those of sessions with frames of their own too.
    outer = (*base.names[:FRAMES], *(name for name in base.names[FRAMES:] if name.startswith(SESSION)))
    lines = []
    for combination in robot_combinations(base, outer):
        shares = np.array([combination.get(name, 0.0) for name in base.names])
        unit, factor = shown_in(calibration.unknown_units[base.names.index(next(iter(combination)))])
        std = float(largest_std(shares, fit.covariances))
        prior_std = float(np.linalg.norm(shares * fit.prior_std))
        sizes = (size / factor for size in (float(shares @ fit.unknowns.values), std, prior_std))
        lines.append(Movement(combination_text(combination), unit, *sizes, dof=fit.interval_dof))
    return sorted(lines, key=lambda line: -line.surprise)
