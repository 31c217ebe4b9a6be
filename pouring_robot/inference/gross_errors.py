"""Gross errors: single rows that nothing explains while nearly all others are explained better.

Of few rows anything is explained by some effect; that a row is off by itself is then one more explanation to be tried.

Found here after a search, they are left out and it is searched again (``diagnosis/diagnose.py``); after a fit of all
parameters to choose from, they are left out of a calibration (``calibration/outliers.py``). Before any fit they are
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
"""So often it is looked again, without the rows that were found: some hide behind others."""
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
"""Usual size of a gross error, over the noise; averaged over as those of effects, from 1 to 1,000 times the noise."""


class RowResiduals(NamedTuple):
    """Rows as one fit leaves them."""

    left: FloatArray  # what it leaves of them, or their deletion residuals, in units of the noise, (m,)
    row: Indices  # row of each of these, (m,)
    asked: BoolArray  # which of all rows may be gross errors for it, (n,)


def calm(left: FloatArray) -> bool:
    """Return whether residuals (m,) in units of the noise are mostly noise, or at most half as much again.

    By their median, which a few wrong rows do not move.
    """
    return robust_sigma(left) < _CALM


def gross_errors(
    seen: Iterable[Sequence[RowResiduals]], gone: int, courses: Sequence[FloatArray], share: float = NINE_TENTHS
) -> Indices:
    """Return the rows that are gross errors; none where they would be too many to be single ones.

    A gross error draws the answer to itself, so that the others may not be explained to their noise before it is left
    out: rows count by what nine tenths of them stay below, in what is left or else in deletion residuals. Up to the
    last tenth may be wrong; where they are more than a few they must be scattered, as something unknown comes in some
    place or for some time. Where gross errors may have kept causes from being found, what the given model leaves is
    asked by the better half: what these causes do has long tails, of which nine tenths of the rows say nothing.

    Args:
        seen: what nothing explains of n rows, and then their deletion residuals: of some of the rows each.
        gone: how many rows were found to be so already, and are not among these.
        courses: along which something unknown may come, such as pose and time, (n, k) each.
        share: of the rows, by what they stay below rows count.
    """
    level, rows = _TOGETHER / len(courses), len(courses[0])
    for some in seen:
        wrong = np.flatnonzero(np.any([_beyond(one, share) for one in some], axis=0))
        count = wrong.size + gone
        few, most = count <= max(_FEW, int(_FEW_SHARE * rows)), (1.0 - NINE_TENTHS) * rows
        if wrong.size and (few or (count <= most and all(_together(wrong, c) >= level for c in courses))):
            return wrong
    return np.zeros(0, dtype=np.intp)


def gross_error_in_few_rows(problem: Problem, row: Indices, thresholds: Thresholds) -> Indices:
    """Return the row that is a gross error more likely than what else takes it up; none, or one.

    That a row is off, each of its equations by itself, is searched for beside all that the problem has; ``row`` is that
    of each equation, (m,). Where more than one is off, then or without it, none is known to be wrong.
    """
    wrong = _off_beside(problem, row, thresholds)
    if wrong.size != 1 or _off_beside(problem.of(row != wrong[0]), row[row != wrong[0]], thresholds).size:
        return wrong[:0]
    return wrong


def _off_beside(problem: Problem, row: Indices, thresholds: Thresholds) -> Indices:
    """Return the rows that are off by themselves beside the effects that are found with them."""
    rows = {f"{one}": one for one in np.unique(row).tolist()}
    wrong = [_off(problem, row == one, form) for form, one in rows.items()]
    found = search(problem.and_also(wrong), thresholds)
    return np.array([rows[item.form] for item in found.items if item in wrong], dtype=np.intp)


def _off(problem: Problem, own: BoolArray, form: str) -> Explanation:
    """Return that a row's equations, by a mask (m,), are off, each by itself."""
    columns = _USUAL * (np.arange(len(own))[:, None] == np.flatnonzero(own))
    every = np.ones(columns.shape[1], dtype=bool)
    return Explanation("gross error", form, problem.nuisance.clear(columns), every, cause=False)


def _beyond(seen: RowResiduals, share: float) -> BoolArray:
    """Return which of the rows that are asked are far beyond what a share of all that are seen stays below, (n,)."""
    worst = np.full(len(seen.asked), -np.inf)
    np.maximum.at(worst, seen.row, np.abs(seen.left))
    every = worst[worst >= 0.0]
    # The largest of so many normal values stays below this in that share of rows.
    usual = float(ndtri(0.5 + 0.5 * share ** (len(every) / len(seen.left))))
    return np.asarray(seen.asked & (worst > _SIGMAS * max(1.0, float(np.quantile(every, share)) / usual)))


def _together(wrong: Indices, course: FloatArray) -> float:
    """Return the probability that so many of some rows have one of them for their nearest neighbour by chance."""
    neighbours = KDTree(course).query(course[wrong], k=2)[1]
    nearest = np.where(neighbours[:, 0] == wrong, neighbours[:, 1], neighbours[:, 0])
    count, share = int(np.isin(nearest, wrong).sum()), (wrong.size - 1) / (len(course) - 1)
    return float(bdtrc(count - 1, wrong.size, share))
