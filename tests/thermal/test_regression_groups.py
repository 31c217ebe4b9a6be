"""Fuzzy clustering and grey relation against hand-worked cases and explicit composition."""

import itertools

import numpy as np
import pytest
from scipy.cluster.hierarchy import cophenet, fcluster, linkage
from scipy.spatial.distance import squareform
from sklearn.base import clone
from sklearn.feature_selection import SelectKBest
from sklearn.utils.estimator_checks import check_estimator

from pouring_robot.thermal.regression.sensitive_sets import FuzzyClustering, fuzzy_similarity, grey_relational_degree
from pouring_robot.thermal.regression.table import ErrorSetError

# A textbook-sized relation: the best path 0-2-1 carries 0.6, set 3 hangs on by 0.3.
RELATION = np.array([[1.0, 0.2, 0.8, 0.1], [0.2, 1.0, 0.6, 0.3], [0.8, 0.6, 1.0, 0.0], [0.1, 0.3, 0.0, 1.0]])
CLOSURE = np.array([[1.0, 0.6, 0.8, 0.3], [0.6, 1.0, 0.6, 0.3], [0.8, 0.6, 1.0, 0.3], [0.3, 0.3, 0.3, 1.0]])


def random_sets(seed, sets=9, numbers=12):
    random = np.random.default_rng(seed)
    trend = np.linspace(0.0, 1.0, numbers)
    return random.uniform(-3, 3, size=(sets, 1)) * trend + 0.3 * random.normal(size=(sets, numbers))


def weakest_links(similarity):
    """Return the best of all paths between every two sets, each path as strong as its weakest link, by trying all."""
    size = len(similarity)
    best = np.array(similarity)
    for i, j in itertools.permutations(range(size), 2):
        others = [m for m in range(size) if m not in {i, j}]
        for length in range(1, len(others) + 1):
            for between in itertools.permutations(others, length):
                path = (i, *between, j)
                best[i, j] = max(best[i, j], min(similarity[a, b] for a, b in itertools.pairwise(path)))
    return best


def max_min_composition(first, second):
    return np.minimum(first[:, :, None], second[None, :, :]).max(axis=1)


def transitive_closure(similarity):
    """Return t(R): composed with itself until nothing changes, as the paper has it."""
    closure = np.array(similarity)
    while not np.array_equal(following := max_min_composition(closure, closure), closure):
        closure = following
    return closure


def test_the_hand_worked_closure():
    np.testing.assert_array_equal(max_min_composition(RELATION, RELATION)[0], [1.0, 0.6, 0.8, 0.2])
    np.testing.assert_array_equal(transitive_closure(RELATION), CLOSURE)
    np.testing.assert_array_equal(weakest_links(RELATION), CLOSURE)


@pytest.mark.parametrize("seed", range(20))
def test_closure_is_single_linkage(seed):
    model = FuzzyClustering().fit(random_sets(seed))
    explicit = transitive_closure(model.similarity_)
    np.testing.assert_allclose(model.closure_, explicit, atol=1e-12)
    np.testing.assert_allclose(
        1.0 - squareform(cophenet(linkage(squareform(1.0 - model.similarity_, checks=False), "single"))),
        explicit,
        atol=1e-12,
    )
    np.testing.assert_array_equal(max_min_composition(explicit, explicit), explicit)
    if seed < 3:
        small = FuzzyClustering().fit(random_sets(seed, sets=6))
        np.testing.assert_allclose(small.closure_, weakest_links(small.similarity_), atol=1e-12)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("n_clusters", [1, 2, 4, 9])
def test_lambda_cut_and_number_of_groups_agree(seed, n_clusters):
    sets = random_sets(seed)
    by_number = FuzzyClustering(n_clusters).fit(sets)
    low, high = by_number.lambda_range_
    assert by_number.n_clusters_ == n_clusters and low < high
    for threshold in (low + 1e-9, (low + high) / 2, high):
        by_threshold = FuzzyClustering(lambda_cut=threshold).fit(sets)
        np.testing.assert_array_equal(by_threshold.labels_, by_number.labels_)
        classes = {tuple(np.flatnonzero(row)) for row in by_number.closure_ >= threshold - 1e-12}
        assert classes == {tuple(group) for group in by_threshold.groups()}
    reference = fcluster(by_number.linkage_, n_clusters, "maxclust")
    assert len({*zip(reference, by_number.labels_, strict=True)}) == n_clusters
    assert n_clusters == 9 or FuzzyClustering(lambda_cut=high + 1e-9).fit(sets).n_clusters_ > n_clusters


def test_similarity_is_numpys_correlation():
    sets = random_sets(3)
    correlation = np.corrcoef(sets)
    np.testing.assert_allclose(fuzzy_similarity(sets), np.abs(correlation), atol=1e-14)
    np.testing.assert_allclose(fuzzy_similarity(sets, "shifted"), (1 + correlation) / 2, atol=1e-14)


