"""What chance alone makes of the evidence: a parametric bootstrap at the fitted null of the data at hand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pouring_robot.inference.evidence import eigen, evidences
from pouring_robot.inference.hypotheses import Hypothesis

DRAWS, SEED = 1000, 0


@dataclass(frozen=True)
class Chance:
    """The largest log evidence of any cause where none is at work."""

    evidence: float  # it is larger with the accepted rate of false names only, in nats
    draws: int = DRAWS  # residuals drawn
    seed: int = SEED  # of the draws


def by_chance(null: Hypothesis, rate: float, draws: int = DRAWS, seed: int = SEED) -> Chance:
    """Return what the evidence is by chance: noise and workmanship at their most probable level, and nothing else.

    Inner products of columns with a residual drawn from the null's covariance C are normal with the columns' own inner
    products through C for covariance, so that no residual has to be drawn.

    Args:
        null: the hypothesis without causes.
        rate: share of draws that may be beyond.
        draws: how many.
        seed: of the draws.
    """
    problem, inner = null.problem, null.everything.gram.columns
    squared, axes = eigen(inner)
    # The symmetric root: any other depends on the signs and the order of axes that this machine's library chose.
    spread = (axes * np.sqrt(np.maximum(squared, 0.0))) @ axes.T
    projected = spread @ np.random.default_rng(seed).normal(size=(len(inner), draws))
    largest = np.zeros(draws)
    for item in problem.explanations:
        if item.cause and item.columns.any():
            places = problem.places(item)
            found = evidences(
                inner[places[:, None], places], projected[places], item.main, item.largest, problem.shaping_unit(item)
            )
            largest = np.maximum(largest, found + problem.log_priors[item.effect])
    return Chance(float(np.quantile(largest, 1.0 - rate)), draws, seed)
