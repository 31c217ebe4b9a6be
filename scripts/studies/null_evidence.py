"""Evidence by chance: quantiles of the largest log evidence of any effect at the fitted null of campaigns.

    python -m scripts.studies.null_evidence ../campaigns/case_000/campaign.csv examples/campaign.csv --draws 1000

Residuals are drawn from what a campaign's fitted null says: noise and usual errors at their most probable level. Every
form of every effect is weighed against each draw, beside the usual errors. An effect must be worth one over the
accepted rate of false names (:class:`~pouring_robot.inference.search.SearchOptions`).
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pouring_robot.diagnosis.diagnose import diagnose
from pouring_robot.inference.evidence import Beside, Gram, bayes_factor
from pouring_robot.inference.hypotheses import Hypothesis
from pouring_robot.inference.search import DEFAULT_SEARCH
from pouring_robot.mechanism.arrays import FloatArray

_QUANTILES = (0.5, 0.9, 0.99)


def largest_by_chance(null: Hypothesis, draws: int, seed: int) -> FloatArray:
    """Return the largest log evidence of any effect in each draw, its form's share of the prior counted, (draws,)."""
    problem, random = null.problem, np.random.default_rng(seed)
    residuals = problem.nuisance.cleared(random.normal(size=(len(problem.residual), draws)))
    for columns in null.groups():
        residuals = residuals + columns @ random.normal(size=(columns.shape[1], draws))
    causes = [item for item in problem.explanations if item.cause]
    found = np.empty(draws)
    for k, residual in enumerate(residuals.T):
        gram = Gram(problem.gram.columns, problem.columns.T @ residual, float(residual @ residual))
        beside = Beside.groups(gram, null.usual())
        found[k] = max(
            bayes_factor(*beside.of(problem.places(item)), item.main, item.largest, problem.shaping_unit(item)).evidence
            + problem.log_priors[item.effect]
            for item in causes
        )
    return found


def main(arguments: Sequence[str] | None = None) -> int:
    """Print a line a campaign."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("campaigns", type=Path, nargs="+")
    parser.add_argument("--draws", type=int, default=400)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(arguments)
    least = DEFAULT_SEARCH.least_evidence
    sys.stdout.write(
        f"an effect must be worth {least:.2f} nats; by chance (seed {options.seed}, {options.draws} draws):\n"
    )
    for path in options.campaigns:
        null = Hypothesis.nothing(diagnose(path).before.problem)
        found = largest_by_chance(null, options.draws, options.seed)
        quantiles = ", ".join(
            f"{100 * q:g} %: {value:5.2f}" for q, value in zip(_QUANTILES, np.quantile(found, _QUANTILES), strict=True)
        )
        sys.stdout.write(f"{path}: {quantiles}; beyond it {np.mean(found > least):.4f}\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
