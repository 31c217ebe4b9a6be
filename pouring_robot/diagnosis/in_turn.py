r"""Every block held out in turn: what a campaign of few rows tells of rows that nobody fitted.

The root mean square of m values is known to its :math:`1/\sqrt{2m}`: a single block of few rows tells little. Here each
block is foretold by all others, searched anew, so that neither names nor sizes know it, where the amended robot was
linearised. The standard error is the jackknife's over blocks, so what the rows of a block share counts once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pouring_robot.diagnosis.gap import Gap
from pouring_robot.diagnosis.rows import WhitenedRows
from pouring_robot.inference.explanations import Problem
from pouring_robot.inference.search import search
from pouring_robot.io.progress import Progress, say_nothing
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.poses import MM

if TYPE_CHECKING:
    from pouring_robot.diagnosis.state import Diagnoser, LinearState

Mask = NDArray[np.bool_]
FEWEST_VALUES = 50
"""Held-out values from which on one block tells its error to a tenth, and is enough."""
_KNOWN = 0.1
"""Share of its information on the frames that the others must have in every direction; else nothing is foretold."""


@dataclass(frozen=True, eq=False)
class InTurn:
    """The gap of rows that took no part, all blocks together."""

    blocks: int  # how many there are
    gap: Gap  # of all their rows, each foretold by the other blocks
    error_m: float  # standard error of the gap's position afterwards, in m
    agreed: int  # of how many blocks the others name what all fitted rows name

    def metrics(self) -> dict[str, object]:
        """Return the gap's metrics and how well they are known."""
        own = {"blocks": self.blocks, "after_std_error_mm": self.error_m / MM, "same_names": self.agreed}
        return {**self.gap.metrics(), **own}


def held_out_in_turn(
    diagnoser: Diagnoser,
    before: LinearState,
    after: LinearState,
    blocks: Sequence[NDArray[np.intp]],
    names: frozenset[str],
    progress: Progress = say_nothing,
) -> InTurn | None:
    """Return how well each block is foretold by the others; None where some block alone tells of the frames.

    Blocks are rows by index, together all of them; ``names`` are the effects that all fitted rows name.
    """
    problem, linear = diagnoser.problem_at(after, of_every_row=True), after.every_row
    masks = [np.isin(linear.row, rows) for rows in blocks]
    free = problem.nuisance.axes
    # Of columns that are orthonormal over all rows a singular value squared is a share of 1.
    if any(np.linalg.svd(free[~block], compute_uv=False).min(initial=1.0) ** 2 < _KNOWN for block in masks):
        return None
    given, found, agreed = np.zeros(len(linear.row)), np.zeros(len(linear.row)), 0
    for turn, block in enumerate(masks):
        progress("holding out each block in turn", turn, len(masks))
        given[block] = _unforeseen(before.every_row.residual, free, block)
        left, named = _searched(diagnoser, problem, block)
        found[block] = _unforeseen(left, free, block)
        agreed += named == names
    sigma, everything = diagnoser.rows.measured.sigma, np.ones(len(diagnoser.rows), dtype=bool)

    def gap(rows: Mask) -> Gap:
        return Gap.between(replace(linear, residual=given), replace(linear, residual=found), rows, sigma)

    fewer = np.array([gap(~np.isin(np.arange(len(everything)), rows)).position("after") for rows in blocks])
    error = float(np.sqrt((len(blocks) - 1) * fewer.var()))
    return InTurn(len(blocks), gap(everything), error, agreed)


def few(seen: WhitenedRows, fitted: Mask) -> bool:
    """Return whether the rows held out hold so few values that a single block tells little."""
    return 0 < int((~fitted)[seen.row].sum()) < FEWEST_VALUES


def _searched(diagnoser: Diagnoser, problem: Problem, block: Mask) -> tuple[FloatArray, frozenset[str]]:
    """Return what is left of all equations by what the others' are explained with, and the effects among it."""
    found = search(problem.of(~block), diagnoser.thresholds)
    values = np.concatenate([np.zeros(0), *found.weights()]) * found.coefficients()[0]
    left = problem.residual - found.on(problem).columns @ values
    return left, frozenset(item.effect for item in found.items if item.cause)


def _unforeseen(values: FloatArray, free: FloatArray, block: Mask) -> FloatArray:
    """Return a block's values, the free unknowns fitted to the others."""
    return np.asarray(values[block] - free[block] @ np.linalg.lstsq(free[~block], values[~block], rcond=None)[0])
