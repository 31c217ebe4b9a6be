"""Distributions, correlation within a part, Saltelli's scheme: the draws are as specified in the file."""

import itertools

import numpy as np
import pytest
import scipy.stats

from pouring_robot.sweeps import ErrorEntry

COUNT = 20_000
ENTRIES = [
    {"parameters": ["alpha_e1_01"], "distribution": "uniform", "half_width_mrad": 2.0},
    {"parameters": ["alpha_e1_12"], "distribution": "normal", "std_mrad": 0.5},
    {"parameters": ["alpha_e1_23"], "distribution": "truncated_normal", "std_mrad": 0.5, "limit_mrad": 0.6},
    {"parameters": ["a_e1_01"], "distribution": "uniform", "half_width_mm": 0.2},
]


@pytest.fixture(scope="module")
def values():
    from pouring_robot.sweeps import SweepConfig, SweepPlan
    from tests.sweeps.sweep_files import content

    plan = SweepPlan(SweepConfig.model_validate(content(errors=ENTRIES, samples=COUNT)))
    return plan.draws.values(0, COUNT)


@pytest.mark.parametrize(
    ("column", "expected"),
    [
        (0, scipy.stats.uniform(-2e-3, 4e-3)),
        (1, scipy.stats.norm(0, 0.5e-3)),
        (2, scipy.stats.truncnorm(-1.2, 1.2, scale=0.5e-3)),
        (3, scipy.stats.uniform(-2e-4, 4e-4)),
    ],
)
def test_distributions(values, column, expected):
    assert scipy.stats.kstest(values[:, column], expected.cdf).pvalue > 1e-3


def test_margins_know_their_deviation(make_plan):
    draws = make_plan(errors=ENTRIES).draws
    assert np.allclose([m.tolerance for m in draws.margins], [2e-3, 1.5e-3, 0.6e-3, 2e-4])
    truncated = 0.5e-3 * scipy.stats.truncnorm.std(-1.2, 1.2)
    assert np.allclose([m.std for m in draws.margins], [2e-3 / 3**0.5, 0.5e-3, truncated, 2e-4 / 3**0.5])


def test_a_normal_distribution_cut_short_is_a_uniform_one(make_plan):
    entry = ENTRIES[2] | {"limit_mrad": 1e-9}
    assert np.isclose(make_plan(errors=[entry]).draws.margins[0].std, 1e-12 / 3**0.5, rtol=1e-9, atol=0)


def test_independent_errors_are_independent(values):
    off = np.corrcoef(values.T)[np.triu_indices(values.shape[1], 1)]
    assert np.abs(off).max() < 4.0 / COUNT**0.5


@pytest.mark.parametrize("kind", ["normal", "uniform"])
def test_correlation_is_within_a_part_and_nowhere_else(make_plan, kind):
    size = {"std_mrad": 1.0} if kind == "normal" else {"half_width_mrad": 1.0}
    entry = ErrorEntry(parameters=("alpha_e?_*", "theta_e1_*"), distribution=kind, correlation=0.6, **size)
    plan = make_plan(errors=[entry], samples=COUNT)
    found = np.corrcoef(plan.draws.values(0, COUNT).T)
    expected = 0.6 if kind == "normal" else 6 / np.pi * np.arcsin(0.3)
    for (i, p), (j, q) in itertools.combinations(enumerate(plan.parameters), 2):
        wanted = expected if p.part == q.part else 0.0
        assert abs(found[i, j] - wanted) < 5.0 / COUNT**0.5, (p.name, q.name)


def test_any_range_of_samples_gives_the_same_numbers(make_plan):
    for study, samples in (("monte_carlo", 700), ("sobol", 8)):
        entry = ErrorEntry(parameters=("alpha_e1_*", "a_e1_*"), half_width_mrad=1.0, half_width_mm=1.0)
        draws = make_plan(errors=[entry], study=study, samples=samples).draws
        whole = draws.values(0, draws.count)
        pieces = [draws.values(k, min(k + 37, draws.count)) for k in range(0, draws.count, 37)]
        assert np.array_equal(np.concatenate(pieces), whole)


def test_another_seed_gives_other_numbers(make_plan):
    first, second = (make_plan(seed=seed).draws.values(0, 5) for seed in (1, 2))
    assert not np.isclose(first, second).any()


def test_saltelli_rows_are_those_of_salib(make_plan):
    from SALib.sample import sobol

    draws = make_plan(errors=ENTRIES, study="sobol", samples=64).draws
    problem = {"num_vars": 4, "names": list("abcd"), "bounds": [[0.0, 1.0]] * 4}
    rows = sobol.sample(problem, 64, calc_second_order=False, seed=11)
    found = draws.values(0, draws.count)
    assert np.allclose(found[:, 0], (2 * rows[:, 0] - 1) * 2e-3, atol=1e-12)
    assert np.allclose(found[:, 1], scipy.stats.norm.ppf(rows[:, 1]) * 0.5e-3, atol=1e-12)
    assert np.allclose(found[:, 2], scipy.stats.truncnorm.ppf(rows[:, 2], -1.2, 1.2) * 0.5e-3, atol=1e-12)


def test_one_at_a_time_is_a_diagonal_of_tolerances(make_plan):
    draws = make_plan(errors=ENTRIES, study="one_at_a_time", samples=None).draws
    assert np.array_equal(draws.values(1, 3), np.diag([2e-3, 1.5e-3, 0.6e-3, 2e-4])[1:3])
