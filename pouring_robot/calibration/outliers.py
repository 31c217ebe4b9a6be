"""Rows that no error of the robot explains: found by what a fit of all parameters there are to choose from leaves.

Before any fit (``checks/gross_errors.py``) a wrong row is not told from errors of the robot that are as large.
"""

import numpy as np

from pouring_robot.campaign.data import Campaign
from pouring_robot.checks.flags import DataFlag, FlagCode, flagged
from pouring_robot.estimation.map_fit import Fit
from pouring_robot.estimation.measurement import ModelledRows
from pouring_robot.estimation.residuals import MeasuredPoses, whiten
from pouring_robot.estimation.splits import Split
from pouring_robot.inference.gaussian_processes.kernels import standardised
from pouring_robot.inference.gross_errors import RowResiduals, calm, gross_errors
from pouring_robot.inference.hypotheses import studentised_residual
from pouring_robot.mechanism.arrays import FloatArray, Indices


def explains(fit: Fit) -> bool:
    """Return whether what a fit leaves of most of its rows is noise, or little more."""
    return calm(fit.equations.residual)


def outlying_rows(
    campaign: Campaign, rows: ModelledRows, measured: MeasuredPoses, parts: Split, fit: Fit, gone: int
) -> Indices:
    """Return the rows of a campaign that are gross errors by what a fit to its training rows leaves, by index.

    Held-out rows are foretold by it, as surely as it can (what is left over the root of the variance of noise and
    prediction), and asked where it foretells most of them: else something unknown is at work where they are. ``gone``
    is how many rows were found before.
    """
    kept = np.sort(np.concatenate([parts.train, parts.test]))
    held_out = np.isin(kept, parts.test)
    time = campaign.time_s if campaign.time_s is not None else np.arange(len(campaign), dtype=float)
    known = time[kept] if np.isfinite(time[kept]).all() else kept.astype(float)
    courses = standardised(campaign.drives[kept]), known[:, None]
    used, _ = measured.among(parts.train)
    own, left = np.searchsorted(kept, used[fit.equations.rows]), fit.equations.residual
    deleted = studentised_residual(left, 1.0 - fit.leverage)
    asked, seen = measured.among(parts.test)
    ahead = whiten(seen, rows[asked].linearise(fit.unknowns))
    foretold = ahead.residual / np.sqrt(1.0 + ((ahead.derivatives @ fit.covariance) * ahead.derivatives).sum(axis=1))
    beside = [RowResiduals(left, own, ~held_out)], [RowResiduals(deleted, own, ~held_out)]
    if calm(foretold):
        every = np.concatenate([own, np.searchsorted(kept, asked[ahead.rows])])
        for some in beside:
            some.append(RowResiduals(np.concatenate([some[0].left, foretold]), every, held_out))
    return kept[gross_errors(beside, gone, courses)]


def outlier_flags(campaign: Campaign, rows: Indices, off: FloatArray) -> tuple[DataFlag, ...]:
    """Return the findings of rows (k,) that are so many times the noise, (k,), from what the others make of them."""
    said = "gross error, {:.0f} times the noise from what the fit to the other rows makes of it"
    return tuple(
        flagged(
            campaign,
            FlagCode.OUTLIER,
            f"line {campaign.lines[row]}: {said.format(times)}",
            [row],
            metrics={"times_the_noise": times},
        )
        for row, times in zip(rows.tolist(), off.tolist(), strict=True)
    )
