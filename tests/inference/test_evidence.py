"""Evidence and posterior against densities, matrix inverses and other libraries."""

from fractions import Fraction

import numpy as np
import pytest
from scipy.integrate import quad
from sklearn.linear_model import Ridge

from pouring_robot.inference.evidence import LOG_SCALES, Others, bayes_factor, posterior
from tests.inference.problems import log_density
from tests.support import round_off

SCALES = np.exp(LOG_SCALES)


def ratio(residual, columns, others, scale):
    return log_density(residual, *others, scale * columns) - log_density(residual, *others)


def test_inner_products_are_those_of_the_inverse(rng):
    groups = [rng.normal(size=(9, 2)), 3.0 * rng.normal(size=(9, 4))]
    stacked = np.hstack(groups)
    inverse = np.linalg.inv(np.eye(9) + stacked @ stacked.T)
    left, right, vector = rng.normal(size=(9, 3)), rng.normal(size=(9, 2)), rng.normal(size=9)
    others = Others(groups, 9)
    np.testing.assert_allclose(others.inner(left, right), left.T @ inverse @ right, atol=1e-13)
    np.testing.assert_allclose(others.inner(vector, vector), vector @ inverse @ vector, rtol=1e-13)
    np.testing.assert_allclose(others.solve(left), inverse @ left, atol=1e-13)
    expected = np.linalg.slogdet(np.eye(9) + stacked @ stacked.T)[1]
    assert others.log_determinant == pytest.approx(expected, rel=1e-13)


def test_without_groups_nothing_is_weighed(rng):
    values = rng.normal(size=(7, 2))
    others = Others([], 7)
    np.testing.assert_array_equal(others.inner(values, values), values.T @ values)
    np.testing.assert_array_equal(others.solve(values), values)
    assert others.log_determinant == 0.0


def test_large_and_nearly_parallel_columns_lose_no_digits():
    """Against exact rational arithmetic, where the covariance has a condition number of 1e16: half the digits stay."""
    columns = np.array([[2.0**26, 2.0**26], [2.0**25, 2.0**25 + 1.0], [0.0, 2.0**-3]])
    values = np.array([1.0, -2.0, 0.5])
    exact = [[Fraction(v) for v in row] for row in columns.tolist()]
    covariance = [
        [sum(a * b for a, b in zip(p, q, strict=True)) + (i == j) for j, q in enumerate(exact)]
        for i, p in enumerate(exact)
    ]
    solution = _solved(covariance, [Fraction(v) for v in values.tolist()])
    others = Others([columns], 3)
    # What is decomposed is the columns on a unit matrix; its condition number is the root of the covariance's.
    stacked = np.vstack([columns, np.eye(2)])
    lost = round_off(np.linalg.cond(stacked), terms=stacked.size)
    assert lost < 1e-6
    size = np.linalg.norm(values)
    np.testing.assert_allclose(others.solve(values), [float(v) for v in solution], rtol=0, atol=lost * size)
    expected = float(sum(Fraction(v) * s for v, s in zip(values.tolist(), solution, strict=True)))
    assert float(others.inner(values, values)) == pytest.approx(expected, abs=lost * size**2)


def _solved(matrix, right):
    rows = [[*row, value] for row, value in zip(matrix, right, strict=True)]
    for k in range(len(rows)):
        rows[k] = [v / rows[k][k] for v in rows[k]]
        for j in range(len(rows)):
            if j != k:
                rows[j] = [a - rows[j][k] * b for a, b in zip(rows[j], rows[k], strict=True)]
    return [row[-1] for row in rows]


def test_gain_is_the_ratio_of_densities_averaged_over_scales(rng):
    columns, residual = rng.normal(size=(8, 3)), 2.0 * rng.normal(size=8)
    groups = [rng.normal(size=(8, 2))]
    values = np.array([ratio(residual, columns, groups, scale) for scale in SCALES])
    found = bayes_factor(columns, residual, Others(groups, 8))
    assert found.peak == pytest.approx(values.max(), abs=1e-10)
    assert found.scale == pytest.approx(SCALES[values.argmax()])
    assert found.evidence == pytest.approx(np.log(np.exp(values).mean()), abs=1e-10)


@pytest.mark.parametrize("size", [0.0, 1.0, 4.0])
def test_scales_are_as_fine_as_they_need_be(rng, size):
    """The average over the grid is the integral over the logarithm of the scale, by adaptive quadrature."""
    columns = rng.normal(size=(12, 2))
    residual = rng.normal(size=12) + size * columns @ np.array([1.0, -0.5])
    low, high = LOG_SCALES[0], LOG_SCALES[-1]
    integral, _ = quad(lambda s: np.exp(ratio(residual, columns, [], np.exp(s))), low, high, limit=200)
    found = bayes_factor(columns, residual, Others([], 12))
    assert found.evidence == pytest.approx(np.log(integral / (high - low)), abs=0.1)


