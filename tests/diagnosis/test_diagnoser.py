"""What an answer that is put into the robot is settled beside, and what it is held against."""

import pytest


def test_an_answer_that_was_settled_beside_its_own_forms_is_settled_beside_all(hot):
    found = hot.hypothesis
    assert found.problem.known > {*found.effects}
    again = found.settled()
    assert (again.scales, again.levels) == (found.scales, found.levels)


def test_the_gap_is_that_of_the_given_model_wherever_the_search_has_come(hot):
    diagnoser = hot.diagnoser
    rest = diagnoser.problem_at(diagnoser.at_rest())
    assert hot.hypothesis.problem.given_squared == pytest.approx(rest.gram.squared, rel=1e-9)
    assert hot.hypothesis.problem.gram.squared != pytest.approx(rest.gram.squared, rel=1e-9)
