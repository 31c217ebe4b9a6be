"""Gross errors: single rows that nothing explains while nearly all others are explained better.

Of few rows anything is explained by some effect; that a row is off by itself is then one more explanation to be tried.

Found here after a search, they are left out and it is searched again (``diagnosis/diagnose.py``). Before any fit they
are found in ``checks/gross_errors.py``; in a fit a robust loss bounds them (``estimation/robust.py``).
"""

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree
from scipy.special import bdtrc, ndtri

from pouring_robot.inference.problem import Explanation, Problem
from pouring_robot.inference.search import search
from pouring_robot.inference.thresholds import Thresholds
from pouring_robot.mechanism.arrays import BoolArray, FloatArray, robust_sigma

_SIGMAS = 6.5
"""Of a million normal values one is beyond 4.9; this leaves room for tails that are no longer normal."""
_FEW_SHARE, _FEW = 0.04, 2
"""So few rows, or so many of a small campaign, are single ones wherever they are."""
_CALM = 1.5
NINE_TENTHS, HALF = 0.9, 0.5
"""Shares of the rows, by what they stay below rows count."""
_TOGETHER = 0.01
"""Probability, over all courses, that scattered rows are taken for rows that lie together."""
_USUAL = 100.0
"""Size of a gross error, over the noise, as of an effect's own units: 1 to 1,000 times the noise are as likely."""


def calm(left: FloatArray) -> bool:
    """Return whether residuals (m,) in units of the noise are mostly noise, or at most half as much again.

    By their median, which a few wrong rows do not move.
    """
    return robust_sigma(left) < _CALM


def gross_errors(
    residuals: Iterable[FloatArray],
    row: NDArray[np.intp],
    gone: int,
    courses: Sequence[FloatArray],
    parts: Sequence[BoolArray],
    share: float = NINE_TENTHS,
) -> NDArray[np.intp]:
    """Return the rows that are gross errors; none where they would be too many to be single ones.

    A gross error draws the answer to itself, so that the others may not be explained to their noise before it is left
    out: rows count by what nine tenths of them stay below, in what is left or else in deletion residuals. Up to the
    last tenth may be wrong; where they are more than a few they must be scattered, as something unknown comes in some
    place or for some time. Where gross errors may have kept causes from being found, what the given model leaves is
    asked by the better half: what these causes do has long tails, of which nine tenths of the rows say nothing.

    Args:
        residuals: what nothing explains of n rows, in units of the noise, and their deletion residuals, (m,).
        row: row of each of these, (m,).
        gone: how many rows are left out already.
        courses: along which something unknown may come, such as pose and time, (n, k) each.
        parts: of the rows, (n,) each, such as those that are held out: what is not foretold of most of one part is
            unknown there, and says nothing of the others.
        share: of the rows, by what they stay below rows count.
    """
    level, rows = _TOGETHER / len(courses), len(courses[0])
    for left in residuals:
        wrong = np.flatnonzero(np.any([_beyond(left, row, part, share) for part in parts], axis=0))
        count = wrong.size + gone
        few, most = count <= max(_FEW, int(_FEW_SHARE * rows)), (1.0 - NINE_TENTHS) * rows
        if wrong.size and (few or (count <= most and all(_together(wrong, c) >= level for c in courses))):
            return wrong
    return np.zeros(0, dtype=np.intp)


def gross_errors_of_few(problem: Problem, row: NDArray[np.intp], thresholds: Thresholds) -> NDArray[np.intp]:
    """Return the rows, by the row of each equation (m,), that are gross errors more likely than what takes them up.

    That a row is off, each of its equations by itself, is searched for beside all that the problem has. None where
    they are more than a few.
    """
    wrong = [
        Explanation("gross error", f"{one}", problem.nuisance.clear(columns), np.ones(columns.shape[1], bool), False)
        for one in np.unique(row)
        for columns in [_USUAL * np.eye(len(row))[:, row == one]]
    ]
    found = search(problem.and_also(wrong), thresholds)
    rows = np.array([int(item.form) for item in found.items if item in wrong], dtype=np.intp)
    return np.sort(rows) if rows.size <= _FEW else rows[:0]


def _beyond(left: FloatArray, row: NDArray[np.intp], part: BoolArray, share: float) -> BoolArray:
    """Return which rows of a part are far beyond what a share of them stays below, (n,)."""
    worst = np.zeros(len(part))
    np.maximum.at(worst, row, np.abs(left))
    # The largest of so many normal values stays below this in that share of rows.
    usual = float(ndtri(0.5 + 0.5 * share ** (len(part) / len(left))))
    stays = float(np.quantile(worst[part], share, method="lower")) if part.any() else 0.0
    return np.asarray(part & (worst > _SIGMAS * max(1.0, stays / usual)))


def _together(wrong: NDArray[np.intp], course: FloatArray) -> float:
    """Return the probability that so many of some rows have one of them for their nearest neighbour by chance."""
    neighbours = KDTree(course).query(course[wrong], k=2)[1]
    nearest = np.where(neighbours[:, 0] == wrong, neighbours[:, 1], neighbours[:, 0])
    count, share = int(np.isin(nearest, wrong).sum()), (wrong.size - 1) / (len(course) - 1)
    return float(bdtrc(count - 1, wrong.size, share))
