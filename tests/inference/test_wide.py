"""A wide explanation taken out of the problem first: the same numbers as with everything at once."""

import numpy as np
import pytest

from pouring_robot.inference import hypotheses
from pouring_robot.inference.evidence import Scale
from pouring_robot.inference.explanations import Explanation, Problem, Workmanship
from pouring_robot.inference.hypotheses import Hypothesis

WIDE, ROWS = 40, 130


@pytest.fixture
def problem():
    rng = np.random.default_rng(12)
    wide, narrow, other = (3.0 * rng.normal(size=(ROWS, k)) for k in (WIDE, 4, 3))
    residual = wide @ rng.normal(size=WIDE) + narrow @ rng.normal(size=4) + rng.normal(size=ROWS)

    def item(name, columns):
        return Explanation(name, "form", columns, np.ones(columns.shape[1], dtype=bool))

    background = Workmanship("small", 0.1 * rng.normal(size=(ROWS, 5)))
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
