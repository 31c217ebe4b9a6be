"""A campaign searched under the noise that it tells: where nobody states that, it is what is left over.

While rows are told apart that fit nothing, all of it counts as noise. What is then left may be something unknown all
the same: a noise as large as that would hide it (:meth:`Searched.beside_unknown`).
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace

import numpy as np

from pouring_robot.checks.flags import FEW_ROWS
from pouring_robot.diagnosis.diagnoser import Diagnoser, LinearState, noise_left
from pouring_robot.diagnosis.discrepancy_processes import poses, processes_of
from pouring_robot.estimation.kinds import KINDS, Kind, are
from pouring_robot.estimation.noise import NoiseLevel
from pouring_robot.estimation.splits import Split
from pouring_robot.inference.gaussian_processes.discrepancy import Discrepancy
from pouring_robot.inference.gross_errors import HALF, RowResiduals, calm, gross_error_in_few_rows, gross_errors
from pouring_robot.inference.hypotheses import Hypothesis
from pouring_robot.inference.larger_noise import LargerNoise
from pouring_robot.mechanism.arrays import Indices

_NOISE_ROUNDS, _NOISE_SETTLED = 20, 0.02
"""Every round is a whole search, from what the one before found; nine were seen, of rotations ninety times as poor as
positions. 2 % of the noise is 4 % of a difference of evidence, which decides nothing."""
_MOST_NOISE = 2.0**-0.5
"""Share of what is left over up to which it is made by something unknown more than by the noise: more than half of its
square. What is smaller than the noise is hardly what anybody is to find."""


@dataclass(frozen=True, eq=False)
class Subset:
    """A campaign with some rows left out."""

    flagged: Indices  # rows that the checks say are wrong, by index in the campaign
    unfitting: Indices  # rows left out because nothing that was found explains them, likewise
    inliers: Indices  # rows that are looked at, likewise
    parts: Split | None  # which of these are held out; None: none
    notes: tuple[str, ...]  # on that
    diagnoser: Diagnoser  # what searches them, under the noise that is known beforehand

    @property
    def left_out(self) -> Indices:
        """Rows that are wrong, by index in the campaign."""
        return np.union1d(self.flagged, self.unfitting)


@dataclass(frozen=True, eq=False)
class Searched:
    """What explains it best, under the noise that the diagnoser knows."""

    asked: Subset
    diagnoser: Diagnoser
    after: LinearState
    hypothesis: Hypothesis
    settled: bool = True  # whether what is left over is as large as that noise, where it is to tell it
    # like which larger noise what is left scattered under that which is told; this one was found under the larger one
    larger_noise: LargerNoise | None = None
    stated: NoiseLevel | None = None  # the noise that is told, where it is another

    @property
    def noise(self) -> NoiseLevel:
        """The noise as it is told."""
        return replace(self.stated or self.diagnoser.rows.noise, settled=self.settled)

    def under_larger(self, larger: LargerNoise) -> Searched:
        """Search anew under a larger noise: what one that is too small has weighed is nothing to start from.

        Where that of all looks larger, each kind has as much as is left over of it.
        """
        noise = self.diagnoser.rows.noise
        if larger.kind is None:
            left = noise_left(noise, self.after, self.hypothesis)
            factors = {kind: max(left[kind].sigma / noise[kind].sigma, 1.0) for kind in noise.measured}
        else:
            factors = {KINDS[larger.kind]: larger.factor}
        diagnoser = replace(self.diagnoser, rows=self.diagnoser.rows.with_noise(noise.times(factors)))
        return Searched(self.asked, diagnoser, *diagnoser.found(), self.settled, larger, noise)

    def under(self, noise: NoiseLevel) -> Searched:
        """Search again, from what was found, under another noise."""
        diagnoser = replace(self.diagnoser, rows=self.diagnoser.rows.with_noise(noise))
        return Searched(self.asked, diagnoser, *diagnoser.found(self.hypothesis, self.after.alone), self.settled)

    def with_noise_settled(self) -> Searched:
        """Search again until all that is left over is as large as the noise that it was found under."""
        found = self
        for _ in range(_NOISE_ROUNDS):
            noise = found.residual_noise
            if noise.apart(found.diagnoser.rows.noise) < _NOISE_SETTLED:
                return found
            found = found.under(noise)
        return replace(found, settled=False)

    def beside_unknown(self) -> Searched:
        """Search again, until the same is found, under the noise less what something unknown makes of it."""
        found = self
        for _ in range(_NOISE_ROUNDS):
            before, noise = found, found._noise_beside_unknown()
            if noise.apart(before.diagnoser.rows.noise) < _NOISE_SETTLED:
                return before
            found = before.under(noise)
            if found.hypothesis.keys == before.hypothesis.keys:
                return found
        return replace(found, settled=False)

    @functools.cached_property
    def residual_noise(self) -> NoiseLevel:
        """The noise as all that is left over tells it, where nothing better does."""
        noise, component = self.diagnoser.rows.noise, self.after.fitted_rows.component
        dof = {kind: float(self.hypothesis.freedom[are(kind, component)].sum()) for kind in noise.measured}
        left = noise_left(noise, self.after, self.hypothesis)
        return self.asked.diagnoser.rows.noise.told_by(left, dof, self.diagnoser.asked.false_names)

    def _noise_beside_unknown(self) -> NoiseLevel:
        """Return the same less what something unknown makes of it, of each kind of which that is clear.

        It is never more than before: that causes leave more then shows that they are none.
        """
        noise, left = self.diagnoser.rows.noise, self.residual_noise
        larger = {kind: left[kind].sigma / noise[kind].sigma for kind in left.open_kinds}
        shares = {kind: self._share(kind, factor, len(larger)) for kind, factor in larger.items()}
        return noise.times({kind: min(factor * shares[kind], 1.0) for kind, factor in larger.items()})

    def _share(self, kind: Kind, factor: float, kinds: int) -> float:
        """Return which share of what is left over of a kind is noise: 1 unless a process clearly makes more of it.

        All of it is so many times as large as the noise. So many kinds are asked, and chance may show in any.
        """
        problem, linear = self.hypothesis.problem, self.after.linear
        own, axes = are(kind, linear.component), self.after.frames.T_tracker_base.rotation
        problem = replace(problem, explanations=self.hypothesis.items).of(own)  # what else may be at work is not asked
        processes = processes_of(self.diagnoser.rows, linear.some(own), axes, chance=False)
        left = Discrepancy.of(self.hypothesis.on(problem), processes).under(factor)
        share, evidence = left.left_to_noise(_MOST_NOISE) if len(left) else (1.0, 0.0)
        clear = evidence > self.diagnoser.thresholds.evidence_of_one_in(kinds * len(left))
        return share if clear and share < _MOST_NOISE else 1.0

    @functools.cached_property
    def gross_errors(self) -> Indices:
        """The rows that nothing explains, by index in the campaign.

        Fitted rows are asked by the fit of them alone: something unknown in the place that is held out says nothing of
        them. Held-out rows are asked by a fit of all, as what is far from all others cannot be foretold.
        """
        given, fitted, gone = self.diagnoser.rows.conditions, self.diagnoser.fitted, self.asked.unfitting.size
        courses = poses(given), given.time_s[:, None]
        own, every = self.hypothesis, self.diagnoser.of_every_row(self.after, self.hypothesis)
        fits = (own, self.after.fitted_rows.row, fitted), (every, self.after.every_row.row, ~fitted)
        left = [RowResiduals(fit.remainder, row, asked) for fit, row, asked in fits]
        deleted = [RowResiduals(fit.studentised_residual, row, asked) for fit, row, asked in fits]
        more = gross_errors((left, deleted), gone, courses)
        if not more.size and not self.telling:  # and what was found is nothing to go by
            rest = self.diagnoser.at_rest().every_row
            more = gross_errors([[RowResiduals(rest.residual, rest.row, fitted | ~fitted)]], gone, courses, HALF)
        if not more.size and len(given) < FEW_ROWS:
            problem = self.diagnoser.problem_at(self.after, of_every_row=True)
            more = gross_error_in_few_rows(problem, self.after.every_row.row, self.diagnoser.thresholds)
        return self.asked.inliers[more]

    @property
    def calm(self) -> bool:
        """Whether what it leaves of most of the fitted rows is noise, or little more."""
        return calm(self.hypothesis.remainder)

    @property
    def telling(self) -> bool:
        """Whether most of the fitted rows are nearly foretold by the others: what takes up any row explains none."""
        return calm(self.hypothesis.leave_one_out_residual)
