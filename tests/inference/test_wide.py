"""A wide explanation taken out of the problem first: the same numbers as with everything at once."""

import numpy as np
import pytest

from pouring_robot.inference import hypotheses
from pouring_robot.inference.decision import Cause, Thresholds, _above
from pouring_robot.inference.evidence import Scale
from pouring_robot.inference.explanations import Background, Explanation, Problem
from pouring_robot.inference.hypotheses import Hypothesis

WIDE, ROWS = 40, 130


@pytest.fixture
def problem():
    rng = np.random.default_rng(12)
    wide, narrow, other = (3.0 * rng.normal(size=(ROWS, k)) for k in (WIDE, 4, 3))
    residual = wide @ rng.normal(size=WIDE) + narrow @ rng.normal(size=4) + rng.normal(size=ROWS)

    def item(name, columns):
        return Explanation(name, "form", columns, np.ones(columns.shape[1], dtype=bool))

    background = Background("small", 0.1 * rng.normal(size=(ROWS, 5)))
    items = (item("wide", wide), item("narrow", narrow), item("other", other))
    return Problem.build(residual, rng.normal(size=(ROWS, 6)), (background,), items)


def told(problem):
    """Return what a hypothesis with the wide explanation says of itself and of what could be added."""
    wide, narrow, other = problem.explanations
    both = Hypothesis(problem, (wide, narrow), (Scale(0.9), Scale(1.3)), (1,))
    factors = [both.item_bayes_factor(0), both.item_bayes_factor(1), both.without((1,)).candidate_bayes_factor(other)]
    factors.append(both.candidate_bayes_factor(other))
    return [both.log_evidence, *(value for f in factors for value in (f.evidence, f.scale.main, f.peak))]


def test_what_is_taken_out_first_changes_nothing(problem, monkeypatch):
    monkeypatch.setattr(hypotheses, "_WIDE", WIDE - 1)
    first = told(problem)
    problem.worked_out.clear()
    monkeypatch.setattr(hypotheses, "_WIDE", 10 * WIDE)
    assert first == pytest.approx(told(problem), rel=1e-9, abs=1e-7)


def cause(name, evidence):
    return Cause(name, "form", (0,), (), 1.0, evidence, 1.0)


def test_a_small_cause_must_add_more_than_what_nobody_explains():
    """Added: the root of twice the evidence an equation. 0.3 beside 4 is a cause while less than 0.3 is left."""
    large, small = cause("large", 8000.0), cause("small", 45.0)
    for left, kept in ((0.2, [large, small]), (0.4, [large])):
        assert _above([large, small], left, 1000, Thresholds()) == kept


def test_the_largest_cause_stays_and_so_does_one_like_it():
    """However much is left over: only what is far smaller than the largest one can be its form."""
    first, second = cause("first", 80.0), cause("second", 8.0)
    assert _above([first], 5.0, 1000, Thresholds()) == [first]
    assert _above([first, second], 5.0, 1000, Thresholds()) == [first, second]