def test_evidence_does_not_see_how_columns_are_turned(rng):
    """Orthogonal mixing of a group leaves its prior alone, hence its evidence."""
    columns, residual = rng.normal(size=(20, 4)), rng.normal(size=20)
    turn, _ = np.linalg.qr(rng.normal(size=(4, 4)))
    others = Others([rng.normal(size=(20, 3))], 20)
    one, other = bayes_factor(columns, residual, others), bayes_factor(columns @ turn, residual, others)
    assert one.evidence == pytest.approx(other.evidence, abs=1e-10)


def test_repeated_and_empty_columns_are_one_column(rng):
    """Twice the same column is one column √2 as large; a column of nothing adds nothing."""
    column, residual, others = rng.normal(size=(15, 1)), rng.normal(size=15), Others([], 15)
    twice = np.hstack([column, column, np.zeros((15, 1))])
    expected = bayes_factor(np.sqrt(2.0) * column, residual, others)
    assert bayes_factor(twice, residual, others).evidence == pytest.approx(expected.evidence, abs=1e-10)


def test_nearly_repeated_columns_are_steady(rng):
    column, residual, others = rng.normal(size=(15, 1)), rng.normal(size=15), Others([], 15)
    nearly = np.hstack([column, column * (1.0 + 1e-9)])
    expected = bayes_factor(np.sqrt(2.0) * column, residual, others)
    assert bayes_factor(nearly, residual, others).evidence == pytest.approx(expected.evidence, abs=1e-6)


def test_nothing_is_worth_nothing(rng):
    found = bayes_factor(np.zeros((15, 2)), rng.normal(size=15), Others([], 15))
    assert found.evidence == 0.0
    assert found.peak == 0.0


def test_what_others_explain_is_worth_nothing_more(rng):
    column = rng.normal(size=(30, 1))
    residual = 50.0 * column[:, 0] + rng.normal(size=30)
    assert bayes_factor(column, residual, Others([], 30)).evidence > 100.0
    assert bayes_factor(column, residual, Others([100.0 * column], 30)).evidence < 1.0


def test_columns_that_noise_does_not_need_cost(rng):
    """On noise alone a group of many columns is worth less than nothing, on the average of many draws."""
    columns, others = rng.normal(size=(60, 10)), Others([], 60)
    worth = [bayes_factor(columns, rng.normal(size=60), others).evidence for _ in range(100)]
    assert np.mean(worth) < 0.0
    # The evidence is a ratio of normalised densities: under noise its exponential averages to 1 (Markov's inequality).
    assert np.mean(np.array(worth) > np.log(20.0)) <= 1.0 / 20.0 + 0.05


def test_posterior_is_ridge_regression(rng):
    columns, residual = rng.normal(size=(25, 5)) * np.array([1e-2, 0.1, 1.0, 10.0, 100.0]), rng.normal(size=25)
    mean, covariance = posterior(columns, residual)
    ridge = Ridge(alpha=1.0, fit_intercept=False, solver="svd").fit(columns, residual)
    np.testing.assert_allclose(mean, ridge.coef_, rtol=1e-9)
    np.testing.assert_allclose(covariance, np.linalg.inv(columns.T @ columns + np.eye(5)), rtol=1e-9, atol=1e-14)


def test_posterior_is_calibrated(rng):
    """Coefficients drawn from the prior lie within one posterior standard deviation as often as a normal one does."""
    columns = rng.normal(size=(25, 3))
    inside = []
    for _ in range(400):
        truth = rng.normal(size=3)
        mean, covariance = posterior(columns, columns @ truth + rng.normal(size=25))
        inside.extend(np.abs(mean - truth) < np.sqrt(np.diag(covariance)))
    assert np.mean(inside) == pytest.approx(0.683, abs=0.06)  # 4 standard deviations of the rate


def test_largest_scale_is_kept(rng):
    column = rng.normal(size=(30, 1))
    found = bayes_factor(column, 50.0 * column[:, 0], Others([], 30), 2.0)
    assert found.scale <= 2.0
    allowed = SCALES[SCALES <= 2.0]
    values = [ratio(50.0 * column[:, 0], column, [], scale) for scale in allowed]
    assert found.peak == pytest.approx(max(values), rel=1e-9)
