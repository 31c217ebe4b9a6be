r"""Fuzzy clustering of error sets, and choice of a sensitive one a group, by grey relation, VIF guarding collinearity.

Which poses respond to temperature alike: the paper (5.1.1) builds a fuzzy similarity matrix from correlation
coefficients, squares it by max–min composition until it no longer changes, and cuts it at a threshold λ. Its formulas
were lost; these are from textbooks:

.. math::
   r_{ij} = \left| \frac{\sum_k (x_{ik} - \bar x_i)(x_{jk} - \bar x_j)}
                        {\sqrt{\sum_k (x_{ik} - \bar x_i)^2 \sum_k (x_{jk} - \bar x_j)^2}} \right|, \qquad
   (R \circ R)_{ij} = \max_m \min(r_{im}, r_{mj}), \qquad t(R) = R^{2^b} = R^{2^{b+1}}

The entry ij of t(R) is the weakest link of the best path from i to j. Single linkage on the distances 1 − r merges two
groups at the shortest edge between them, which is the longest edge of that same path: its cophenetic distances are 1 −
t(R). So SciPy's linkage gives closure, groups and dendrogram at once.

The paper's 5.2.2 (1) and (2): groups {P1} and {P2 … P10}; in the second the candidates are P8 and P5, P5's VIF is a
little lower, the grey degree of P8 is the largest, P8 is taken. The rule derived from this here:

1. Groups are taken in order of size, the smallest first (it offers the least choice); equal ones by their first set.
2. Candidates in each group are the sets whose VIF against all sets already chosen is below the limit, 10.
3. Of these the one with the largest grey relational degree to temperature is chosen; the first of equals.
4. Where no set of a group passes the VIF limit, the largest degree alone decides, and ``guard_held_`` says so. This is
   no error: the principal components that follow can handle collinear sets, which is their purpose.

The paper's figures agree with step 2: a first component of 96.99 % in two sets means λ1 = 1.9398 = 1 + r, so r =
0.9398 between P1 and P8, and VIF = 1 / (1 − r²) = 8.56 < 10.
"""

import warnings
from typing import Any, Self

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy.cluster.hierarchy import cophenet, fcluster, linkage
from scipy.spatial.distance import squareform
from sklearn.base import BaseEstimator, ClusterMixin
from sklearn.feature_selection import SelectorMixin
from sklearn.utils.validation import check_is_fitted, validate_data

from pouring_robot.mechanism.arrays import BoolArray, FloatArray
from pouring_robot.thermal.regression.table import ErrorSetError, standardised

# Closer to r = 1, or to temperature's trend, than this is rounding; a group or degree based on it would be chance.
_SAME = 1e-12
VIF_LIMIT = 10.0
"""From this value on collinearity is called serious (the paper's 5.1.3)."""
# A set whose unexplained share is no larger is determined exactly: the rest is rounding.
_EXACT = 1e-14


def fuzzy_similarity(sets: ArrayLike, similarity: str = "absolute") -> FloatArray:
    """Return the fuzzy similarity of every two sets, from their correlation coefficient r.

    Sets are rows, (k, n); values of the symmetric matrix (k, k) are in [0, 1], those on its diagonal 1. "absolute"
    is abs(r): a set that falls with temperature is as informative as one that rises; "shifted" is (1 + r) / 2: opposite
    sets are dissimilar.

    Raises:
        ErrorSetError: a set is constant, or the similarity is unknown.
    """
    correlation = np.atleast_2d(np.corrcoef(standardised("error set", np.transpose(sets)), rowvar=False))
    if similarity not in {"absolute", "shifted"}:
        raise ErrorSetError(f"similarity '{similarity}' is not known; give 'absolute' or 'shifted'")
    result: FloatArray = np.abs(correlation) if similarity == "absolute" else (1.0 + correlation) / 2.0
    result[1.0 - result < _SAME] = 1.0
    np.fill_diagonal(result, 1.0)
    return result


