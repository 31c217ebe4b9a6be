r"""Cross-validation of a diagnosis: every block held out in turn, foretold by what the others name.

Blocks are those of :mod:`pouring_robot.estimation.splits`. The root mean square of m values is known to its
:math:`1/\sqrt{2m}`: a single block of few rows tells little. Held out in turn, each is foretold by all others, searched
anew, so that neither names nor sizes know it, where the amended robot was linearised. The standard error is the
jackknife's over blocks, so what the rows of a block share counts once.
"""

import itertools
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pouring_robot.diagnosis.diagnoser import Diagnoser, LinearState
from pouring_robot.diagnosis.gap import Gap
from pouring_robot.diagnosis.rows import WhitenedRows
from pouring_robot.estimation.splits import foretold
from pouring_robot.inference.decision import Cause
from pouring_robot.inference.problem import Problem
from pouring_robot.inference.search import search
from pouring_robot.io.progress import Progress, say_nothing
from pouring_robot.io.units import MM
from pouring_robot.mechanism.arrays import BoolArray, FloatArray, Indices

_FEWEST_BLOCKS = 2
FEWEST_VALUES = 50  # held-out values from which on one block tells its error to a tenth, and is enough


@dataclass(frozen=True, eq=False)
class CrossValidatedGap:
    """The gap of rows that took no part, all blocks together."""

    blocks: int  # how many there are
    gap: Gap  # of all their rows, each foretold by the other blocks
    error_m: float  # standard error of the gap's position afterwards, in m
    agreed: int  # of how many blocks the others name what all fitted rows name
    found: Mapping[str, int]  # of how many the others find each effect among it

    @property
    def refuted(self) -> str:
        """That what was found hardly foretells rows it has not seen, in words; "" where it does."""
        if not self.gap.kept:
            return ""
        said = "foretold by the others, blocks held out in turn keep more than half of their gap"
        return f"{said}: what was found takes up the rows that it was fitted to"

    def times_found(self, cause: Cause) -> int:
        """Return how many of the searches without a block find a cause, or what cannot be told apart from it."""
        return min(sum(self.found.get(effect, 0) for effect in (cause.effect, *cause.alternatives)), self.blocks)

    def seldom(self, cause: Cause) -> bool:
        """Return whether fewer than half of these searches find a cause; of workmanship none is asked."""
        return bool(cause.indices) and 2 * self.times_found(cause) < self.blocks

    def tempered(self, cause: Cause) -> Cause:
        """Return a cause no surer than its share of these searches says, if most do without it.

        By Laplace's rule of succession: of a cause that evidence is sure of, but that hangs on the rows of one block.
        """
        share = (self.times_found(cause) + 1) / (self.blocks + 2)
        return replace(cause, probability=min(cause.probability, share)) if self.seldom(cause) else cause

    def figures(self) -> dict[str, object]:
        """Return the gap's metrics and how well they are known."""
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
    """Return how well each block is foretold by the others, but for those that alone tell of the frames.

    Blocks are rows by index, together all of them; ``names`` are the effects that all fitted rows name. None where
    fewer than two blocks can be foretold.
    """
    problem, linear = diagnoser.problem_at(after, of_every_row=True), after.every_row
    free = problem.nuisance.axes

    def told(block: BoolArray) -> bool:
        return foretold([free[~block].T @ free[~block]], free[block].T @ free[block])

    masks = {k: block for k, rows in enumerate(blocks) if told(block := np.isin(linear.row, rows))}
    if len(masks) < _FEWEST_BLOCKS:
        return None
    given, found, named = np.zeros(len(linear.row)), np.zeros(len(linear.row)), list[frozenset[str]]()
    for turn, block in enumerate(masks.values()):
        progress("holding out each block in turn", turn, len(masks))
        given[block] = _unforeseen(before.every_row.residual, free, block)
        left, effects = _searched(diagnoser, problem, block)
        found[block] = _unforeseen(left, free, block)
        named.append(effects)
    sigma, every = diagnoser.rows.measured.sigma, np.arange(len(diagnoser.rows))
    foreseen = np.isin(every, np.concatenate([blocks[k] for k in masks]))

    def gap(rows: BoolArray) -> Gap:
        return Gap.between(replace(linear, residual=given), replace(linear, residual=found), rows, sigma)

    fewer = np.array([gap(foreseen & ~np.isin(every, blocks[k])).position("after") for k in masks])
    error = float(np.sqrt((len(masks) - 1) * fewer.var()))
    agreed = sum(effects == names for effects in named)
    return CrossValidatedGap(len(masks), gap(foreseen), error, agreed, Counter(itertools.chain.from_iterable(named)))


def few(seen: WhitenedRows, fitted: BoolArray) -> bool:
    """Return whether the rows held out hold so few values that a single block tells little."""
    return 0 < int((~fitted)[seen.row].sum()) < FEWEST_VALUES


def _searched(diagnoser: Diagnoser, problem: Problem, block: BoolArray) -> tuple[FloatArray, frozenset[str]]:
    """Return what is left of all equations by what the others' are explained with, and the effects among it."""
    found = search(problem.of(~block), diagnoser.thresholds)
    left = problem.residual - found.on(problem).columns @ np.concatenate([np.zeros(0), *found.values])
    return left, frozenset(item.effect for item in found.items if item.cause)


def _unforeseen(values: FloatArray, free: FloatArray, block: BoolArray) -> FloatArray:
    """Return a block's values, the free unknowns fitted to the others."""
    return np.asarray(values[block] - free[block] @ np.linalg.lstsq(free[~block], values[~block], rcond=None)[0])
