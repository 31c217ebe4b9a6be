"""Gross errors: single outlying rows that nothing explains, while nearly all others are explained better.

With few rows, some effect explains anything; an error of a single row is then one more explanation to be tried.

Rows found here after a search are left out and the search is repeated (``diagnosis/diagnose.py``). Rows found after a
fit of all candidate parameters are left out of a calibration (``calibration/outliers.py``). Before any fit they are
found in ``checks/gross_errors.py``; in a fit a robust loss bounds them (``estimation/robust.py``).
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree
from scipy.special import bdtrc, ndtri

from pouring_robot.inference.problem import Explanation, Problem
from pouring_robot.inference.search import search
from pouring_robot.inference.thresholds import Thresholds
from pouring_robot.mechanism.arrays import BoolArray, FloatArray, Indices, robust_sigma

ROUNDS = 3
"""Number of searches for more, each without the rows found before: some hide behind others."""
_SIGMAS = 6.5
"""One of a million normal values is beyond 4.9; this leaves room for tails that are not normal."""
_FEW_SHARE, _FEW = 0.04, 2
"""At most this share of the rows, or number in a small campaign, are single ones wherever they are."""
_NEAR_NOISE = 1.5
NINE_TENTHS, HALF = 0.9, 0.5
"""Shares of the rows whose quantile of the residuals sets the scale of outliers."""
_TOGETHER = 0.01
"""Probability, over all conditions, that scattered rows are mistaken for a cluster."""
_USUAL = 100.0
"""Usual size of a gross error, over the noise; averaged over like that of effects, from 1 to 1,000 times the noise."""


class RowResiduals(NamedTuple):
    """Residuals of one fit, by row."""

    left: FloatArray  # its residuals, or deletion residuals, in units of the noise, (m,)
    row: Indices  # row of each of these, (m,)
    asked: BoolArray  # which of all rows may be gross errors by this fit, (n,)


def near_noise(left: FloatArray) -> bool:
    """Return whether residuals (m,) in units of the noise are at most one and a half times the noise.

    By their median, which a few wrong rows hardly change.
    """
    return robust_sigma(left) < _NEAR_NOISE


def gross_errors(
    seen: Iterable[Sequence[RowResiduals]], gone: int, courses: Sequence[FloatArray], share: float = NINE_TENTHS
) -> Indices:
    """Return the rows that are gross errors; none where they would be too many to be single ones.

    A gross error pulls the fit towards itself, so that the others may not be explained to their noise before it is left
    out. Rows are therefore compared with the 90 % quantile of all rows, of residuals or else of deletion residuals. Up
    to a tenth may be wrong. If they are more than a few they must be scattered, as something unknown may act in some
    region or for some time. Where gross errors may have kept causes from being found, residuals of the given model are
    compared with their median, as what these causes do has long tails that a 90 % quantile would include.

    Args:
        seen: residuals of n rows, then their deletion residuals: each of some of the rows.
        gone: number of rows that were found before and are not among these.
        courses: conditions in which something unknown may act, such as pose and time, (n, k) each.
        share: of the rows, whose quantile sets the scale.
    """
    level, rows = _TOGETHER / len(courses), len(courses[0])
    for fits in seen:
        wrong = np.flatnonzero(np.any([_beyond(one, share) for one in fits], axis=0))
        count = wrong.size + gone
        few, most = count <= max(_FEW, int(_FEW_SHARE * rows)), (1.0 - NINE_TENTHS) * rows
        if wrong.size and (few or (count <= most and all(_together(wrong, c) >= level for c in courses))):
            return wrong
    return np.zeros(0, dtype=np.intp)


def gross_error_in_few_rows(problem: Problem, row: Indices, thresholds: Thresholds) -> Indices:
    """Return the row that is more likely a gross error than explained otherwise; none, or one.

    An error of a single row, each of its equations independent, is searched for together with all explanations of the
    problem; ``row`` is the row of each equation, (m,). Where more rows are off, with it or once it is removed, none is
    returned.
    """
    wrong = _rows_off(problem, row, thresholds)
    if wrong.size != 1 or _rows_off(problem.of(row != wrong[0]), row[row != wrong[0]], thresholds).size:
        return wrong[:0]
    return wrong


def _rows_off(problem: Problem, row: Indices, thresholds: Thresholds) -> Indices:
    """Return the rows that a search finds to be off, with the effects found together with them."""
    rows = {f"{one}": one for one in np.unique(row).tolist()}
    wrong = [_row_off(problem, row == one, form) for form, one in rows.items()]
    found = search(problem.and_also(wrong), thresholds)
    return np.array([rows[item.form] for item in found.items if item in wrong], dtype=np.intp)


def _row_off(problem: Problem, own: BoolArray, form: str) -> Explanation:
    """Return the explanation that a row's equations, by a mask (m,), are off, each independently."""
    columns = _USUAL * (np.arange(len(own))[:, None] == np.flatnonzero(own))
    every = np.ones(columns.shape[1], dtype=bool)
    return Explanation("gross error", form, problem.nuisance.clear(columns), every, cause=False)


def _beyond(seen: RowResiduals, share: float) -> BoolArray:
    """Return which of the rows that may be gross errors are far beyond the quantile of all rows, (n,)."""
    worst = np.full(len(seen.asked), -np.inf)
    np.maximum.at(worst, seen.row, np.abs(seen.left))
    every = worst[worst >= 0.0]
    # The largest of as many normal values per row stays below this in that share of rows.
    usual = float(ndtri(0.5 + 0.5 * share ** (len(every) / len(seen.left))))
    return np.asarray(seen.asked & (worst > _SIGMAS * max(1.0, float(np.quantile(every, share)) / usual)))


def _together(wrong: Indices, course: FloatArray) -> float:
    """Return the probability that by chance so many or more of some rows have another of them as nearest neighbour."""
    neighbours = KDTree(course).query(course[wrong], k=2)[1]
    nearest = np.where(neighbours[:, 0] == wrong, neighbours[:, 1], neighbours[:, 0])
    count, share = int(np.isin(nearest, wrong).sum()), (wrong.size - 1) / (len(course) - 1)
    return float(bdtrc(count - 1, wrong.size, share))