class FuzzyClustering(ClusterMixin, BaseEstimator):  # type: ignore[misc]
    """Groups of sets by fuzzy similarity, max–min closure and λ-cut; each row of X is one set.

    An error table has its sets as columns: fit on ``table.errors.T``.

    Args:
        n_clusters: cut where this many groups appear. Where equal similarities skip that number, the cut with the
            next smaller number is taken; ``n_clusters_`` is the result. Not used with ``lambda_cut``.
        lambda_cut: two sets are in one group where t(R) ≥ λ, in [0, 1].
        similarity: as in :func:`fuzzy_similarity`.
    """

    def __init__(self, n_clusters: int = 2, *, lambda_cut: float | None = None, similarity: str = "absolute") -> None:
        self.n_clusters, self.lambda_cut, self.similarity = n_clusters, lambda_cut, similarity

    def fit(self, X: ArrayLike, y: object = None) -> Self:
        """Group the rows of X, shape (k, n), with two or more values per row; y is not used.

        Raises:
            ErrorSetError: a set is constant or a setting is out of range.
            ValueError: X is not a table of finite numbers (scikit-learn's message).
        """
        rows = validate_data(self, X, dtype=np.float64, ensure_min_features=2)
        if self.lambda_cut is not None and not 0.0 <= self.lambda_cut <= 1.0:
            raise ErrorSetError(f"lambda_cut = {self.lambda_cut}: give a threshold between 0 and 1")
        if self.n_clusters < 1:
            raise ErrorSetError(f"n_clusters = {self.n_clusters}: give 1 or more")
        self.similarity_ = fuzzy_similarity(rows, self.similarity)  # R, shape (k, k)
        self.linkage_, self.closure_, labels = np.empty((0, 4)), np.ones((1, 1)), np.zeros(1, dtype=int)
        if len(rows) > 1:
            # SciPy's linkage matrix over the distances 1 − r, shape (k − 1, 4), and t(R), shape (k, k)
            self.linkage_ = linkage(squareform(1.0 - self.similarity_, checks=False), "single")
            self.closure_ = 1.0 - squareform(cophenet(self.linkage_))
            cut = self.n_clusters if self.lambda_cut is None else 1.0 - self.lambda_cut + _SAME
            labels = fcluster(self.linkage_, cut, "maxclust" if self.lambda_cut is None else "distance")
        self.labels_, found = pd.factorize(labels)  # group of each set, from 0 in order of first appearance
        self.n_clusters_ = len(found)
        together = self.labels_[:, None] == self.labels_
        # (low, high): the groups are the same for every λ with low < λ ≤ high
        self.lambda_range_ = (float(self.closure_[~together].max(initial=0.0)), float(self.closure_[together].min()))
        return self

    def groups(self) -> list[list[int]]:
        """Return the indices of the sets of each group."""
        return [np.flatnonzero(self.labels_ == group).tolist() for group in range(self.n_clusters_)]


def grey_relational_degree(X: ArrayLike, y: ArrayLike) -> FloatArray:
    r"""Return γ of every set, a column of X, (n, k), to temperature y, (n,): values in (0, 1], shape (k,).

    Deng's formula (the paper's equation 10, which was lost), with the two extremes over all sets i and steps k and the
    usual resolution η = 0.5:

    .. math::
       \xi_i(k) = \frac{\Delta_{\min} + \eta\,\Delta_{\max}}{\Delta_i(k) + \eta\,\Delta_{\max}}, \qquad
       \Delta_i(k) = |y'_k - x'_{ik}|, \qquad \gamma_i = \frac1n \sum_k \xi_i(k)

    y' and x' are temperature and error without units. The paper does not say how it removed the units. Here each series
    is scaled to 0 to 1, so that neither the unit nor the reference temperature of an error changes the degree. A set
    that falls with temperature is inverted first: only the similarity of trends counts.

    A score function in scikit-learn's sense: ``SelectKBest(grey_relational_degree, k=2)``.

    Raises:
        ErrorSetError: a set or the temperature is constant, or the shapes do not fit.
    """
    sets, steps = np.asarray(X, dtype=float), np.asarray(y, dtype=float)
    if sets.ndim != 2 or steps.shape != sets.shape[:1]:
        raise ErrorSetError(f"shapes {sets.shape} and {steps.shape} do not fit; give (n, k) and (n,)")
    trend, series = standardised("temperature", steps[:, None]), standardised("error set", sets)
    series = np.where(trend.T @ series < 0.0, -1.0, 1.0) * series
    steps, sets = ((one - one.min(axis=0)) / np.ptp(one, axis=0) for one in (trend, series))
    distances = np.abs(steps - sets)
    half = 0.5 * distances.max()
    if half < _SAME:
        return np.ones(distances.shape[1])
    return np.asarray(((distances.min() + half) / (distances + half)).mean(axis=0))


