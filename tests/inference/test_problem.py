"""A problem with free unknowns."""

import numpy as np
import pytest

from pouring_robot.inference import evidence
from pouring_robot.inference.evidence import Scale
from pouring_robot.inference.hypotheses import Hypothesis
from pouring_robot.inference.problem import Problem, Workmanship
from pouring_robot.inference.search import search
from tests.inference.problems import ROWS, explanation, library, log_density, planted, problem


@pytest.fixture
def parts(rng):
    """Three free unknowns, workmanship and eight effects; effects 1 and 2 are at work."""
    items = library(rng)
    free = rng.normal(size=(ROWS, 3)) * np.array([1e-6, 1.0, 1e6])
    workmanship = (Workmanship("small", 0.3 * rng.normal(size=(ROWS, 6))),)
    residual = planted(rng, [items[2], items[4]], [3.0, 2.0]) + free @ np.array([4e6, 7.0, -3e-6])
    return residual, free, workmanship, items


def test_free_unknowns_are_projected_out_of_everything(parts):
    residual, free, workmanship, items = parts
    built = Problem.build(residual, free, workmanship, items)
    assert built.nuisance.axes.shape == (ROWS, 3)
    np.testing.assert_allclose(built.nuisance.axes.T @ built.nuisance.axes, np.eye(3), atol=1e-13)
    unit = free / np.linalg.norm(free, axis=0)
    for values in (built.residual, *(b.columns for b in built.workmanship), *(e.columns for e in built.explanations)):
        np.testing.assert_allclose(unit.T @ values, 0.0, atol=1e-12)
    left = residual - unit @ np.linalg.lstsq(unit, residual, rcond=None)[0]
    np.testing.assert_allclose(built.residual, left, atol=1e-9)


def test_many_equations_are_processed_in_blocks(parts, monkeypatch):
    whole = Problem.build(*parts)
    monkeypatch.setattr(evidence, "_EQUATIONS", 7)
    built = Problem.build(*parts)
    kept = np.arange(ROWS) % 3 == 0
    for one, other in zip(built.explanations, whole.explanations, strict=True):
        assert not isinstance(one.columns, np.ndarray)
        assert one.columns.shape == other.columns.shape
        np.testing.assert_allclose(one.columns[:], other.columns, atol=1e-12)
        np.testing.assert_allclose(one.columns[kept], other.columns[kept], atol=1e-12)
    np.testing.assert_allclose(built.gram.columns, whole.gram.columns, atol=1e-11)
    found, expected = search(built), search(whole)
    assert [item.key for item in found.items] == [item.key for item in expected.items]
    np.testing.assert_allclose(found.remainder, expected.remainder, atol=1e-9)


def test_an_effect_that_free_unknowns_absorb_cannot_be_detected(parts, rng):
    residual, free, workmanship, items = parts
    built = Problem.build(residual, free, workmanship, items)
    moved = Problem.build(
        residual + free @ (rng.normal(size=3) / np.linalg.norm(free, axis=0)), free, workmanship, items
    )
    np.testing.assert_allclose(moved.residual, built.residual, atol=1e-9)


def test_free_unknowns_are_coefficients_with_an_unbounded_prior(parts):
    """Evidence given free unknowns is that of densities in which they have a wide prior, for any pair compared."""
    residual, free, _, items = parts
    wide = 1e4 * free / np.linalg.norm(free, axis=0)
    bare = Hypothesis.nothing(Problem.build(residual, free, (), items))
    for item in items[:4]:
        scale = 2.0
        found = bare.problem.explanations[items.index(item)]
        hypothesis = Hypothesis(bare.problem, (found,), (Scale(scale),), ())
        ratio = hypothesis.everything.log_likelihood - bare.everything.log_likelihood
        expected = log_density(residual, wide, scale * item.columns) - log_density(residual, wide)
        assert ratio == pytest.approx(expected, abs=1e-3)


def test_free_columns_that_repeat_or_vanish_count_once(rng):
    free = rng.normal(size=(20, 2))
    residual = rng.normal(size=20)
    once = problem(residual, [], free=free)
    again = problem(residual, [], free=np.hstack([free, free @ np.ones((2, 1)), np.zeros((20, 1))]))
    assert again.nuisance.axes.shape == (20, 2)
    np.testing.assert_allclose(again.residual, once.residual, atol=1e-12)


def test_forms_of_an_effect_share_its_probability(parts):
    built = Problem.build(*parts)
    more = built.and_also([explanation("effect 0", built.explanations[1].columns, "third")])
    assert built.log_priors["effect 0"] == pytest.approx(np.log(1 / 2))
    assert more.log_priors["effect 0"] == pytest.approx(np.log(1 / 3))
    assert len(more.gram.projected) == len(built.gram.projected) + more.explanations[-1].columns.shape[1]


def test_an_effect_that_free_unknowns_absorb_has_no_evidence(rng):
    free = rng.normal(size=(30, 2))
    hidden = explanation("hidden", free @ rng.normal(size=(2, 1)))
    residual = 20.0 * hidden.columns[:, 0] + rng.normal(size=30)
    built = problem(residual, [hidden], free=free)
    assert Hypothesis.nothing(built).candidate_bayes_factor(built.explanations[0]).evidence == pytest.approx(
        0.0, abs=1e-9
    )
    assert search(built).items == ()
