"""How often an answer is put into the robot, and what it is settled beside."""

import pytest

from pouring_robot.diagnosis.state import _goes_on


@pytest.mark.parametrize(
    ("moves", "on"),
    [
        ([], True),
        ([0.5], True),
        ([0.009], False),  # it stays
        ([0.5, 0.4, 0.6, 0.3, 0.5], True),  # nobody knows yet
        ([0.5, 0.4, 0.6, 0.3, 0.5, 0.26], False),  # to and fro
        ([0.5, 0.4, 0.6, 0.3, 0.5, 0.24], True),  # half as far: it may stay
        ([0.5 / 2**k for k in range(5)], True),
        ([0.8**k for k in range(9)], True),  # slowly: a third in five steps
        ([0.9**k for k in range(6)], False),
        ([0.8**k for k in range(10)], False),  # as many as are allowed
    ],
)
def test_an_answer_is_put_in_while_that_brings_it_nearer(moves, on):
    assert _goes_on(moves, 10, 0.01) == on


def test_an_answer_that_was_settled_beside_its_own_forms_is_settled_beside_all(hot):
    found = hot.hypothesis
    assert found.problem.known > {*found.effects}
    again = found.settled()
    assert (again.scales, again.levels) == (found.scales, found.levels)
