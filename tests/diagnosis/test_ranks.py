"""Rank statistics against scipy.stats, which the package does not import for them."""

import numpy as np
import pytest
import scipy.stats

from pouring_robot.diagnosis.where.ranks import larger, rank_correlation, ranks


@pytest.mark.parametrize("tied", [False, True])
def test_rank_statistics_are_those_of_scipy(rng, tied):
    """The formulas are the same, so only rounding differs."""
    first, second = rng.normal(size=40), rng.normal(size=60) - 0.3
    if tied:
        first, second = np.round(first), np.round(second)
    np.testing.assert_array_equal(ranks(second), scipy.stats.rankdata(second))
    wanted = scipy.stats.mannwhitneyu(first, second, alternative="greater", method="asymptotic").pvalue
    assert larger(first, second) == pytest.approx(wanted, rel=1e-12)
    assert rank_correlation(first, second[:40]) == pytest.approx(
        scipy.stats.spearmanr(first, second[:40]).statistic, rel=1e-12
    )


def test_p_values_of_few_values_are_conservative(rng):
    """Six values all above sixty: a chance of one in 90,858,768, for which the normal distribution gives more."""
    exact = scipy.stats.mannwhitneyu(np.arange(60, 66), np.arange(60), alternative="greater", method="exact").pvalue
    assert exact < larger(np.arange(60.0, 66.0), np.arange(60.0)) < 1e-4


def test_equal_values_give_no_evidence():
    assert larger(np.ones(6), np.ones(9)) == 1.0
