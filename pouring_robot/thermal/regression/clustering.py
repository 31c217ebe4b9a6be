r"""Fuzzy clustering of error sets: which poses answer to temperature alike.

The paper (5.1.1) builds a fuzzy similarity matrix from correlation coefficients, squares it by max–min composition
until it no longer changes, and cuts it at a threshold λ. Its formulas were lost; these are the textbook's:

.. math::
   r_{ij} = \left| \frac{\sum_k (x_{ik} - \bar x_i)(x_{jk} - \bar x_j)}
                        {\sqrt{\sum_k (x_{ik} - \bar x_i)^2 \sum_k (x_{jk} - \bar x_j)^2}} \right|, \qquad
   (R \circ R)_{ij} = \max_m \min(r_{im}, r_{mj}), \qquad t(R) = R^{2^b} = R^{2^{b+1}}

The entry ij of t(R) is the weakest link of the best path from i to j. Single linkage on the distances 1 − r merges two
groups at the shortest edge between them, which is the longest edge of that same path: its cophenetic distances are 1 −
t(R). So SciPy's linkage gives closure, groups and dendrogram at once.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.cluster.hierarchy import cophenet, fcluster, linkage
from scipy.sparse.csgraph import connected_components
from scipy.spatial.distance import squareform
from sklearn.base import BaseEstimator, ClusterMixin
from sklearn.utils.validation import validate_data

from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.thermal.regression.table import ErrorSetError, standardised

# Two sets this close to r = 1 are one set: what still parts them is rounding, and a group made of it would be chance.
_SAME = 1e-12


def fuzzy_similarity(sets: ArrayLike, similarity: str = "absolute") -> FloatArray:
    """Return the fuzzy similarity of every two sets, from their correlation coefficient r.

    Sets are rows, (k, n); numbers of the symmetric matrix (k, k) are in [0, 1], those on its diagonal 1. "absolute"
    takes abs(r): a set that falls with temperature tells as much as one that rises; "shifted" (1 + r) / 2: opposite
    sets are unlike.

    Raises:
        ErrorSetError: a set is constant, or the similarity is not known.
    """
    rows = np.asarray(sets, dtype=float)
    scaled = standardised("error set", rows.T)
    correlation = np.clip(scaled.T @ scaled / (rows.shape[1] - 1), -1.0, 1.0)
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
        n_clusters: cut where this many groups appear. Where equal similarities jump over that number, the cut with the
            largest smaller number is taken, and ``n_clusters_`` tells. Not used with ``lambda_cut``.
        lambda_cut: two sets are one group where t(R) ≥ λ, in [0, 1].
        similarity: as in :func:`fuzzy_similarity`.

    Attributes:
        similarity_: R, shape (k, k).
        closure_: t(R), shape (k, k).
        linkage_: SciPy's linkage matrix over the distances 1 − r, shape (k − 1, 4).
        labels_: group of each set, shape (k,), numbered from 0 in order of first appearance.
        n_clusters_: number of groups.
        lambda_range_: (low, high): the same groups come out for every λ with low < λ ≤ high.
    """

    def __init__(self, n_clusters: int = 2, *, lambda_cut: float | None = None, similarity: str = "absolute") -> None:
        self.n_clusters, self.lambda_cut, self.similarity = n_clusters, lambda_cut, similarity

    def fit(self, X: ArrayLike, y: object = None) -> FuzzyClustering:
        """Group the rows of X, shape (k, n), two numbers a row or more; y is not used.

        Raises:
            ErrorSetError: a set is constant or a setting is out of its range.
            ValueError: X is no table of finite numbers (scikit-learn's words).
        """
        rows = validate_data(self, X, dtype=np.float64, ensure_min_features=2)
        if self.lambda_cut is not None and not 0.0 <= self.lambda_cut <= 1.0:
            raise ErrorSetError(f"lambda_cut = {self.lambda_cut}: give a threshold between 0 and 1")
        if self.n_clusters < 1:
            raise ErrorSetError(f"n_clusters = {self.n_clusters}: give 1 or more")
        self.similarity_ = fuzzy_similarity(rows, self.similarity)
        self.linkage_, self.closure_, labels = np.empty((0, 4)), np.ones((1, 1)), np.zeros(1, dtype=int)
        if len(rows) > 1:
            self.linkage_ = linkage(squareform(1.0 - self.similarity_, checks=False), "single")
            self.closure_ = 1.0 - squareform(cophenet(self.linkage_))
            if self.lambda_cut is None:
                labels = fcluster(self.linkage_, self.n_clusters, "maxclust")
            else:
                labels = connected_components(self.closure_ >= self.lambda_cut - _SAME, directed=False)[1]
        _, first, inverse = np.unique(labels, return_index=True, return_inverse=True)
        self.labels_ = np.argsort(np.argsort(first))[inverse]
        self.n_clusters_ = len(first)
        together = self.labels_[:, None] == self.labels_
        self.lambda_range_ = (float(self.closure_[~together].max(initial=0.0)), float(self.closure_[together].min()))
        return self

    def groups(self) -> list[list[int]]:
        """Return the positions of the sets of each group."""
        return [np.flatnonzero(self.labels_ == group).tolist() for group in range(self.n_clusters_)]

    def dendrogram(self, names: list[str] | None = None, ax: Any = None) -> dict[str, Any]:
        """Return, and draw where matplotlib axes are given, SciPy's dendrogram over 1 − λ, a label for each set."""
        from scipy.cluster.hierarchy import dendrogram

        result: dict[str, Any] = dendrogram(self.linkage_, labels=names, ax=ax, no_plot=ax is None)
        return result
