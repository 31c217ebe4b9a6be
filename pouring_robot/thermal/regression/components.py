r"""Variance inflation factors and principal-component regression on the correlation matrix.

The paper's 5.1.3 and 5.1.4, whose formulas were lost; written here from the text and the textbooks.

.. math:: \mathrm{VIF}_i = \frac{1}{1 - R_i^2}, \qquad R_i^2 \text{: coefficient of determination of } x_i
          \text{ regressed on the other sets}

Principal-component regression, with s the sample standard deviations (divisor n − 1), λ and u the eigenvalues and
eigenvectors of the correlation matrix R_P, k sets:

.. math::
   x^*_i = \frac{x_i - \bar x_i}{s_i}, \quad R_P u_j = \lambda_j u_j, \quad Z_j = \sum_i u_{ij} x^*_i, \quad
   m = \min \Big\{ m : \sum_{j \le m} \lambda_j / k \ge 0.85 \Big\}

   y^* = \sum_{j \le m} \gamma_j Z_j = \sum_i \beta_i x^*_i, \quad \beta_i = \sum_{j \le m} u_{ij} \gamma_j, \quad
   b_i = \frac{s_y}{s_i} \beta_i, \quad b_0 = \bar y - \sum_i b_i \bar x_i
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from sklearn.base import BaseEstimator, ClassNamePrefixFeaturesOutMixin, RegressorMixin, TransformerMixin
from sklearn.decomposition import PCA
from sklearn.linear_model import LinearRegression
from sklearn.utils.validation import check_is_fitted, validate_data

from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.thermal.regression.table import ErrorSetError, standardised

EXPLAINED_SHARE = 0.85
"""The paper's rule: as many components as carry 85 % of the variance."""

# A set whose unexplained share is no larger is told exactly: what is left is rounding.
_EXACT = 1e-14


def variance_inflation_factors(X: ArrayLike) -> FloatArray:
    """Return the VIF of every set against all others together, shape (k,), each 1 or more.

    From ordinary least squares of statsmodels, with a constant in every regression, as total over unexplained sum of
    squares: 1 − R² would lose its digits where sets are nearly the same. Infinite where the others tell a set exactly,
    which they always do with no more than k rows. A table of two sets gives the paper's VIF of a pair.

    Args:
        X: sets as columns, shape (n, k), in any units.

    Raises:
        ErrorSetError: a set is constant.
    """
    from statsmodels.regression.linear_model import OLS

    scaled = standardised("error set", X)
    if scaled.shape[1] == 1:
        return np.ones(1)
    unexplained = np.empty(scaled.shape[1])
    for i in range(scaled.shape[1]):
        others = np.column_stack([np.ones(len(scaled)), np.delete(scaled, i, axis=1)])
        fit = OLS(scaled[:, i], others).fit()
        unexplained[i] = fit.ssr / fit.centered_tss
    with np.errstate(divide="ignore"):
        return np.where(unexplained <= _EXACT, np.inf, np.maximum(1.0 / unexplained, 1.0))


def pairwise_inflation_factors(X: ArrayLike) -> FloatArray:
    """Return the VIF of every two sets, 1 / (1 − r²), shape (k, k), infinite on the diagonal.

    Raises:
        ErrorSetError: a set is constant.
    """
    scaled = standardised("error set", X)
    correlation = scaled.T @ scaled / (len(scaled) - 1)
    np.fill_diagonal(correlation, 1.0)
    unexplained = 1.0 - correlation**2
    with np.errstate(divide="ignore"):
        return np.where(unexplained <= _EXACT, np.inf, 1.0 / unexplained)


