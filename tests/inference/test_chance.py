"""Evidence by chance alone: against residuals drawn one by one from the covariance of the null hypothesis."""

import numpy as np
import pytest
from scipy.stats import binom

from pouring_robot.inference.evidence import bayes_factor, evidences
from pouring_robot.inference.hypotheses import Hypothesis
from pouring_robot.inference.priors import WORKMANSHIP_LEVELS
from pouring_robot.inference.problem import Workmanship
from pouring_robot.inference.thresholds import Thresholds, chance_level
from tests.inference.problems import ROWS, explanation, library, problem


@pytest.fixture
def null(rng):
    """Return a null hypothesis with workmanship at work and a free constant."""
    usual = Workmanship("usual", 40.0 * rng.normal(size=(ROWS, 3)))
    built = problem(rng.normal(size=ROWS), library(rng, count=4), [usual], np.ones((ROWS, 1)))
    return Hypothesis(built, (), (), (3,))


def test_evidences_of_many_residuals_at_once_equal_those_of_each(rng):
    columns = explanation("a", rng.normal(size=(ROWS, 4))).columns
    main = np.array([True, True, False, False])
    inner, projected = columns.T @ columns, columns.T @ rng.normal(size=(ROWS, 5))
    together = evidences(inner, projected, main, 0.5)
    single = [bayes_factor(inner, projected[:, k], main, 0.5).evidence for k in range(5)]
    np.testing.assert_allclose(together, single, rtol=1e-10, atol=1e-12)


def test_the_rate_is_that_of_residuals_drawn_from_the_null(null, rng):
    """Dense covariance, best single cause of each residual: the share above the threshold is the rate within chance."""
    rate, draws = 0.1, 400
    threshold = chance_level(null, rate, 4000)
    background = WORKMANSHIP_LEVELS[3] * null.problem.workmanship[0].columns
    inverse = np.linalg.inv(np.eye(ROWS) + background @ background.T)
    beyond = 0
    for _ in range(draws):
        residual = null.problem.nuisance.cleared(rng.normal(size=ROWS)) + background @ rng.normal(size=3)
        worths = [
            bayes_factor(e.columns.T @ inverse @ e.columns, e.columns.T @ inverse @ residual, e.main).evidence
            + null.problem.log_priors[e.effect]
            for e in null.problem.explanations
        ]
        beyond += max(0.0, *worths) > threshold
    low, high = binom.ppf([0.0005, 0.9995], draws, rate)
    assert low <= beyond <= high


def test_a_rate_too_small_for_few_draws_is_kept_all_the_same(null):
    """Of 200,000 draws no more than that rate exceed the level, although it was found from a thousand draws."""
    often, seldom = chance_level(null, 0.01, 1000), chance_level(null, 1e-4, 1000)
    assert seldom == pytest.approx(often + np.log(100.0), rel=1e-12)
    many = [chance_level(null, rate, 200_000) for rate in (0.01, 1e-4)]
    assert seldom - often >= many[1] - many[0]
    assert seldom - often < many[1] - many[0] + 2.0


def test_columns_far_longer_than_others_do_not_change_the_chance_level(rng):
    """Heavy arms yield a billion times their noise: the rounding of such columns must not affect the other effects."""
    effects, longest = library(rng, count=4), 1e9 * rng.normal(size=(ROWS, 3))
    long = explanation("long", longest @ rng.normal(size=(3, 8)))  # of these eight columns five are linear combinations
    without, beside = (
        chance_level(Hypothesis.nothing(problem(rng.normal(size=ROWS), items)), 0.01)
        for items in (effects, [*effects, long])
    )
    # One effect more, with less room for chance than any other: its scales end far above what such columns need.
    assert abs(beside - without) < 1.0


@pytest.mark.parametrize("seed", range(6))
def test_columns_that_workmanship_absorbs_whole_do_not_change_the_chance_level(seed):
    """What remains of them is rounding: neither a negative square nor its sign means anything."""
    rng = np.random.default_rng(seed)
    usual = Workmanship("usual", 1e9 * rng.normal(size=(ROWS, 3)))
    same = explanation("same", usual.columns @ rng.normal(size=(3, 4)))
    built = problem(rng.normal(size=ROWS), [*library(rng, count=4), same], [usual])
    assert 0.0 < chance_level(Hypothesis(built, (), (), (3,)), 0.01) < 5.0


def test_the_larger_threshold_counts():
    assert Thresholds(false_names=0.01, by_chance=2.0).least_evidence == pytest.approx(np.log(100.0))
    assert Thresholds(false_names=0.01, by_chance=7.0).least_evidence == 7.0
