"""The loosest tolerances: optimal, feasible, and kept by robots drawn with them."""

import itertools

import numpy as np
import pytest
import scipy.optimize
import scipy.stats

from pouring_robot.exceptions import BadInputError
from pouring_robot.sweeps import Allocation, ErrorEntry, allocate, allocate_tolerances, group_covariances
from pouring_robot.sweeps.analysis.tolerances import distance_quantiles, transfer_matrices

SHARE = 0.9973


def case(poses, parameters, seed):
    random = np.random.default_rng(seed)
    transfer = random.normal(size=(poses, 3, parameters)) * np.array([1.0, 6.0, 1.0])[:, None]
    transfer *= np.exp(random.normal(size=parameters))
    alone = range(parameters)
    return group_covariances(transfer, np.ones(parameters), np.zeros(parameters), list(alone), list(alone))


def allowed(requirement):
    return (requirement / scipy.stats.norm.ppf(0.5 + 0.5 * SHARE)) ** 2


def test_two_tolerances_against_brute_force():
    covariances = case(6, 2, seed=3)
    found = allocate(covariances, np.ones(2), 10.0, SHARE, 1e6)
    ratios = np.logspace(-6, 6, 20_001)
    directions = np.stack([ratios, np.ones_like(ratios)])
    total = np.einsum("gn,pgij->npij", directions, covariances)
    scale = allowed(10.0) / np.linalg.eigvalsh(total)[..., -1].max(axis=1)
    best = directions[:, np.argmax(2 * np.log(scale) + np.log(directions).sum(axis=0))]
    # The last, common scaling keeps the ratios.
    assert found.factors[0] / found.factors[1] == pytest.approx(np.sqrt(best[0] / best[1]), rel=1e-3)


@pytest.mark.parametrize("cap", [1.5, 1e6])
def test_the_conditions_of_karush_kuhn_and_tucker_hold(cap):
    # At the optimum the gradient of sum log u, which is 1/u, is a non-negative combination of the tight constraints.
    covariances = case(40, 12, seed=8)
    found = allocate(covariances, np.ones(12), 10.0, SHARE, cap)
    squares = found.factors**2
    total = np.einsum("g,pgij->pij", squares, covariances)
    values, vectors = np.linalg.eigh(total)
    bound = values[:, -1].max()
    tight = np.flatnonzero(values[:, -1] > (1 - 1e-4) * bound)
    normals = [np.einsum("gij,i,j->g", covariances[p], vectors[p, :, -1], vectors[p, :, -1]) for p in tight]
    at_cap = [np.eye(12)[g] for g in np.flatnonzero(found.capped)]
    scaled = np.array([*normals, *at_cap]) * squares  # relative: the gradient is all ones
    _, left = scipy.optimize.nnls(scaled.T, np.ones(12))
    assert left < 1e-3
    assert bool(at_cap) == (cap == 1.5)


def test_the_distance_is_kept_exactly_at_the_worst_pose():
    covariances = case(40, 12, seed=8)
    found = allocate(covariances, np.ones(12), 10.0, SHARE, 1e6)
    quantiles = distance_quantiles(np.einsum("g,pgij->pij", found.factors**2, covariances), SHARE)
    assert quantiles.max() == pytest.approx(10.0, rel=1e-6)
    assert found.quantile_m == pytest.approx(quantiles, rel=1e-6)


def test_what_hardly_matters_stands_at_the_cap():
    """Three errors that act along x, y and z, all alike, and one that does next to nothing."""
    strengths = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1e-3, 1e-3, 1e-3]])
    found = allocate(np.array([[np.diag(s**2) for s in strengths]]), np.ones(4), 10.0, SHARE, 10.0)
    assert found.capped.tolist() == [False, False, False, True]
    assert found.factors[3] == pytest.approx(10.0, rel=1e-3)
    assert found.factors[:3] == pytest.approx(10.0 / scipy.stats.chi.ppf(SHARE, 3), rel=1e-3)
    assert found.quantile_m.max() <= 10.0 * (1.0 + 1e-9)