class CorrelationComponents(ClassNamePrefixFeaturesOutMixin, TransformerMixin, BaseEstimator):  # type: ignore[misc]
    """Principal components of the correlation matrix, as many as carry the wanted share of variance.

    Args:
        explained: the least cumulative share, in (0, 1].

    Attributes:
        eigenvalues_: all λ of the correlation matrix, falling, shape (min(n, k),); they add up to k.
        cumulative_: their cumulative shares.
        eigenvectors_: u of the components kept, as columns, shape (k, m); the largest entry of each is positive.
        n_components_: m.
        mean_, scale_: mean and sample standard deviation of each set, shape (k,).
    """

    def __init__(self, explained: float = EXPLAINED_SHARE) -> None:
        """Keep the share; fit checks it."""
        self.explained = explained

    def fit(self, X: ArrayLike, y: object = None) -> CorrelationComponents:
        """Find the components of X, shape (n, k) with n ≥ 2; y is not used. A constant column takes no part.

        Raises:
            ErrorSetError: all columns are constant, or the share is out of its range.
            ValueError: X is no table of finite numbers (scikit-learn's words).
        """
        sets = validate_data(self, X, dtype=np.float64, ensure_min_samples=2)
        if not 0.0 < self.explained <= 1.0:
            raise ErrorSetError(f"explained = {self.explained}: give a share above 0, up to 1 (usual: 0.85)")
        flat = np.ptp(sets, axis=0) <= 1e-12 * np.abs(sets).max(axis=0)
        if flat.all():
            raise ErrorSetError("every set is constant; there is no variance to find components of")
        self.mean_ = sets.mean(axis=0)
        self.scale_ = np.where(flat, 1.0, sets.std(axis=0, ddof=1))
        scaled = np.where(flat, 0.0, (sets - self.mean_) / self.scale_)
        components = PCA(svd_solver="full").fit(scaled)
        self.eigenvalues_ = components.explained_variance_
        self.cumulative_ = np.cumsum(self.eigenvalues_) / self.eigenvalues_.sum()
        # The last share is 1 up to rounding; a wish for all of it must not run past the end.
        enough = self.cumulative_ >= self.explained - 1e-12
        self.n_components_ = int(np.argmax(enough)) + 1
        self.eigenvectors_ = components.components_[: self.n_components_].T
        return self

    def transform(self, X: ArrayLike) -> FloatArray:
        """Return the components Z of new rows of the same sets, shape (n, m), without unit."""
        check_is_fitted(self)
        sets = validate_data(self, X, dtype=np.float64, reset=False)
        result: FloatArray = (sets - self.mean_) / self.scale_ @ self.eigenvectors_
        return result

    @property
    def _n_features_out(self) -> int:
        """Number of columns that transform returns; scikit-learn names them."""
        return self.n_components_


class PrincipalComponentRegression(RegressorMixin, BaseEstimator):  # type: ignore[misc]
    """Linear regression on the principal components of the correlation matrix, told in the original units.

    In the paper y is the melt temperature and X the sensitive error sets: equations 19 to 21.

    Args:
        explained: least share of variance the components carry, in (0, 1].

    Attributes:
        components_: the fitted :class:`CorrelationComponents`.
        component_coef_: γ, shape (m,).
        standardised_coef_: β, shape (k,).
        coef_: b, shape (k,), in units of y per unit of the set.
        intercept_: b0, in units of y.
    """

    def __init__(self, explained: float = EXPLAINED_SHARE) -> None:
        """Keep the share; fit checks it."""
        self.explained = explained

    def fit(self, X: ArrayLike, y: ArrayLike) -> PrincipalComponentRegression:
        """Fit y, shape (n,), on the components of X, shape (n, k), n ≥ 2.

        Raises:
            ErrorSetError: all sets are constant, or the share is out of its range.
            ValueError: X or y are no finite numbers (scikit-learn's words).
        """
        sets, target = validate_data(self, X, y, dtype=np.float64, y_numeric=True, ensure_min_samples=2)
        self.components_ = CorrelationComponents(self.explained).fit(sets)
        gamma = LinearRegression().fit(self.components_.transform(sets), target).coef_
        spread = float(np.std(target, ddof=1))
        # s_y cancels between γ and b; a constant y has none, and then every coefficient is 0.
        self.component_coef_ = gamma / spread if spread > 0.0 else np.zeros_like(gamma)
        self.standardised_coef_ = self.components_.eigenvectors_ @ self.component_coef_
        self.coef_ = self.components_.eigenvectors_ @ gamma / self.components_.scale_
        self.intercept_ = float(target.mean() - self.components_.mean_ @ self.coef_)
        return self

    def predict(self, X: ArrayLike) -> FloatArray:
        """Return y of new rows, shape (n,)."""
        check_is_fitted(self)
        sets: Any = validate_data(self, X, dtype=np.float64, reset=False)
        result: FloatArray = sets @ self.coef_ + self.intercept_
        return result
