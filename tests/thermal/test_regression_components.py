"""VIF and principal-component regression against statsmodels, scikit-learn and numpy, to 1e-10."""

import numpy as np
import pytest
import statsmodels.api as sm
from sklearn.decomposition import PCA
from sklearn.linear_model import LinearRegression
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.utils.estimator_checks import check_estimator
from statsmodels.multivariate import pca as statsmodels_pca
from statsmodels.stats.outliers_influence import variance_inflation_factor

from pouring_robot.thermal.regression.joint_model import PrincipalComponentRegression
from pouring_robot.thermal.regression.sensitive_sets import variance_inflation_factors
from pouring_robot.thermal.regression.table import ErrorSetError


def collinear(seed, sets=4, rows=12, noise=0.2):
    """Return collinear sets of unlike size and the temperature they follow."""
    random = np.random.default_rng(seed)
    y = np.linspace(873.15, 1973.15, rows)
    trend = (y - 873.15)[:, None] / 1100.0
    X = random.uniform(1, 3, sets) * trend + noise * random.normal(size=(rows, sets))
    return X * 10.0 ** random.integers(-3, 3, sets) + random.normal(size=sets), y


@pytest.mark.parametrize("seed", range(5))
def test_vif_three_ways(seed):
    X, _ = collinear(seed)
    found = variance_inflation_factors(X)
    closed_form = np.diag(np.linalg.inv(np.corrcoef(X.T)))
    others = [np.delete(X, i, axis=1) for i in range(X.shape[1])]
    by_sklearn = [
        1.0 / (1.0 - LinearRegression().fit(rest, X[:, i]).score(rest, X[:, i])) for i, rest in enumerate(others)
    ]
    by_statsmodels = [
        1.0 / (1.0 - sm.OLS(X[:, i], sm.add_constant(rest)).fit().rsquared) for i, rest in enumerate(others)
    ]
    ready_made = [variance_inflation_factor(sm.add_constant(X), i) for i in range(1, 5)]
    for expected in (closed_form, by_sklearn, by_statsmodels, ready_made):
        np.testing.assert_allclose(found, expected, rtol=1e-10)


def test_vif_of_two_sets():
    X, _ = collinear(3)
    r = np.corrcoef(X[:, :2].T)[0, 1]
    np.testing.assert_allclose(variance_inflation_factors(X[:, :2]), 1.0 / (1.0 - r**2), rtol=1e-10)
    # By hand: r² = 3/4 between 1, 2, 3 and 1, 1, 2.
    np.testing.assert_allclose(variance_inflation_factors([[1, 1], [2, 1], [3, 2]]), 4.0, rtol=1e-12)


def test_vif_at_its_ends():
    X, _ = collinear(0)
    assert variance_inflation_factors(X[:, :1]).tolist() == [1.0]
    assert np.isinf(variance_inflation_factors(np.column_stack([X[:, 0], 2.0 * X[:, 0] + 1.0]))).all()
    assert np.isinf(variance_inflation_factors(X[:4])).all()
    with pytest.raises(ErrorSetError, match="error set 1 is constant"):
        variance_inflation_factors(np.column_stack([X[:, 0], np.ones(12)]))


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("explained", [0.5, 0.85, 0.99, 1.0])
def test_regression_against_pipeline_and_statsmodels(seed, explained):
    X, y = collinear(seed)
    model = PrincipalComponentRegression(explained).fit(X, y)
    kept = model.n_components_
    eigenvalues, eigenvectors = np.linalg.eigh(np.corrcoef(X.T))
    shares = np.cumsum(eigenvalues[::-1]) / 4
    assert kept == (4 if explained == 1.0 else 1 + int((shares < explained).sum()))
    np.testing.assert_allclose(model.eigenvalues_, eigenvalues[::-1], atol=1e-12)
    np.testing.assert_allclose(model.cumulative_, shares, atol=1e-12)
    pipeline = make_pipeline(StandardScaler(), PCA(kept), LinearRegression()).fit(X, y)
    np.testing.assert_allclose(model.predict(X), pipeline.predict(X), rtol=1e-10)
    factors = statsmodels_pca.PCA(X, ncomp=kept, standardize=True, normalize=False).factors
    ols = sm.OLS(y, sm.add_constant(factors)).fit()
    np.testing.assert_allclose(model.predict(X), ols.fittedvalues, rtol=1e-10)
    # Equations 16 and 17, one by one.
    u = eigenvectors[:, ::-1][:, :kept]
    z = (X - X.mean(0)) / X.std(0, ddof=1) @ u
    y_star = (y - y.mean()) / y.std(ddof=1)
    beta = u @ np.linalg.lstsq(z, y_star, rcond=None)[0]
    b = y.std(ddof=1) / X.std(0, ddof=1) * beta
    np.testing.assert_allclose(model.standardised_coef_, beta, atol=1e-12)
    np.testing.assert_allclose(model.coef_, b, rtol=1e-10)
    np.testing.assert_allclose(model.intercept_, y.mean() - b @ X.mean(0), rtol=1e-10)


def test_all_components_are_ordinary_least_squares():
    X, y = collinear(7)
    model, plain = PrincipalComponentRegression(1.0).fit(X, y), LinearRegression().fit(X, y)
    np.testing.assert_allclose(model.coef_, plain.coef_, rtol=1e-9)


def test_two_sets_by_hand():
    # r = 1/2 between the sets, so λ = 3/2 and 1/2 and the first carries exactly 75 %: enough for 0.75, not for 0.85.
    X = np.array([[1.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
    y = [4.0, 1.0, 1.0]
    model = PrincipalComponentRegression(0.75).fit(X, y)
    np.testing.assert_allclose(model.eigenvalues_, [1.5, 0.5], rtol=1e-14)
    np.testing.assert_allclose(model.components_, [[0.5**0.5, 0.5**0.5]], rtol=1e-14)
    assert model.n_components_ == 1
    assert PrincipalComponentRegression().fit(X, y).n_components_ == 2
    # s = 1, so Z = (x1 + x2) / √2 = √2, -1/√2, -1/√2; with y = 4, 1, 1 the coefficient of Z is √2: y = 2 + x1 + x2.
    np.testing.assert_allclose([*model.coef_, model.intercept_], [1.0, 1.0, 2.0], rtol=1e-14)


def test_the_papers_share_gives_a_vif_below_ten():
    r = 2 * 0.9699 - 1.0
    x = np.array([1.0, -1.0, 0.0, 0.0])
    X = np.column_stack([x, r * x + (1 - r**2) ** 0.5 * np.array([0.0, 0.0, 1.0, -1.0])])
    assert PrincipalComponentRegression().fit(X, x).cumulative_[0] == pytest.approx(0.9699, abs=1e-12)
    assert variance_inflation_factors(X)[0] == pytest.approx(8.56, abs=0.01)


def test_scikit_learns_checks():
    check_estimator(PrincipalComponentRegression(), on_skip=None)


@pytest.mark.parametrize("explained", [0.0, 1.1])
def test_bad_share(explained):
    with pytest.raises(ErrorSetError, match="give a share"):
        PrincipalComponentRegression(explained).fit(*collinear(0))


def test_nothing_but_constants():
    with pytest.raises(ErrorSetError, match="every set is constant"):
        PrincipalComponentRegression().fit(np.ones((4, 2)), np.arange(4.0))