def test_distance_quantiles_against_draws_and_known_laws():
    spreads = np.array([[1.0, 1.0, 1.0], [1.0, 0.0, 0.0], [3.0, 1.0, 0.5]])
    found = distance_quantiles(np.array([np.diag(s**2) for s in spreads]), 0.95)
    assert found[0] == pytest.approx(scipy.stats.chi.ppf(0.95, 3), rel=1e-8)
    assert found[1] == pytest.approx(scipy.stats.norm.ppf(0.975), rel=5e-3)
    drawn = np.random.default_rng(1).normal(size=(400_000, 3)) * spreads[2]
    assert found[2] == pytest.approx(np.quantile(np.linalg.norm(drawn, axis=1), 0.95), rel=5e-3)


def test_correlated_errors_add_up_within_their_part():
    random = np.random.default_rng(4)
    transfer, std = random.normal(size=(3, 3, 5)), random.uniform(0.5, 2.0, size=5)
    parts, correlation = [0, 0, 1, 1, 1], 0.6
    covariance = np.eye(5)
    for i, j in itertools.permutations(range(5), 2):
        covariance[i, j] = correlation * (parts[i] == parts[j])
    covariance *= np.outer(std, std)
    found = group_covariances(transfer, std, np.full(5, correlation**0.5), parts, parts).sum(axis=1)
    assert np.allclose(found, transfer @ covariance @ transfer.transpose(0, 2, 1))


def test_robots_drawn_with_the_tolerances_keep_the_requirement(make_plan):
    entries = [
        ErrorEntry(parameters=("alpha_e*_*", "theta_e*_*"), distribution="normal", std_mrad=0.2),
        ErrorEntry(parameters=("a_e*_*", "d_e*_*"), half_width_mm=0.1),
    ]
    plan = make_plan(errors=entries, accuracy_mm=10.0)
    for by in ("parameter", "part", "entry"):
        found = allocate_tolerances(plan, Allocation(by=by, share=0.95, machines=1500))
        assert found.predicted_m == pytest.approx(0.010, rel=1e-6) and found.failed == 0
        # Three standard deviations of a share of 0.95 in 1500 draws are 0.017.
        assert abs(found.share_at_worst_pose - 0.95) < 0.03, by
        assert found.share_within >= found.share_at_worst_pose
        groups = {"parameter": len(plan.names), "part": len({p.part for p in plan.parameters}), "entry": 2}[by]
        assert len(np.unique(found.factor)) <= groups


def test_more_freedom_gives_looser_tolerances(make_plan):
    entry = ErrorEntry(parameters=("alpha_e*_*", "theta_e*_*"), distribution="normal", std_mrad=0.2)
    plan = make_plan(errors=[entry])
    looseness = {
        by: np.log(allocate_tolerances(plan, Allocation(by=by, machines=1)).factor).sum()
        for by in ("entry", "part", "parameter")
    }
    assert looseness["entry"] < looseness["part"] < looseness["parameter"]


def test_correlated_errors_do_not_get_factors_of_their_own(plan):
    with pytest.raises(BadInputError, match="use 'by: part'"):
        allocate_tolerances(plan, Allocation(by="parameter"))


def test_small_errors_scatter_as_the_transfer_matrix_says(make_plan):
    entry = ErrorEntry(
        parameters=("*_e?_*", "drive.*"), distribution="normal", std_mm=0.005, std_mrad=0.005, correlation=0.3
    )
    plan = make_plan(errors=[entry], samples=6000)
    moved = plan.moved(plan.draws.values(0, 6000), plan.poses)
    std = np.array([margin.std for margin in plan.draws.margins])
    one_group = [0] * len(std)
    transfer = transfer_matrices(plan, plan.poses)[:, :3]
    expected = group_covariances(transfer, std, plan.draws.shared, plan.draws.parts, one_group)[:, 0]
    assert (moved.status == 0).all()
    for pose in range(len(plan.poses)):
        found = np.cov(moved.displacement[:, pose, 0].T)
        root = np.linalg.cholesky(expected[pose])
        whitened = np.linalg.solve(root, np.linalg.solve(root, found).T)
        assert np.abs(whitened - np.eye(3)).max() < 0.08
