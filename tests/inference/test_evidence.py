"""Evidence and posterior against densities, matrix inverses and other libraries."""

from dataclasses import FrozenInstanceError
from fractions import Fraction

import numpy as np
import pytest
from scipy.integrate import quad
from sklearn.linear_model import Ridge

from pouring_robot.inference.evidence import (
    ConditionalGram,
    Gram,
    Scale,
    bayes_factor,
    eigen,
    evidence_bound,
    largest_scale,
    shaping_unit,
)
from pouring_robot.inference.priors import LOG_SCALES, SHAPINGS
from tests.inference.problems import beside, log_density
from tests.support import round_off

SCALES = np.exp(LOG_SCALES)


def ratio(residual, columns, others, scale):
    return log_density(residual, *others, scale * columns) - log_density(residual, *others)


def factor(columns, residual, groups=()):
    """Return the log Bayes factor of a group of columns given others with unit coefficients."""
    seen, places = beside(groups, columns, residual)
    return bayes_factor(seen.inner(places, places), seen.projected[places])


@pytest.mark.parametrize("unit", [1.0, 7.0])
def test_a_group_has_no_more_evidence_than_its_bound(rng, unit):
    main = np.array([True, False, False])
    for size in (0.1, 1.0, 30.0):
        columns = rng.normal(size=(12, 3))
        gram = Gram.of([columns], size * columns @ rng.normal(size=3) + rng.normal(size=12))
        for kept in (main, None):
            found = bayes_factor(gram.columns, gram.projected, kept, unit)
            most = evidence_bound(gram.columns, gram.projected, kept, unit)
            assert found.evidence <= found.peak <= most
    assert most == pytest.approx(found.peak, rel=0.2), "of a strong group the bound is near"


def test_conditional_inner_products_are_those_of_the_inverse(rng):
    groups = [rng.normal(size=(9, 2)), 3.0 * rng.normal(size=(9, 4))]
    columns, residual = rng.normal(size=(9, 3)), rng.normal(size=9)
    covariance = np.eye(9) + sum(g @ g.T for g in groups)
    inverse = np.linalg.inv(covariance)
    seen, places = beside(groups, columns, residual)
    inner, projected = seen.inner(places, places), seen.projected[places]
    np.testing.assert_allclose(inner, columns.T @ inverse @ columns, atol=1e-12)
    np.testing.assert_allclose(projected, columns.T @ inverse @ residual, atol=1e-12)
    assert seen.squared == pytest.approx(residual @ inverse @ residual, rel=1e-12)
    assert seen.log_determinant == pytest.approx(np.linalg.slogdet(covariance)[1], rel=1e-12)
    stacked = np.hstack(groups)
    outside = seen.conditioned(stacked.T @ columns, columns.T @ columns, columns.T @ residual)
    np.testing.assert_allclose(outside[0], inner, atol=1e-12)
    np.testing.assert_allclose(outside[1], projected, atol=1e-12)


def test_conditioning_in_two_steps_equals_conditioning_at_once(rng):
    """A Schur complement of a Schur complement; weights scale the columns."""
    stacked, residual = rng.normal(size=(30, 9)), rng.normal(size=30)
    gram, weights = Gram.of([stacked], residual), rng.uniform(0.1, 3.0, 6)
    first = ConditionalGram(gram, np.arange(4), weights[:4])
    both, after = ConditionalGram(gram, np.arange(6), weights), ConditionalGram(first, np.arange(4, 6), weights[4:])
    rest = np.arange(6, 9)
    np.testing.assert_allclose(both.inner(rest, rest), after.inner(rest, rest), atol=1e-12)
    np.testing.assert_allclose(both.projected[rest], after.projected[rest], atol=1e-12)
    assert both.log_likelihood == pytest.approx(after.log_likelihood, rel=1e-12)


