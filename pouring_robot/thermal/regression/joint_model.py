r"""The joint regression: one line of error against melt temperature from the sensitive sets of a table.

**The paper's recipe** (5.2.2 (3), equations 21 and 22, both lost; derived here from the text). With T the temperature
and P_g the sensitive set of group g, principal-component regression gives equation 21, and each set has a simple line:

.. math:: T = c_0 + \sum_g c_g P_g, \qquad \hat P_g(T) = a_g + m_g T

"Bring it into the principal component regression equation. P8PCR is obtained by TEMP and P1, and vice versa": equation
21 is solved for one set, with the lines of the others in place of their values,

.. math:: P_g^{PCR}(T) = \frac{T - c_0 - \sum_{h \ne g} c_h \hat P_h(T)}{c_g}

"The factor contribution rate of equation (21) determines the weights":

.. math:: w_g = \frac{|c_g|}{\sum_h |c_h|}, \qquad P_{end}(T) = \sum_g w_g P_g^{PCR}(T)

For two sets and one component c_g ∝ 1/s_g, so the flatter set has the larger weight; and where r_g is a set's
correlation with T, its slope becomes (1/β − r_h) s_g/s_T with β = (r_1 + r_2)/(2 + 2r), not r_g s_g/s_T: equation 21 is
a regression of temperature, and inverted it is steeper than the data by its unexplained share.

The conclusion (7) weights "by principal component contribution" instead (``"components"``), interpreted as a set's
share of the kept components' variance, with λ_j the eigenvalues and u_j the eigenvectors:

.. math:: w_g = \frac{\sum_{j \le m} \lambda_j u_{gj}^2}{\sum_{j \le m} \lambda_j}

By this, two sets with one component have equal weights, whatever the data.

Why the mean line of all sets is better than both: :mod:`pouring_robot.thermal.regression.methods`.
"""

from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, RegressorMixin, clone
from sklearn.decomposition import PCA
from sklearn.linear_model import LinearRegression
from sklearn.metrics import r2_score
from sklearn.preprocessing import StandardScaler
from sklearn.utils.validation import check_is_fitted, validate_data

from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.thermal.regression.sensitive_sets import SensitiveSetSelector
from pouring_robot.thermal.regression.table import ErrorSetError

WEIGHTINGS = ("coefficients", "components")
EXPLAINED_SHARE = 0.85
"""The paper's rule: as many components as explain 85 % of the variance."""


class PrincipalComponentRegression(RegressorMixin, BaseEstimator):  # type: ignore[misc]
    r"""Linear regression on the principal components of the correlation matrix, expressed in the original units.

    The paper's 5.1.4, whose formulas were lost; from textbooks, with s the sample standard deviations (divisor
    n − 1), λ and u the eigenvalues and eigenvectors of the correlation matrix R_P, k sets:

    .. math::
       x^*_i = \frac{x_i - \bar x_i}{s_i}, \quad R_P u_j = \lambda_j u_j, \quad Z_j = \sum_i u_{ij} x^*_i, \quad
       m = \min \Big\{ m : \sum_{j \le m} \lambda_j / k \ge 0.85 \Big\}

       y^* = \sum_{j \le m} \gamma_j Z_j = \sum_i \beta_i x^*_i, \quad \beta_i = \sum_{j \le m} u_{ij} \gamma_j, \quad
       b_i = \frac{s_y}{s_i} \beta_i, \quad b_0 = \bar y - \sum_i b_i \bar x_i

    It uses scikit-learn's scaling, PCA and ordinary least squares, with as many components as explain the requested
    share of variance. In the paper y is the melt temperature and X the sensitive error sets: equations 19 to 21.
    Constant sets are ignored. ``explained``: smallest cumulative share of variance that the components explain, (0, 1].
    """

    def __init__(self, explained: float = EXPLAINED_SHARE) -> None:
        self.explained = explained

    def fit(self, X: ArrayLike, y: ArrayLike) -> Self:
        """Fit y, shape (n,), on the components of X, shape (n, k), n ≥ 2.

        Raises:
            ErrorSetError: all sets are constant, or the share is out of range.
            ValueError: X or y are not finite numbers (scikit-learn's message).
        """
        sets, target = validate_data(self, X, y, dtype=np.float64, y_numeric=True, ensure_min_samples=2)
        if not 0.0 < self.explained <= 1.0:
            raise ErrorSetError(f"explained = {self.explained}: give a share above 0, up to 1 (usual: 0.85)")
        scaler = StandardScaler().fit(sets)
        scaled = scaler.transform(sets)
        if not scaled.any():
            raise ErrorSetError("every set is constant; there is no variance to find components of")
        every = PCA(svd_solver="full").fit(scaled)
        # all λ of the correlation matrix, decreasing, shape (min(n, k),); their sum is k
        self.eigenvalues_ = every.explained_variance_ * (1.0 - 1.0 / len(sets))
        self.cumulative_ = np.cumsum(every.explained_variance_ratio_)
        # The last share is 1 up to rounding; a request for all of it must not go past the end.
        self.n_components_ = 1 + int(np.argmax(self.cumulative_ >= self.explained - 1e-12))
        self.components_ = every.components_[: self.n_components_]  # the u kept, shape (m, k)
        # regression on them; its coefficients are γ s_y, shape (m,)
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


