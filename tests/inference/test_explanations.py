"""A problem with free unknowns, and the smaller problem that is equal to it."""

import numpy as np
import pytest

from pouring_robot.inference.explanations import Background, Problem
from pouring_robot.inference.hypotheses import Hypothesis
from pouring_robot.inference.search import search
from tests.inference.problems import ROWS, explanation, library, log_density, planted, problem


@pytest.fixture
def parts(rng):
    """Three free unknowns, a background and eight effects; effects 1 and 2 are at work."""
    items = library(rng)
    free = rng.normal(size=(ROWS, 3)) * np.array([1e-6, 1.0, 1e6])
    backgrounds = (Background("small", 0.3 * rng.normal(size=(ROWS, 6))),)
    residual = planted(rng, [items[2], items[4]], [3.0, 2.0]) + free @ np.array([4e6, 7.0, -3e-6])
    return residual, free, backgrounds, items


def test_free_unknowns_are_taken_out_of_everything(parts):
    residual, free, backgrounds, items = parts
    built = Problem.build(residual, free, backgrounds, items)
    assert built.nuisance.axes.shape == (ROWS, 3)
    np.testing.assert_allclose(built.nuisance.axes.T @ built.nuisance.axes, np.eye(3), atol=1e-13)
    unit = free / np.linalg.norm(free, axis=0)
    for values in (built.residual, *(b.columns for b in built.backgrounds), *(e.columns for e in built.explanations)):
        np.testing.assert_allclose(unit.T @ values, 0.0, atol=1e-12)
    left = residual - unit @ np.linalg.lstsq(unit, residual, rcond=None)[0]
    np.testing.assert_allclose(built.residual, left, atol=1e-9)


def test_what_free_unknowns_do_cannot_be_seen(parts, rng):
    residual, free, backgrounds, items = parts
    built = Problem.build(residual, free, backgrounds, items)
    moved = Problem.build(
        residual + free @ (rng.normal(size=3) / np.linalg.norm(free, axis=0)), free, backgrounds, items
    )
    np.testing.assert_allclose(moved.residual, built.residual, atol=1e-9)


def test_free_unknowns_are_coefficients_of_boundless_prior(parts):
    """Evidence beside free unknowns is that of densities in which they have a wide prior, whichever is compared."""
    residual, free, _, items = parts
    wide = 1e4 * free / np.linalg.norm(free, axis=0)
    bare = Hypothesis.nothing(Problem.build(residual, free, (), items))
    for item in items[:4]:
        scale = 2.0
        found = bare.problem.explanations[items.index(item)]
        hypothesis = Hypothesis(bare.problem, (found,), (scale,), ())
        ratio = -0.5 * (hypothesis.misfit() + hypothesis.everything.log_determinant - bare.misfit())
        expected = log_density(residual, wide, scale * item.columns) - log_density(residual, wide)
        assert ratio == pytest.approx(expected, abs=1e-3)


def test_free_columns_that_repeat_or_vanish_count_once(rng):
    free = rng.normal(size=(20, 2))
    residual = rng.normal(size=20)
    once = problem(residual, [], free=free)
    again = problem(residual, [], free=np.hstack([free, free @ np.ones((2, 1)), np.zeros((20, 1))]))
    assert again.nuisance.axes.shape == (20, 2)
    np.testing.assert_allclose(again.residual, once.residual, atol=1e-12)


def test_compressed_problem_is_smaller_and_equal(rng):
    """Evidence of every hypothesis differs from that of nothing by the same amount; so does the misfit."""
    items = library(rng, rows=300)
    backgrounds = (Background("small", 0.3 * rng.normal(size=(300, 6))),)
    whole = problem(planted(rng, [items[2], items[5]], [2.0, 1.0]), items, backgrounds, rng.normal(size=(300, 4)))
    small = whole.compressed()
    assert len(small.residual) < 50
    empty = [Hypothesis(p, (), (), (0,)) for p in (whole, small)]
    for chosen, level in (((), 2), ((0,), 0), ((2, 5), 1), ((2, 5, 8), 3)):
        both = []
        for p, nothing in zip((whole, small), empty, strict=True):
            hypothesis = Hypothesis(p, tuple(p.explanations[k] for k in chosen), (1.5,) * len(chosen), (level,))
            both.append((hypothesis.log_evidence - nothing.log_evidence, hypothesis.misfit()))
        assert both[0] == pytest.approx(both[1], rel=1e-9, abs=1e-9)


def test_search_finds_the_same_in_the_compressed_problem(parts):
    whole = Problem.build(*parts)
    one, other = search(whole), search(whole.compressed())
    assert [i.key for i in one.items] == [i.key for i in other.items]
    assert one.scales == pytest.approx(other.scales)
    assert {"effect 1", "effect 2"} == set(one.effects)


def test_compressing_twice_changes_nothing_more(parts):
    once = Problem.build(*parts).compressed()
    twice = once.compressed()
    assert twice.constant == pytest.approx(once.constant, abs=1e-9)
    assert len(twice.residual) == len(once.residual)


def test_rank_is_that_of_all_columns(rng):
    columns = rng.normal(size=(40, 3))
    items = [
        explanation("a", columns),
        explanation("b", columns @ rng.normal(size=(3, 3))),
        explanation("c", 1e-7 * columns),
    ]
    assert len(problem(rng.normal(size=40), items).compressed().residual) == 3


def test_an_effect_that_free_unknowns_absorb_is_worth_nothing(rng):
    free = rng.normal(size=(30, 2))
    hidden = explanation("hidden", free @ rng.normal(size=(2, 1)))
    residual = 20.0 * hidden.columns[:, 0] + rng.normal(size=30)
    built = problem(residual, [hidden], free=free)
    assert Hypothesis.nothing(built).candidate_bayes_factor(built.explanations[0]).evidence == 0.0
    assert search(built).items == ()
