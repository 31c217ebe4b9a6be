r"""Cross-validation of a diagnosis: every block held out in turn and predicted by what is found in the others.

Blocks are those of :mod:`pouring_robot.estimation.splits`. The root mean square of m values has a relative uncertainty
of :math:`1/\sqrt{2m}`: a single block of few rows says little. Held out in turn, each is predicted from all others, at
the linearisation of the amended robot. The search is repeated without it, so that it affects neither names nor sizes.
The standard error is the jackknife's over blocks, so that errors shared by the rows of a block count once.
"""

import itertools
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pouring_robot.diagnosis.diagnoser import Diagnoser, LinearState
from pouring_robot.diagnosis.gap import Gap
from pouring_robot.diagnosis.rows import WhitenedRows
from pouring_robot.estimation.splits import frames_determined
from pouring_robot.inference.decision import Cause
from pouring_robot.inference.problem import Problem
from pouring_robot.inference.search import search
from pouring_robot.io.progress import Progress, say_nothing
from pouring_robot.io.units import MM
from pouring_robot.mechanism.arrays import BoolArray, FloatArray, Indices

_FEWEST_BLOCKS = 2
FEWEST_VALUES = 50  # held-out values from which on one block suffices, as its error is then known to a tenth


@dataclass(frozen=True, eq=False)
class CrossValidatedGap:
    """The gap of rows that took no part, all blocks together."""

    blocks: int  # how many there are
    gap: Gap  # of all their rows, each predicted from the other blocks
    error_m: float  # standard error of the gap's position afterwards, in m
    agreed: int  # for how many blocks the others give the same names as all fitted rows
    found: Mapping[str, int]  # for how many blocks the others find each effect

    @property
    def refuted(self) -> str:
        """That what was found hardly predicts held-out rows, in words; "" where it does."""
        if not self.gap.kept:
            return ""
        said = "predicted from the others, blocks held out in turn keep more than half of their gap"
        return f"{said}: what was found describes only the rows it was fitted to"

    def times_found(self, cause: Cause) -> int:
        """Return how many of the searches without a block find a cause or one of its alternatives."""
        return min(sum(self.found.get(effect, 0) for effect in (cause.effect, *cause.alternatives)), self.blocks)

    def seldom(self, cause: Cause) -> bool:
        """Return whether fewer than half of these searches find a cause; never for workmanship."""
        return bool(cause.indices) and 2 * self.times_found(cause) < self.blocks

    def tempered(self, cause: Cause) -> Cause:
        """Return a cause with its probability limited by its share of these searches, if most do not find it.

        By Laplace's rule of succession: such a cause may have much evidence, but depends on the rows of one block.
        """
        share = (self.times_found(cause) + 1) / (self.blocks + 2)
        return replace(cause, probability=min(cause.probability, share)) if self.seldom(cause) else cause

    def figures(self) -> dict[str, object]:
        """Return the gap's metrics and their uncertainty."""
        own = {"blocks": self.blocks, "after_std_error_mm": self.error_m / MM, "same_names": self.agreed}
        return {**self.gap.figures(), **own, "found": dict(self.found)}


def held_out_in_turn(
    diagnoser: Diagnoser,
    before: LinearState,
    after: LinearState,
    blocks: Sequence[Indices],
    names: frozenset[str],
    progress: Progress = say_nothing,
) -> CrossValidatedGap | None:
    """Return how well each block is predicted from the others, except those that alone determine the frames.

    Blocks are rows by index, together all of them; ``names`` are the effects that all fitted rows name. None where
    fewer than two blocks can be predicted.
    """
    problem, linear = diagnoser.problem_at(after, of_every_row=True), after.every_row
    free = problem.nuisance.axes

    def predictable(block: BoolArray) -> bool:
        return frames_determined([free[~block].T @ free[~block]], free[block].T @ free[block])

    masks = {k: block for k, rows in enumerate(blocks) if predictable(block := np.isin(linear.row, rows))}
    if len(masks) < _FEWEST_BLOCKS:
        return None
    given, found, named = np.zeros(len(linear.row)), np.zeros(len(linear.row)), list[frozenset[str]]()
    for turn, block in enumerate(masks.values()):
        progress("holding out each block in turn", turn, len(masks))
        given[block] = _prediction_error(before.every_row.residual, free, block)
        left, effects = _searched(diagnoser, problem, block)
        found[block] = _prediction_error(left, free, block)
        named.append(effects)
    sigma, every = diagnoser.rows.measured.sigma, np.arange(len(diagnoser.rows))
    predicted = np.isin(every, np.concatenate([blocks[k] for k in masks]))

    def gap(rows: BoolArray) -> Gap:
        return Gap.between(replace(linear, residual=given), replace(linear, residual=found), rows, sigma)

    fewer = np.array([gap(predicted & ~np.isin(every, blocks[k])).position("after") for k in masks])
    error = float(np.sqrt((len(masks) - 1) * fewer.var()))
    agreed = sum(effects == names for effects in named)
    return CrossValidatedGap(len(masks), gap(predicted), error, agreed, Counter(itertools.chain.from_iterable(named)))


def few(seen: WhitenedRows, fitted: BoolArray) -> bool:
    """Return whether the held-out rows have so few values that a single block says little."""
    return 0 < int((~fitted)[seen.row].sum()) < FEWEST_VALUES


def _searched(diagnoser: Diagnoser, problem: Problem, block: BoolArray) -> tuple[FloatArray, frozenset[str]]:
    """Return the residual of all equations after what a search finds without a block, and the effects it finds."""
    found = search(problem.of(~block), diagnoser.thresholds)
    left = problem.residual - found.on(problem).columns @ np.concatenate([np.zeros(0), *found.values])
    return left, frozenset(item.effect for item in found.items if item.cause)


def _prediction_error(values: FloatArray, free: FloatArray, block: BoolArray) -> FloatArray:
    """Return a block's values, with the free unknowns fitted to the other blocks."""
    return np.asarray(values[block] - free[block] @ np.linalg.lstsq(free[~block], values[~block], rcond=None)[0])