class JointRegression(RegressorMixin, BaseEstimator):  # type: ignore[misc]
    """Error at any pose, predicted from temperature by all groups of a table together: one line for all poses.

    It must not be used where poses have errors in opposite directions, as this robot's have in Y left and right of its
    middle: their mean line is near zero and helps none of them. It is compared with no compensation and with a line
    that depends on the pose in :mod:`pouring_robot.thermal.regression.methods`.

    X is temperature, shape (n, 1); y is the table, sets as columns, shape (n, k). It predicts one error, shape (n,),
    to compensate at any pose. Units are free; with an :class:`ErrorTable` they are K and m (or rad).

    Args:
        weighting: "coefficients" (raw c_g, the paper's section 5.2) or "components" (contribution to the principal
            components, its section 7).
        selector: chooses the sensitive sets; by default :class:`SensitiveSetSelector` with its default settings.
        explained: as in :class:`PrincipalComponentRegression`.
    """

    def __init__(
        self,
        weighting: str = "coefficients",
        *,
        selector: SensitiveSetSelector | None = None,
        explained: float = EXPLAINED_SHARE,
    ) -> None:
        self.weighting, self.selector, self.explained = weighting, selector, explained

    def fit(self, X: ArrayLike, y: ArrayLike) -> Self:
        """Fit the line to a table, n ≥ 3 temperatures.

        Raises:
            ErrorSetError: X has more than one column, a set or the temperature is constant, a setting is out of range,
                or equation 21 does not contain a set and so cannot be solved for it.
            ValueError: X or y are not finite numbers (scikit-learn's message).
        """
        if self.weighting not in WEIGHTINGS:
            raise ErrorSetError(f"weighting '{self.weighting}' is not known; give one of {', '.join(WEIGHTINGS)}")
        column, table = validate_data(
            self, X, y, dtype=np.float64, multi_output=True, y_numeric=True, ensure_min_samples=3
        )
        if column.shape[1] != 1:
            raise ErrorSetError(f"X has {column.shape[1]} columns; give temperature alone, shape (n, 1)")
        table = table.astype(float).reshape(len(column), -1)
        selector = SensitiveSetSelector() if self.selector is None else clone(self.selector)
        self.selector_ = selector.fit(table, column[:, 0])
        names = np.asarray(getattr(y, "columns", range(table.shape[1])))[self.selector_.sensitive_]
        self._predict_sets(column, table[:, self.selector_.sensitive_], names)
        if self.weighting == "coefficients":
            rates = np.abs(self.component_regression_.coef_)
        else:
            kept = self.component_regression_.components_
            rates = self.component_regression_.eigenvalues_[: len(kept)] @ kept**2
        self.weights_ = rates / rates.sum()  # of each group, shape (g,)
        self.coef_ = float(self.weights_ @ self.set_coef_)
        self.intercept_ = float(self.weights_ @ self.set_intercept_)
        return self

    def _predict_sets(self, column: FloatArray, sensitive: FloatArray, names: NDArray[Any]) -> None:
        """Fit equation 21 and the simple lines of the sensitive sets, and solve the first for each: lines P_g^PCR."""
        regression = PrincipalComponentRegression(self.explained).fit(sensitive, column[:, 0])
        lines = LinearRegression().fit(column, sensitive)
        self.component_regression_ = regression
        self.single_coef_, self.single_intercept_ = lines.coef_[:, 0], lines.intercept_
        lost = np.flatnonzero(np.abs(regression.standardised_coef_) < 1e-9)
        if lost.size:
            raise ErrorSetError(
                f"the kept components do not represent error set {names[lost[0]]}, so it cannot be predicted from the "
                "others; ask for fewer groups or a larger explained share"
            )
        slopes, offsets = regression.coef_ * self.single_coef_, regression.coef_ * self.single_intercept_
        self.set_coef_ = (1.0 - slopes.sum() + slopes) / regression.coef_
        self.set_intercept_ = (-regression.intercept_ - offsets.sum() + offsets) / regression.coef_

    def predict(self, X: ArrayLike) -> FloatArray:
        """Return P_end at the temperatures X, shape (n, 1) to (n,)."""
        check_is_fitted(self)
        column: FloatArray = validate_data(self, X, dtype=np.float64, reset=False)
        return column[:, 0] * self.coef_ + self.intercept_

    def score(self, X: ArrayLike, y: ArrayLike, sample_weight: ArrayLike | None = None) -> float:
        """Return R² of P_end over all sets of y, shape (n, k) or (n,), with equal weights of all values."""
        table = np.asarray(y, dtype=float).reshape(len(np.asarray(y)), -1)
        weights = np.ones(len(table)) if sample_weight is None else sample_weight
        predicted, weights = (np.repeat(one, table.shape[1]) for one in (self.predict(X), weights))
        return float(r2_score(table.ravel(), predicted, sample_weight=weights))

    def __sklearn_tags__(self) -> Any:
        """Tell scikit-learn that y is a table."""
        tags = super().__sklearn_tags__()
        tags.target_tags.multi_output = tags.target_tags.single_output = True
        return tags
