"""Rows that no error of the robot explains, found by the residuals of a fit of all candidate parameters.

Before any fit (``checks/gross_errors.py``) a wrong row cannot be distinguished from equally large errors of the robot.
"""

import numpy as np

from pouring_robot.campaign.data import Campaign
from pouring_robot.checks.flags import DataFlag, FlagCode, flagged
from pouring_robot.estimation.map_fit import Fit
from pouring_robot.estimation.measurement import ModelledRows
from pouring_robot.estimation.residuals import MeasuredPoses, whiten
from pouring_robot.estimation.splits import Split
from pouring_robot.inference.gaussian_processes.kernels import standardised
from pouring_robot.inference.gross_errors import RowResiduals, gross_errors, near_noise
from pouring_robot.inference.hypotheses import studentised_residual
from pouring_robot.mechanism.arrays import FloatArray, Indices


def explains(fit: Fit) -> bool:
    """Return whether the residuals of a fit are noise, or little more, in most of its rows."""
    return near_noise(fit.equations.residual)


def outlying_rows(
    campaign: Campaign, rows: ModelledRows, measured: MeasuredPoses, parts: Split, fit: Fit, gone: int
) -> Indices:
    """Return the rows of a campaign that are gross errors by the residuals of a fit to its training rows, by index.

    Held-out rows are predicted by it (their residuals are over the root of the variance of noise and prediction), and
    are tested only if it predicts most of them: otherwise something unknown is present there. ``gone`` is how many rows
    were found before.
    """
    kept = parts.rows
    held_out = np.isin(kept, parts.test)
    time = campaign.time_s if campaign.time_s is not None else np.arange(len(campaign), dtype=float)
    known = time[kept] if np.isfinite(time[kept]).all() else kept.astype(float)
    courses = standardised(campaign.drives[kept]), known[:, None]
    used, _ = measured.among(parts.train)
    own, residual = np.searchsorted(kept, used[fit.equations.rows]), fit.equations.residual
    deleted = studentised_residual(residual, 1.0 - fit.leverage)
    asked, seen = measured.among(parts.test)
    test = whiten(seen, rows[asked].linearise(fit.unknowns))
    predicted = test.residual / np.sqrt(1.0 + ((test.derivatives @ fit.covariance) * test.derivatives).sum(axis=1))
    tested = [RowResiduals(residual, own, ~held_out)], [RowResiduals(deleted, own, ~held_out)]
    if near_noise(predicted):
        every = np.concatenate([own, np.searchsorted(kept, asked[test.rows])])
        for some in tested:
            some.append(RowResiduals(np.concatenate([some[0].left, predicted]), every, held_out))
    return kept[gross_errors(tested, gone, courses)]


def outlier_flags(campaign: Campaign, rows: Indices, off: FloatArray) -> tuple[DataFlag, ...]:
    """Return the findings for rows (k,) that are so many times the noise, (k,), from the fit to the others."""
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
