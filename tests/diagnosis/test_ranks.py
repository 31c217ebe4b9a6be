"""Rank statistics against scipy.stats, which the package does not import for them."""

import numpy as np
import pytest
import scipy.stats

from pouring_robot.diagnosis.where.ranks import larger, rank_correlation, ranks


@pytest.mark.parametrize("tied", [False, True])
def test_they_are_those_of_scipy(rng, tied):
    """The same formulas, so that only rounding is left."""
    first, second = rng.normal(size=40), rng.normal(size=60) - 0.3
    if tied:
        first, second = np.round(first), np.round(second)
    np.testing.assert_array_equal(ranks(second), scipy.stats.rankdata(second))
    wanted = scipy.stats.mannwhitneyu(first, second, alternative="greater", method="asymptotic").pvalue
    assert larger(first, second) == pytest.approx(wanted, rel=1e-12)
    assert rank_correlation(first, second[:40]) == pytest.approx(
        scipy.stats.spearmanr(first, second[:40]).statistic, rel=1e-12
    )


def test_few_values_are_judged_too_carefully(rng):
    """Six values all above sixty: one in 90,858,768 by chance, which the normal distribution makes more of."""
    exact = scipy.stats.mannwhitneyu(np.arange(60, 66), np.arange(60), alternative="greater", method="exact").pvalue
    assert exact < larger(np.arange(60.0, 66.0), np.arange(60.0)) < 1e-4


def test_equal_values_tell_nothing():
    assert larger(np.ones(6), np.ones(9)) == 1.0
