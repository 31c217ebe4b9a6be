"""Hypotheses: their evidence against densities, their parts against the conditional mean of a Gaussian."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from scipy.special import logsumexp

from pouring_robot.inference.evidence import Scale
from pouring_robot.inference.hypotheses import Hypothesis
from pouring_robot.inference.priors import LOG_SCALES, WORKMANSHIP_LEVELS, log_prior_of_levels
from pouring_robot.inference.problem import Explanation, Workmanship
from pouring_robot.inference.search import impossible_effects, search
from pouring_robot.inference.thresholds import Thresholds
from tests.inference.problems import explanation, library, log_density, planted, problem

TWO_PI = np.log(2.0 * np.pi)


@pytest.fixture
def small(rng):
    """Two items and workmanship at fixed scales on twelve rows."""
    items = [explanation("a", rng.normal(size=(12, 2))), explanation("b", rng.normal(size=(12, 1)))]
    workmanship = (Workmanship("small", 16.0 * rng.normal(size=(12, 3))),)
    built = problem(2.0 * rng.normal(size=12), items, workmanship)
    return Hypothesis(built, built.explanations, (Scale(1.5), Scale(0.7)), (5,))


def scaled(hypothesis):
    """Return the columns of everything fitted, by group, times the standard deviations of their coefficients."""
    return [own.columns * weights for own, weights in zip(hypothesis.fitted, hypothesis.weights(), strict=True)]


def covariance(hypothesis):
    columns = np.hstack(scaled(hypothesis))
    return np.eye(len(columns)) + columns @ columns.T


def test_evidence_of_one_item_is_the_density_averaged_over_scales(rng):
    item = explanation("a", rng.normal(size=(10, 2)))
    residual = planted(rng, [item], [2.0])
    values = [log_density(residual, s * item.columns) for s in np.exp(LOG_SCALES)]
    settled = Hypothesis(problem(residual, [item]), (item,), (Scale(1.0),), ()).settled()
    expected = logsumexp(values) - np.log(len(values)) + 5.0 * TWO_PI
    assert settled.log_evidence == pytest.approx(expected, abs=1e-9)
    assert settled.scales[0].main == pytest.approx(np.exp(LOG_SCALES[int(np.argmax(values))]))


def test_candidates_come_best_first_and_no_more_are_evaluated_than_asked_for(rng):
    items = library(rng)
    hypothesis = Hypothesis.nothing(problem(planted(rng, items[4:5], [3.0]), items))
    best = next(iter(hypothesis.ranked(items)))
    weighed = [item for item in items if item.key in hypothesis._known]
    assert 1 <= len(weighed) < len(items)
    expected = sorted(((hypothesis.candidate_bayes_factor(item), item) for item in items), key=lambda w: -w[0].evidence)
    assert best == expected[0]
    again = Hypothesis.nothing(problem(hypothesis.problem.residual, items))
    assert [item.key for _, item in again.ranked(items)] == [item.key for _, item in expected]


@pytest.mark.parametrize("sizes", [(2.0, 2.0), (5.0, 1.0), (1.0, 0.5)])
def test_evidence_of_two_items_is_near_the_double_average(rng, sizes):
    """The scales are averaged one at a time, the other at its most probable; the double average is by brute force."""
    items = [explanation("a", rng.normal(size=(20, 2))), explanation("b", rng.normal(size=(20, 2)))]
    residual = planted(rng, items, sizes)
    grid = np.exp(LOG_SCALES)
    values = [log_density(residual, s * items[0].columns, t * items[1].columns) for s, t in product(grid, grid)]
    expected = logsumexp(values) - 2.0 * np.log(len(grid)) + 10.0 * TWO_PI
    settled = Hypothesis(problem(residual, items), tuple(items), (Scale(1.0), Scale(1.0)), ()).settled()
    assert settled.log_evidence == pytest.approx(expected, abs=1.0)


def test_order_of_items_does_not_matter(rng):
    items = library(rng)[:6:2]
    built = problem(planted(rng, items, [2.0, 2.0, 1.0]), items)
    one = Hypothesis(built, tuple(items), (Scale(1.0),) * 3, ()).settled()
    other = Hypothesis(built, tuple(items[::-1]), (Scale(1.0),) * 3, ()).settled()
    assert one.log_evidence == pytest.approx(other.log_evidence, abs=0.3)


def test_parts_are_the_conditional_mean(small):
    """Jointly Gaussian part and residual r: the mean of the part given r is its covariance times C⁻¹ r."""
    pull = np.linalg.solve(covariance(small), small.problem.residual)
    for index, item in enumerate(small.items):
        own = small.scales[index].main ** 2 * item.columns @ item.columns.T
        np.testing.assert_allclose(small.part(index), own @ pull, atol=1e-12)
        assert small.squared_size(index) == pytest.approx(((own @ pull) ** 2).sum())
    assert small.squared_size(0, 1) == pytest.approx(((small.part(0) + small.part(1)) ** 2).sum())
    usual = WORKMANSHIP_LEVELS[5] * small.problem.workmanship[0].columns
    np.testing.assert_allclose(small.workmanship_part(0), usual @ usual.T @ pull, atol=1e-12)
    assert small.workmanship_squared_size == pytest.approx(((usual @ usual.T @ pull) ** 2).sum())


def test_parts_and_the_remaining_residual_add_up_to_the_residual(small):
    total = small.part(0) + small.part(1) + small.workmanship_part(0)
    np.testing.assert_allclose(
        small.problem.residual - total, np.linalg.solve(covariance(small), small.problem.residual), atol=1e-12
    )


def test_coefficients_make_the_parts(small):
    mean, spread = small.coefficients()
    groups = scaled(small)
    assert [g.shape[1] for g in groups] == [3, 2, 1]
    np.testing.assert_allclose(groups[0] @ mean[:3], small.workmanship_part(0), atol=1e-12)
    np.testing.assert_allclose(groups[1] @ mean[3:5], small.part(0), atol=1e-12)
    np.testing.assert_allclose(groups[2] @ mean[5:], small.part(1), atol=1e-12)
    columns = np.hstack(groups)
    np.testing.assert_allclose(spread, np.linalg.inv(columns.T @ columns + np.eye(6)), atol=1e-12)


def test_misfit_and_spent_are_those_of_the_covariance(small):
    inverse = np.linalg.inv(covariance(small))
    assert small.everything.squared == pytest.approx(
        small.problem.residual @ inverse @ small.problem.residual, rel=1e-12
    )
    np.testing.assert_allclose(small.freedom, np.diag(inverse), rtol=1e-12)


def test_the_expected_misfit_of_a_true_hypothesis_is_the_number_of_rows(rng):
    item = explanation("a", rng.normal(size=(40, 3)))
    found = []
    for _ in range(200):
        residual = rng.normal(size=40) + 1.5 * item.columns @ rng.normal(size=3)
        found.append(Hypothesis(problem(residual, [item]), (item,), (Scale(1.5),), ()).everything.squared)
    assert np.mean(found) == pytest.approx(40.0, abs=4.0 * np.sqrt(2.0 * 40.0 / 200.0))


def test_what_other_columns_explain_is_regularised_least_squares_at_the_widest_scale(small, rng):
    """With columns of any length, one of them zero and two of them equal."""
    columns = rng.normal(size=(12, 3)) @ np.diag([1e-5, 1.0, 1e5])
    columns = np.hstack([columns, columns[:, :1], np.zeros((12, 1))])
    other = Explanation("other", "plain", columns, np.array([True, True, False, True, True]))
    part = small.part(0) + small.part(1)
    main = np.vstack([np.exp(LOG_SCALES[-1]) * columns[:, other.main], np.eye(4)])
    wanted = np.concatenate([part, np.zeros(4)])
    left = wanted - main @ np.linalg.lstsq(main, wanted, rcond=None)[0]
    seen = replace(small, problem=small.problem.and_also([other]))
    assert seen.explained_by(other, (0, 1)) == pytest.approx(part @ part - left @ left, rel=1e-9)


def test_main_share_distinguishes_an_effect_from_its_shape(rng):
    columns = rng.normal(size=(60, 3))
    item = Explanation("a", "shaped", columns, np.array([True, False, False]))
    shares = []
    for truth in ([3.0, 0.0, 0.0], [0.0, 3.0, 0.0]):
        residual = columns @ np.array(truth) + 0.1 * rng.normal(size=60)
        shares.append(Hypothesis(problem(residual, [item]), (item,), (Scale(1.0),), ()).main_share(0))
    assert shares[0] > 0.95
    assert shares[1] < 0.05


@pytest.mark.parametrize(("truth", "share"), [([3.0, 2.0], 1.0), ([-3.0, 2.0], 0.3), ([-3.0, -2.0], 0.0)])
def test_coefficients_outside_their_bounds_have_no_share(rng, truth, share):
    """Two coefficients that cannot be negative: a part with a wrong sign is not made by the effect."""
    columns, _ = np.linalg.qr(rng.normal(size=(60, 2)))
    columns *= 20.0
    bounds = np.array([[0.0, np.inf], [0.0, np.inf]])
    item = Explanation("a", "pair", columns, np.ones(2, dtype=bool), bounds=bounds)
    residual = columns @ np.array(truth)
    found = Hypothesis(problem(residual, [item]), (item,), (Scale(3.0),), ())
    assert found.main_share(0) == pytest.approx(share, abs=0.02)
    assert found.main_share(0, bounded=False) == pytest.approx(1.0, abs=0.01)
    alone = search(problem(residual, [item]))
    assert (alone.effects, impossible_effects(alone, Thresholds())) == ((("a",), ()) if share > 0.5 else ((), ("a",)))


def test_a_form_outside_its_bounds_does_not_bar_another_form_within_its_bounds(rng):
    """The shape of one form, whose main parameter would be negative, is among the main parameters of the other."""
    true, aside, *more = 20.0 * np.linalg.qr(rng.normal(size=(60, 6)))[0].T
    bent = np.column_stack([-0.7 * true - 0.7 * aside, true])
    items = [
        Explanation("a", "bent", bent, np.array([True, False]), bounds=np.array([[0.0, np.inf], [-np.inf, np.inf]])),
        explanation("a", np.column_stack([true, *more]), "whole"),
    ]
    given = problem(3.0 * true, items)
    alone = Hypothesis.nothing(given)
    worth = [alone.candidate_bayes_factor(item).evidence for item in items]
    assert worth[0] > worth[1] > 100.0
    assert search(given).keys == {("a", "whole")}


def test_settling_finds_the_best_scales_and_levels(rng):
    """No neighbour of a settled hypothesis on the grids of scales and levels is more probable."""
    items = library(rng)[:4:2]
    workmanship = (Workmanship("small", 64.0 * rng.normal(size=(60, 8))),)
    residual = planted(rng, items, [2.0, 3.0]) + workmanship[0].columns @ rng.normal(size=8) / 64.0
    settled = Hypothesis(problem(residual, items, workmanship), tuple(items), (Scale(1.0), Scale(1.0)), (0,)).settled()

    def density(scales, level):
        groups = [s * item.columns for s, item in zip(scales, items, strict=True)]
        return log_density(residual, WORKMANSHIP_LEVELS[level] * workmanship[0].columns, *groups)

    here = density([scale.main for scale in settled.scales], settled.levels[0])
    step = np.exp(LOG_SCALES[1] - LOG_SCALES[0])
    for index, factor in product(range(2), (step, 1.0 / step)):
        scales = [scale.main for scale in settled.scales]
        scales[index] *= factor
        assert density(scales, settled.levels[0]) <= here + 1e-9
    for level in {max(settled.levels[0] - 1, 0), min(settled.levels[0] + 1, len(WORKMANSHIP_LEVELS) - 1)}:
        assert density([scale.main for scale in settled.scales], level) <= here + 1e-9


def test_workmanship_is_found_only_where_there_is_any(rng):
    workmanship = (
        Workmanship("there", 64.0 * rng.normal(size=(60, 8))),
        Workmanship("not there", 64.0 * rng.normal(size=(60, 8))),
    )
    residual = rng.normal(size=60) + workmanship[0].columns @ rng.normal(size=8) / 64.0
    found = Hypothesis.nothing(problem(residual, [], workmanship))
    assert WORKMANSHIP_LEVELS[found.levels[0]] >= 1.0 / 128.0
    assert WORKMANSHIP_LEVELS[found.levels[1]] <= 1.0 / 64.0


@pytest.mark.parametrize(
    ("most", "coarsest"), [(1 / 64, 1 / 64), (0.9 / 64, 1 / 64), (1.1 / 64, 1 / 32), (1e-4, 1 / 512)]
)
def test_workmanship_is_no_coarser_than_its_known_size(rng, most, coarsest):
    """Errors of an eighth: levels are tried up to the first that is not below the known size."""
    columns = 64.0 * rng.normal(size=(60, 8))
    kinds = Workmanship("known", columns, most), Workmanship("not there", 64.0 * rng.normal(size=(60, 8)))
    residual = rng.normal(size=60) + columns @ rng.normal(size=8) / 8.0
    found = Hypothesis.nothing(problem(residual, [], kinds))
    assert WORKMANSHIP_LEVELS[found.levels[0]] == coarsest
    assert WORKMANSHIP_LEVELS[found.with_levels_of((0,)).levels[0]] == coarsest
    free = Hypothesis.nothing(problem(residual, [], (Workmanship("free", columns), kinds[1])))
    assert WORKMANSHIP_LEVELS[free.levels[0]] >= 1 / 16
    assert free.coarsely_made
    assert np.ptp(free.levels) == 1  # all kinds of errors of a machine are of about the same level


def test_on_a_machine_known_to_be_finer_than_usual_the_coarsest_level_is_the_most_probable():
    likely, finer = (log_prior_of_levels((level,), (2,)) for level in (2, 1))
    assert likely == 0.0 > finer


def test_changing_items(rng):
    items = library(rng)[:6:2]
    built = problem(planted(rng, items, [3.0, 3.0, 3.0]), items)
    nothing = Hypothesis.nothing(built)
    grown = nothing.with_item(items[0], Scale(1.0)).with_item(items[1], Scale(1.0))
    assert grown.effects == ("effect 0", "effect 1")
    assert grown.without_items((0,)).effects == ("effect 1",)
    assert grown.with_replaced(0, items[2], Scale(1.0)).effects == ("effect 2", "effect 1")
    worth = nothing.candidate_bayes_factor(items[0]).evidence
    assert nothing.with_item(items[0], Scale(1.0)).log_evidence - nothing.log_evidence == pytest.approx(worth, abs=1e-9)


def test_the_evidence_of_several_items_together(rng):
    """All items have the evidence of the hypothesis against the empty one; one item alone has its gain."""
    items = library(rng)[:6:2]
    built = problem(planted(rng, items[:2], [3.0, 2.0]), items)
    nothing = Hypothesis.nothing(built)
    one = Hypothesis(built, tuple(items[:1]), (Scale(1.0),), ()).settled()
    assert one.worth((0,)) == pytest.approx(one.item_bayes_factor(0).evidence, abs=1e-9)
    both = one.with_item(items[1], Scale(1.0))
    assert both.worth((0, 1)) == pytest.approx(both.log_evidence - nothing.log_evidence, abs=1e-9)
    assert both.worth(()) == 0.0
    assert both.without_items((0, 1)).keys == frozenset()


def test_only_some_kinds_of_workmanship(rng):
    workmanship = (
        Workmanship("there", 64.0 * rng.normal(size=(60, 8))),
        Workmanship("there too", 64.0 * rng.normal(size=(60, 8))),
    )
    residual = rng.normal(size=60) + sum(b.columns @ rng.normal(size=8) for b in workmanship) / 64.0
    settled = Hypothesis.nothing(problem(residual, [], workmanship))
    assert min(settled.levels) > 0
    alone = settled.with_levels_of((1,))
    assert alone.levels[0] == 0
    densities = [log_density(residual, level * workmanship[1].columns) for level in WORKMANSHIP_LEVELS]
    assert alone.levels[1] == int(np.argmax(densities))


def test_items_that_are_no_causes_are_not_among_the_causes(rng):
    items = (explanation("a", rng.normal(size=(20, 1))), explanation("b", rng.normal(size=(20, 1)), cause=False))
    hypothesis = Hypothesis(problem(rng.normal(size=20), items), items, (Scale(1.0), Scale(1.0)), ())
    assert [item.effect for item in hypothesis.items if item.cause] == ["a"]
    assert hypothesis.effects == ("a", "b")


def test_a_column_that_free_unknowns_almost_absorb_explains_nothing_of_another_effect(rng):
    """A millionth of it remains and resembles the effect: ten times the usual size makes a hundredth of the noise."""
    size = 1e3
    free, course = np.linalg.qr(rng.normal(size=(40, 2)))[0].T
    zeros = size * (free + 1e-6 * course)
    effects = [explanation("drift", 100.0 * course[:, None]), explanation("zero", zeros[:, None])]
    found = Hypothesis.nothing(problem(40.0 * course, effects, free=free[:, None]))
    drift, zero = found.problem.explanations
    named = found.with_item(drift, Scale(1.0))
    assert named.explained_by(drift, (0,)) == pytest.approx(named.squared_size(0), rel=1e-4)
    assert named.explained_by(zero, (0,)) < 1.0


def test_an_equation_is_judged_by_what_the_others_predict_for_it(rng):
    """Against a Gaussian's conditional mean and variance; an equation that alone shows a free unknown is not judged."""
    free = np.column_stack([np.ones(12), np.eye(12)[0]])
    items = [explanation("a", rng.normal(size=(12, 2))), explanation("b", rng.normal(size=(12, 1)))]
    built = problem(2.0 * rng.normal(size=12), items, free=free)
    hypothesis = Hypothesis(built, built.explanations, (Scale(1.5), Scale(0.7)), ())
    whole = covariance(hypothesis) + 1e6 * free @ free.T
    for k, found in enumerate(hypothesis.studentised_residual[1:], 1):
        others = np.delete(np.arange(12), k)
        pulled = np.linalg.solve(whole[np.ix_(others, others)], whole[others, k])
        residual = built.residual[k] - pulled @ built.residual[others]
        assert found == pytest.approx(residual / np.sqrt(whole[k, k] - pulled @ whole[others, k]), rel=1e-4)
    assert abs(hypothesis.studentised_residual[0]) < 1e-6