@pytest.mark.parametrize("own", [slice(0, 2), slice(2, 5), slice(5, 6)])
def test_means_without_some_coefficients_follow_from_all_together(rng, own):
    """The covariance of coefficients is at most one, so the blocks of its inverse lose few digits."""
    columns, residual = rng.normal(size=(30, 6)), rng.normal(size=30)
    gram, weights = Gram.of([columns], residual), rng.uniform(0.5, 2.0, 6)
    everything, rest = ConditionalGram(gram, np.arange(6), weights), np.delete(np.arange(6), own)
    others = ConditionalGram(gram, rest, weights[rest])
    means = everything.means_without(own)
    np.testing.assert_allclose(means[rest], others.coefficients()[0], rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(means[own], 0.0, atol=1e-12)


def test_without_groups_the_inner_products_are_unchanged(rng):
    values, residual = rng.normal(size=(7, 2)), rng.normal(size=7)
    seen, places = beside([], values, residual)
    np.testing.assert_array_equal(seen.inner(places, places), values.T @ values)
    assert seen.log_determinant == 0.0


def test_large_and_nearly_parallel_columns():
    """Against exact rational arithmetic: only the round-off of the inner products themselves is lost."""
    columns = np.array([[2.0**16, 2.0**16], [2.0**15, 2.0**15 + 1.0], [0.0, 2.0**-3]])
    values = np.array([1.0, -2.0, 0.5])
    exact = [[Fraction(v) for v in row] for row in columns.tolist()]
    covariance = [
        [sum(a * b for a, b in zip(p, q, strict=True)) + (i == j) for j, q in enumerate(exact)]
        for i, p in enumerate(exact)
    ]
    solution = _solved(covariance, [Fraction(v) for v in values.tolist()])
    expected = float(sum(Fraction(v) * s for v, s in zip(values.tolist(), solution, strict=True)))
    seen, _ = beside([columns], np.zeros((3, 0)), values)
    # The residual projected on the columns is as long as these; its square is subtracted.
    lost = round_off(np.linalg.norm(columns) ** 2, terms=columns.size)
    assert lost < 1e-3
    assert seen.squared == pytest.approx(expected, abs=lost)


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
    found = factor(columns, residual, groups)
    assert found.peak == pytest.approx(values.max(), abs=1e-10)
    assert found.scale.main == pytest.approx(SCALES[values.argmax()])
    assert found.evidence == pytest.approx(np.log(np.exp(values).mean()), abs=1e-10)


@pytest.mark.parametrize("size", [0.0, 1.0, 4.0])
def test_the_grid_of_scales_is_fine_enough(rng, size):
    """The average over the grid equals the integral over the logarithm of the scale, by adaptive quadrature."""
    columns = rng.normal(size=(12, 2))
    residual = rng.normal(size=12) + size * columns @ np.array([1.0, -0.5])
    low, high = LOG_SCALES[0], LOG_SCALES[-1]
    integral, _ = quad(lambda s: np.exp(ratio(residual, columns, [], np.exp(s))), low, high, limit=200)
    found = factor(columns, residual)
    assert found.evidence == pytest.approx(np.log(integral / (high - low)), abs=0.1)


def test_evidence_is_invariant_under_rotation_of_columns(rng):
    """Orthogonal mixing of a group leaves its prior unchanged, hence its evidence."""
    columns, residual = rng.normal(size=(20, 4)), rng.normal(size=20)
    turn, _ = np.linalg.qr(rng.normal(size=(4, 4)))
    others = [rng.normal(size=(20, 3))]
    one, other = factor(columns, residual, others), factor(columns @ turn, residual, others)
    assert one.evidence == pytest.approx(other.evidence, abs=1e-10)


def test_repeated_and_empty_columns_are_one_column(rng):
    """The same column twice is one column √2 as large; a zero column adds nothing."""
    column, residual, others = rng.normal(size=(15, 1)), rng.normal(size=15), ()
    twice = np.hstack([column, column, np.zeros((15, 1))])
    expected = factor(np.sqrt(2.0) * column, residual, others)
    assert factor(twice, residual, others).evidence == pytest.approx(expected.evidence, abs=1e-10)


def test_nearly_repeated_columns_are_steady(rng):
    column, residual, others = rng.normal(size=(15, 1)), rng.normal(size=15), ()
    nearly = np.hstack([column, column * (1.0 + 1e-9)])
    expected = factor(np.sqrt(2.0) * column, residual, others)
    assert factor(nearly, residual, others).evidence == pytest.approx(expected.evidence, abs=1e-6)


def test_a_group_without_columns_has_no_evidence(rng):
    found = factor(np.zeros((15, 2)), rng.normal(size=15))
    assert found.evidence == 0.0
    assert found.peak == 0.0


def test_what_other_columns_explain_adds_no_evidence(rng):
    column = rng.normal(size=(30, 1))
    residual = 50.0 * column[:, 0] + rng.normal(size=30)
    assert factor(column, residual).evidence > 100.0
    assert factor(column, residual, [100.0 * column]).evidence < 1.0


def test_columns_that_noise_does_not_need_lose_evidence(rng):
    """On noise alone a group of many columns has negative evidence on average over many draws."""
    columns, others = rng.normal(size=(60, 10)), ()
    worth = [factor(columns, rng.normal(size=60), others).evidence for _ in range(100)]
    assert np.mean(worth) < 0.0
    # The evidence is a ratio of normalised densities: under noise its exponential averages to 1 (Markov's inequality).
    assert np.mean(np.array(worth) > np.log(20.0)) <= 1.0 / 20.0 + 0.05


def posterior(columns, residual):
    return beside([columns], columns[:, :0], residual)[0].coefficients()


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


def test_shaping_has_a_scale_of_its_own(rng):
    """The evidence is the average of densities over both scales; its peak is where the shape is as large as planted."""
    columns = rng.normal(size=(40, 3))
    main = np.array([True, False, False])
    residual = 4.0 * columns[:, 0] + 1.5 * columns[:, 1] + rng.normal(size=40)
    unit = shaping_unit(columns.T @ columns, main)
    assert unit**2 * (columns[:, 1:] ** 2).sum() == pytest.approx((columns[:, :1] ** 2).sum())
    values = np.array(
        [
            [ratio(residual, columns * Scale(s, unit * shaping).weights(main), [], 1.0) for s in SCALES]
            for shaping in SHAPINGS
        ]
    )
    found = bayes_factor(columns.T @ columns, columns.T @ residual, main, unit=unit)
    assert found.evidence == pytest.approx(np.log(np.exp(values).mean()), abs=1e-9)
    assert found.peak == pytest.approx(values.max(), abs=1e-9)
    shape, scale = np.unravel_index(values.argmax(), values.shape)
    assert found.scale == pytest.approx((SCALES[scale], unit * SHAPINGS[shape]))


@pytest.mark.parametrize("probability", [0.5, 0.975])
def test_the_largest_scale_is_a_quantile_of_the_scales_density(rng, probability):
    """Of the grid: the first scale below which the posterior given the data holds at least the probability."""
    columns, residual = rng.normal(size=(12, 2)), rng.normal(size=12)
    found = largest_scale(columns.T @ columns, columns.T @ residual, probability)
    density = np.exp([ratio(residual, columns, [], scale) for scale in SCALES])
    below = density.cumsum() / density.sum()
    expected = SCALES[below >= probability][0]
    assert found == pytest.approx(expected, rel=1e-12)
    if probability == 0.975:
        assert largest_scale(columns.T @ columns, columns.T @ residual) == found


def test_for_a_strong_group_no_scale_is_too_large(rng):
    column = rng.normal(size=(12, 1))
    assert largest_scale(column.T @ column, 1e3 * column.T @ column[:, 0]) == pytest.approx(SCALES[-1])
    assert largest_scale(1e4 * column.T @ column, np.zeros(1)) < 0.5


@pytest.mark.parametrize("size", [3, 100, 101, 160])
def test_eigenvectors_of_small_and_of_large_matrices(rng, size):
    stack = rng.normal(size=(2, size, size))
    matrices = stack + stack.swapaxes(1, 2)
    for one, values, axes in zip(matrices, *eigen(matrices), strict=True):
        assert (np.diff(values) >= 0.0).all()
        lost = round_off(scale=np.linalg.norm(one), terms=size**2)
        np.testing.assert_allclose(axes * values @ axes.T, one, rtol=0, atol=lost)
        np.testing.assert_allclose(values, eigen(one)[0], rtol=0, atol=lost)


def test_no_column_has_zero_evidence():
    found = bayes_factor(np.zeros((0, 0)), np.zeros(0))
    assert (found.evidence, found.scale, found.peak) == (0.0, (1.0, 1.0), 0.0)


def test_the_grids_of_scales_have_the_stated_ends():
    """From a hundredth to ten times the usual size; shaping from three hundredths of the prediction to all of it."""
    assert SCALES[[0, -1]] == pytest.approx([0.01, 10.0])
    np.testing.assert_allclose(np.diff(LOG_SCALES), np.log(1000.0) / 27, rtol=1e-9)
    assert SHAPINGS[[0, -1]] == pytest.approx([0.03, 1.0])


def test_absent_shaping_needs_no_unit(rng):
    columns = rng.normal(size=(5, 2))
    assert shaping_unit(columns.T @ columns, np.array([True, True])) == 1.0


def test_shaping_that_is_only_rounding_needs_no_unit(rng):
    """Its unit would scale the rounding up to the size of the effect, and that explains anything by chance."""
    columns = rng.normal(size=(5, 3))
    columns[:, 1:] *= 1e-13
    assert shaping_unit(columns.T @ columns, np.array([True, False, False])) == 1.0


@pytest.mark.parametrize("seed", range(5))
def test_the_evidence_of_columns_equal_up_to_rounding_is_finite(seed):
    """Of five equal columns far above the noise four directions are rounding, of either sign: that is no variance."""
    rng = np.random.default_rng(seed)
    columns, residual = 1e9 * rng.normal(size=(40, 1)) * rng.uniform(0.5, 2.0, 5), rng.normal(size=40)
    with np.errstate(invalid="raise"):
        assert np.isfinite(bayes_factor(columns.T @ columns, columns.T @ residual).evidence)


def test_results_are_immutable():
    found = bayes_factor(np.eye(1), np.ones(1))
    for thing, name in ((found, "evidence"), (Gram(np.eye(1), np.ones(1), 1.0), "squared")):
        with pytest.raises(FrozenInstanceError):
            setattr(thing, name, 0.0)


@pytest.mark.parametrize("size", [1e3, 1e-3])
@pytest.mark.parametrize("others", [1, 150])
def test_a_column_reduced_to_round_off_explains_nothing(rng, size, others):
    """Given others that explain all of it, it has no evidence, whatever the residual shares with its round-off."""
    columns, residual = size * rng.normal(size=(400, others)), 1e3 * rng.normal(size=400)
    double = np.hstack([columns, columns[:, :1]])
    beside = ConditionalGram(Gram.of([double], residual), np.arange(others), np.full(others, 1e9 / size))
    last = np.array([others])
    left = bayes_factor(beside.inner(last, last), beside.projected[last])
    assert left.evidence == pytest.approx(0.0, abs=1e-3)
    # The same column twice is one, larger by √2; the remaining axis is round-off.
    inner, projected = double.T @ double, double.T @ residual
    once = np.hstack([np.sqrt(2.0) * columns[:, :1], columns[:, 1:]])
    expected = bayes_factor(once.T @ once, once.T @ residual).evidence
    assert bayes_factor(inner, projected).evidence == pytest.approx(expected, abs=1e-3)


@pytest.mark.parametrize(("place", "scale"), [(0, 10.0), (1, 20.0)])
def test_the_evidence_bound_is_what_the_widest_scales_explain(place, scale):
    """One column of squared length d, projection p and deviation w: p² w² / (1 + w² d) / 2; shaping in units of two."""
    inner, projected = np.zeros((2, 2)), np.zeros(2)
    inner[place, place], projected[place] = 0.01, 3.0
    found = evidence_bound(inner, projected, np.array([True, False]), unit=2.0)
    assert found == pytest.approx(0.5 * 9.0 * scale**2 / (1.0 + 0.01 * scale**2), rel=1e-12)


def test_two_nearly_equal_columns_do_not_explain_by_their_difference(rng):
    """Their difference is a third column, ten million times smaller: its coefficient must be larger by that factor."""
    one, other = rng.normal(size=(2, 40))
    columns = np.column_stack([one, one + 1e-7 * other])
    found = 2.0 * evidence_bound(columns.T @ columns, columns.T @ other)
    assert found == pytest.approx((one @ other) ** 2 / (one @ one), rel=1e-3)
    assert found < 0.5 * other @ other


def test_a_matrix_that_cannot_hold_inner_products_is_refused():
    with pytest.raises(np.linalg.LinAlgError, match="no inner products"):
        ConditionalGram(Gram(np.array([[-2.0]]), np.zeros(1), 1.0), np.arange(1), np.ones(1))