def variance_inflation_factors(X: ArrayLike, some: slice = slice(None)) -> FloatArray:
    """Return the VIF of every set, or of some, against all others together, shape (k,), 1 or more; from statsmodels.

    It is 1/(1 − R²), with R² of the set regressed on the others (the paper's 5.1.3, whose formula was lost), infinite
    where they determine it exactly, as they always do with no more than k rows. A table of two sets gives the paper's
    VIF of a pair. X: sets as columns, shape (n, k), in any units.

    Raises:
        ErrorSetError: a set is constant.
    """
    from statsmodels.stats.outliers_influence import variance_inflation_factor

    scaled = standardised("error set", X)
    if scaled.shape[1] == 1:
        return np.ones(1)
    with_constant = np.column_stack([np.ones(len(scaled)), scaled])
    with np.errstate(divide="ignore"), warnings.catch_warnings():
        # It warns of sets that the others determine exactly; their VIF is infinite.
        warnings.simplefilter("ignore", UserWarning)
        asked = np.arange(1, with_constant.shape[1])[some]
        unexplained = 1.0 / np.array([variance_inflation_factor(with_constant, i) for i in asked])
        return np.where(unexplained <= _EXACT, np.inf, np.maximum(1.0 / unexplained, 1.0))


class SensitiveSetSelector(SelectorMixin, BaseEstimator):  # type: ignore[misc]
    """Keeps one error set (column) of each group.

    Args:
        n_clusters, lambda_cut, similarity: as in :class:`FuzzyClustering`.
        vif_limit: sets at or above it are skipped where the group has others; above 1.
    """

    def __init__(
        self,
        n_clusters: int = 2,
        *,
        lambda_cut: float | None = None,
        similarity: str = "absolute",
        vif_limit: float = VIF_LIMIT,
    ) -> None:
        self.n_clusters, self.lambda_cut = n_clusters, lambda_cut
        self.similarity, self.vif_limit = similarity, vif_limit

    def fit(self, X: ArrayLike, y: ArrayLike) -> Self:
        """Choose among the columns of X, shape (n, k) with n ≥ 3, by temperature y, shape (n,).

        Raises:
            ErrorSetError: a set or the temperature is constant, or a setting is out of range.
            ValueError: X or y are not finite numbers (scikit-learn's message).
        """
        sets, temperature = validate_data(self, X, y, dtype=np.float64, y_numeric=True, ensure_min_samples=3)
        if not self.vif_limit > 1.0:
            raise ErrorSetError(f"vif_limit = {self.vif_limit}: give a number above 1 (usual: 10)")
        clustering = FuzzyClustering(self.n_clusters, lambda_cut=self.lambda_cut, similarity=self.similarity)
        self.grey_degrees_ = grey_relational_degree(sets, temperature)  # of every set, shape (k,)
        self.clustering_ = clustering.fit(sets.T)
        # indices of the sets of each group, in the order the groups are taken
        self.groups_ = sorted(clustering.groups(), key=lambda group: (len(group), group[0]))
        self.vif_ = np.ones(sets.shape[1])  # of every set against those chosen before its group's turn, shape (k,)
        chosen: list[int] = []
        for group in self.groups_:
            for i in group:
                (self.vif_[i],) = variance_inflation_factors(sets[:, [*chosen, i]], slice(-1, None))
            passed = [i for i in group if self.vif_[i] < self.vif_limit] or group
            chosen.append(max(passed, key=lambda i: float(self.grey_degrees_[i])))
        self.sensitive_ = np.array(chosen)  # index of the chosen set of each group, shape (g,)
        self.guard_held_ = self.vif_[self.sensitive_] < self.vif_limit  # of each group
        return self

    def _get_support_mask(self) -> BoolArray:
        """Return which columns are kept, shape (k,); scikit-learn's transform and names build on it."""
        check_is_fitted(self)
        return np.isin(np.arange(self.n_features_in_), self.sensitive_)

    def __sklearn_tags__(self) -> Any:
        """Tell scikit-learn that temperature is needed to choose."""
        tags = super().__sklearn_tags__()
        tags.target_tags.required = True
        return tags
