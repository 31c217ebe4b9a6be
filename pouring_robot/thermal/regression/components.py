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

import warnings
from typing import Self

import numpy as np
from numpy.typing import ArrayLike
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.decomposition import PCA
from sklearn.linear_model import LinearRegression
from sklearn.preprocessing import StandardScaler
from sklearn.utils.validation import check_is_fitted, validate_data

from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.thermal.regression.table import ErrorSetError, standardised

EXPLAINED_SHARE = 0.85
"""The paper's rule: as many components as carry 85 % of the variance."""

# A set whose unexplained share is no larger is told exactly: what is left is rounding.
_EXACT = 1e-14


def variance_inflation_factors(X: ArrayLike, some: slice = slice(None)) -> FloatArray:
    """Return the VIF of every set, or of some, against all others together, shape (k,), 1 or more; by statsmodels.

    Infinite where the others tell a set exactly, which they always do with no more than k rows. A table of two sets
    gives the paper's VIF of a pair. X: sets as columns, shape (n, k), in any units.

    Raises:
        ErrorSetError: a set is constant.
    """
    from statsmodels.stats.outliers_influence import variance_inflation_factor

    scaled = standardised("error set", X)
    if scaled.shape[1] == 1:
        return np.ones(1)
    with_constant = np.column_stack([np.ones(len(scaled)), scaled])
    with np.errstate(divide="ignore"), warnings.catch_warnings():
        # It warns of sets that the others tell exactly; they are told as infinite.
        warnings.simplefilter("ignore", UserWarning)
        asked = np.arange(1, with_constant.shape[1])[some]
        unexplained = 1.0 / np.array([variance_inflation_factor(with_constant, i) for i in asked])
        return np.where(unexplained <= _EXACT, np.inf, np.maximum(1.0 / unexplained, 1.0))


class PrincipalComponentRegression(RegressorMixin, BaseEstimator):  # type: ignore[misc]
    """Linear regression on the principal components of the correlation matrix, told in the original units.

    Scikit-learn's scaling, PCA and ordinary least squares, with as many components as carry the wanted share of
    variance. In the paper y is the melt temperature and X the sensitive error sets: equations 19 to 21. A
    constant set takes no part. ``explained``: least cumulative share of variance the components carry, in (0, 1].
    """

    def __init__(self, explained: float = EXPLAINED_SHARE) -> None:
        self.explained = explained

    def fit(self, X: ArrayLike, y: ArrayLike) -> Self:
        """Fit y, shape (n,), on the components of X, shape (n, k), n ≥ 2.

        Raises:
            ErrorSetError: all sets are constant, or the share is out of its range.
            ValueError: X or y are no finite numbers (scikit-learn's words).
        """
        sets, target = validate_data(self, X, y, dtype=np.float64, y_numeric=True, ensure_min_samples=2)
        if not 0.0 < self.explained <= 1.0:
            raise ErrorSetError(f"explained = {self.explained}: give a share above 0, up to 1 (usual: 0.85)")
        scaler = StandardScaler().fit(sets)
        scaled = scaler.transform(sets)
        if not scaled.any():
            raise ErrorSetError("every set is constant; there is no variance to find components of")
        every = PCA(svd_solver="full").fit(scaled)
        # all λ of the correlation matrix, falling, shape (min(n, k),); they add up to k
        self.eigenvalues_ = every.explained_variance_ * (1.0 - 1.0 / len(sets))
        self.cumulative_ = np.cumsum(every.explained_variance_ratio_)
        # The last share is 1 up to rounding; a wish for all of it must not run past the end.
        self.n_components_ = 1 + int(np.argmax(self.cumulative_ >= self.explained - 1e-12))
        self.components_ = every.components_[: self.n_components_]  # the u kept, shape (m, k)
        # on them; its coefficients are γ s_y, shape (m,)
        self.regression_ = LinearRegression().fit(scaled @ self.components_.T, target)
        per_scaled = self.components_.T @ self.regression_.coef_
        spread = float(np.std(target))
        # β, shape (k,). A constant y has no spread, and then every coefficient is 0.
        self.standardised_coef_ = per_scaled / spread if spread > 0.0 else np.zeros_like(per_scaled)
        self.coef_ = per_scaled / scaler.scale_  # b, shape (k,), in units of y per unit of the set; then b0
        self.intercept_ = float(target.mean() - scaler.mean_ @ self.coef_)
        return self

    def predict(self, X: ArrayLike) -> FloatArray:
        """Return y of new rows, shape (n,)."""
        check_is_fitted(self)
        sets: FloatArray = validate_data(self, X, dtype=np.float64, reset=False)
        return np.asarray(sets @ self.coef_ + self.intercept_)