def test_the_same_set_in_other_units_is_one_group():
    base = random_sets(1, sets=2)
    model = FuzzyClustering().fit(np.vstack([base, 1e-3 * base[0] + 7.0, -base[1]]))
    assert model.labels_.tolist() == [0, 1, 0, 1]
    # Three sets alike but for rounding: no λ makes two groups of them.
    alike = FuzzyClustering().fit(np.vstack([base[0], base[0] / 3.0, base[0] * 0.7 + 0.1]))
    assert alike.n_clusters_ == 1


@pytest.mark.parametrize(
    ("model", "words"),
    [
        (FuzzyClustering(0), "n_clusters = 0"),
        (FuzzyClustering(lambda_cut=1.5), "lambda_cut = 1.5"),
        (FuzzyClustering(similarity="cosine"), "'cosine' is not known"),
    ],
)
def test_bad_settings(model, words):
    with pytest.raises(ErrorSetError, match=words):
        model.fit(random_sets(0))


def test_a_constant_set_is_named():
    sets = random_sets(0)
    sets[4] = 2.5
    with pytest.raises(ErrorSetError, match="error set 4 is constant"):
        FuzzyClustering().fit(sets)


def test_scikit_learns_checks():
    # They cluster clouds of points in space, whole numbers and constant rows among them; ours are shapes of curves.
    known = dict.fromkeys(["check_clustering", "check_estimators_dtypes"], "points in space are no error sets")
    check_estimator(FuzzyClustering(), expected_failed_checks=known, on_skip=None)


# --- grey relation --------------------------------------------------------------------------------


def test_the_hand_worked_degree():
    # Spread from 0 to 1: y' = 0, 1/2, 1; x1' = 0, 1/4, 1; x2' = 0, 1, 1. Deltas 0, 1/4, 0 and 0, 1/2, 0: with η = 0.5
    # ξ = (0 + 1/4) / (Δ + 1/4) = 1, 1/2, 1 and 1, 1/3, 1.
    X, y = np.array([[0.0, 5.0], [1.0, 7.0], [4.0, 7.0]]), np.array([600.0, 700.0, 800.0])
    np.testing.assert_allclose(grey_relational_degree(X, y), [5 / 6, 7 / 9], rtol=1e-14)


def test_against_plain_loops():
    random = np.random.default_rng(5)
    X, y = random.uniform(1.0, 2.0, size=(12, 10)), np.linspace(1.0, 2.0, 12)
    rising = [x if np.corrcoef(x, y)[0, 1] > 0 else -x for x in X.T]
    spread = [[(v - min(x)) / (max(x) - min(x)) for v in x] for x in (y, *rising)]
    deltas = [[abs(a - b) for a, b in zip(spread[0], x, strict=True)] for x in spread[1:]]
    least, most = min(map(min, deltas)), max(map(max, deltas))
    expected = [sum((least + 0.5 * most) / (d + 0.5 * most) for d in row) / 12 for row in deltas]
    np.testing.assert_allclose(grey_relational_degree(X, y), expected, rtol=1e-12)


def test_units_and_sign_do_not_matter_and_perfect_following_is_one():
    random = np.random.default_rng(6)
    X, y = random.normal(size=(8, 3)) + np.linspace(0, 3, 8)[:, None], np.linspace(600, 1700, 8)
    degrees = grey_relational_degree(X, y)
    np.testing.assert_allclose(grey_relational_degree(-1e-3 * X + 4.0, y + 273.15), degrees, rtol=1e-10)
    np.testing.assert_array_equal(grey_relational_degree(y[:, None], y), [1.0])
    kept = SelectKBest(grey_relational_degree, k=1).fit(X, y)
    assert kept.get_support().argmax() == degrees.argmax()


def test_sets_on_lines_of_temperature_are_told_apart_by_no_rounding():
    celsius = np.linspace(600.0, 1700.0, 6)
    lines = (celsius[:, None] - 600.0) * [1e-6, 1.1e-6, 0.9e-6, -1.05e-6]
    for temperatures in (celsius, celsius + 273.15):
        np.testing.assert_array_equal(grey_relational_degree(lines, temperatures), np.ones(4))


@pytest.mark.parametrize(
    ("X", "words"), [([[1.0], [1.0], [1.0]], "error set 0 is constant"), ([[1.0], [2.0]], "do not fit")]
)
def test_grey_errors(X, words):
    with pytest.raises(ErrorSetError, match=words):
        grey_relational_degree(X, [1.0, 2.0, 3.0])


def test_clone_keeps_settings():
    assert clone(FuzzyClustering(3, lambda_cut=0.5, similarity="shifted")).get_params() == {
        "n_clusters": 3,
        "lambda_cut": 0.5,
        "similarity": "shifted",
    }
