"""A campaign searched under its own noise: where none is stated, the noise is estimated from the residuals.

While rows that fit nothing are identified, all of the residual counts as noise. It may still contain something unknown,
which a noise as large as that would hide (:meth:`Searched.beside_unknown`).
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
from pouring_robot.inference.gross_errors import HALF, RowResiduals, gross_error_in_few_rows, gross_errors, near_noise
from pouring_robot.inference.hypotheses import Hypothesis
from pouring_robot.inference.larger_noise import LargerNoise
from pouring_robot.mechanism.arrays import Indices

_NOISE_ROUNDS, _NOISE_SETTLED = 20, 0.02
"""Every round is a whole search, starting with the result of the one before; nine were needed where rotations were
ninety times as poor as positions. 2 % of the noise is 4 % of a difference of evidence, which decides nothing."""
_MOST_NOISE = 2.0**-0.5
"""Largest share of noise in the residual at which something unknown makes more of it: more than half of its square.
Something smaller than the noise need hardly be found."""


@dataclass(frozen=True, eq=False)
class Subset:
    """A campaign with some rows left out."""

    flagged: Indices  # rows that the checks found to be wrong, by index in the campaign
    unfitting: Indices  # rows left out because nothing that was found explains them, likewise
    inliers: Indices  # rows that are used, likewise
    parts: Split | None  # which of these are held out; None: none
    notes: tuple[str, ...]  # on the held-out rows
    diagnoser: Diagnoser  # for these rows, under the noise that is known beforehand

    @property
    def left_out(self) -> Indices:
        """Rows that are left out as wrong, by index in the campaign."""
        return np.union1d(self.flagged, self.unfitting)


@dataclass(frozen=True, eq=False)
class Searched:
    """The best explanation of a subset, under the noise of its diagnoser."""

    asked: Subset
    diagnoser: Diagnoser
    after: LinearState
    hypothesis: Hypothesis
    settled: bool = True  # whether the residual is as large as that noise, where the noise is estimated from it
    # the larger noise as which the residual under the stated noise scatters; this was found under the larger one
    larger_noise: LargerNoise | None = None
    stated: NoiseLevel | None = None  # the noise before that; None where it is the diagnoser's

    @property
    def noise(self) -> NoiseLevel:
        """The noise as stated or estimated."""
        return replace(self.stated or self.diagnoser.rows.noise, settled=self.settled)

    def under_larger(self, larger: LargerNoise) -> Searched:
        """Repeat the search from nothing under a larger noise: results under too small a noise are wrongly weighted.

        Where that of all kinds looks larger, each kind has as much as its own residuals show.
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
        """Search again under another noise, starting with what was found."""
        diagnoser = replace(self.diagnoser, rows=self.diagnoser.rows.with_noise(noise))
        return Searched(self.asked, diagnoser, *diagnoser.found(self.hypothesis, self.after.alone), self.settled)

    def with_noise_settled(self) -> Searched:
        """Search again until all of the residual is as large as the noise under which it was found."""
        found = self
        for _ in range(_NOISE_ROUNDS):
            noise = found.residual_noise
            if noise.apart(found.diagnoser.rows.noise) < _NOISE_SETTLED:
                return found
            found = found.under(noise)
        return replace(found, settled=False)

    def beside_unknown(self) -> Searched:
        """Search again, until the same is found, under the noise without the share of something unknown."""
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
        """The noise estimated from all of the residual, where nothing better is known."""
        noise, component = self.diagnoser.rows.noise, self.after.fitted_rows.component
        dof = {kind: float(self.hypothesis.freedom[are(kind, component)].sum()) for kind in noise.measured}
        left = noise_left(noise, self.after, self.hypothesis)
        return self.asked.diagnoser.rows.noise.pooled_with(left, dof, self.diagnoser.asked.false_names)

    def _noise_beside_unknown(self) -> NoiseLevel:
        """Return the same without the share of something unknown, for each kind for which that is clear.

        It never exceeds the noise before: if causes then leave more, they are no causes.
        """
        noise, left = self.diagnoser.rows.noise, self.residual_noise
        larger = {kind: left[kind].sigma / noise[kind].sigma for kind in left.open_kinds}
        shares = {kind: self._share(kind, factor, len(larger)) for kind, factor in larger.items()}
        return noise.times({kind: min(factor * shares[kind], 1.0) for kind, factor in larger.items()})

    def _share(self, kind: Kind, factor: float, kinds: int) -> float:
        """Return the share of noise in the residual of a kind: 1 unless a process clearly makes more of it.

        The whole residual is ``factor`` times the noise. ``kinds`` is the number of kinds tested.
        """
        problem, linear = self.hypothesis.problem, self.after.linear
        own, axes = are(kind, linear.component), self.after.frames.T_tracker_base.rotation
        problem = replace(problem, explanations=self.hypothesis.items).of(own)  # no other explanations are tried
        processes = processes_of(self.diagnoser.rows, linear.some(own), axes, chance=False)
        left = Discrepancy.of(self.hypothesis.on(problem), processes).under(factor)
        share, evidence = left.left_to_noise(_MOST_NOISE) if len(left) else (1.0, 0.0)
        clear = evidence > self.diagnoser.thresholds.evidence_of_one_in(kinds * len(left))
        return share if clear and share < _MOST_NOISE else 1.0

    @functools.cached_property
    def gross_errors(self) -> Indices:
        """The rows that nothing explains, by index in the campaign.

        Fitted rows are tested by the fit without held-out ones: something unknown that acts in the held-out region says
        nothing of them. Held-out rows are tested by a fit of all, as rows far from all others cannot be predicted.
        """
        given, fitted, gone = self.diagnoser.rows.conditions, self.diagnoser.fitted, self.asked.unfitting.size
        courses = poses(given), given.time_s[:, None]
        own, every = self.hypothesis, self.diagnoser.of_every_row(self.after, self.hypothesis)
        fits = (own, self.after.fitted_rows.row, fitted), (every, self.after.every_row.row, ~fitted)
        left = [RowResiduals(fit.remainder, row, asked) for fit, row, asked in fits]
        deleted = [RowResiduals(fit.studentised_residual, row, asked) for fit, row, asked in fits]
        more = gross_errors((left, deleted), gone, courses)
        if not more.size and not self.predictive:  # what was found says nothing of the rows
            rest = self.diagnoser.at_rest().every_row
            more = gross_errors([[RowResiduals(rest.residual, rest.row, fitted | ~fitted)]], gone, courses, HALF)
        if not more.size and len(given) < FEW_ROWS:
            problem = self.diagnoser.problem_at(self.after, of_every_row=True)
            more = gross_error_in_few_rows(problem, self.after.every_row.row, self.diagnoser.thresholds)
        return self.asked.inliers[more]

    @property
    def near_noise(self) -> bool:
        """Whether the residuals of most fitted rows are noise, or little more."""
        return near_noise(self.hypothesis.remainder)

    @property
    def predictive(self) -> bool:
        """Whether most fitted rows are nearly predicted by the others: what fits any row explains none."""
        return near_noise(self.hypothesis.leave_one_out_residual)
