"""What an answer that is put into the robot is settled beside."""


def test_an_answer_that_was_settled_beside_its_own_forms_is_settled_beside_all(hot):
    found = hot.hypothesis
    assert found.problem.known > {*found.effects}
    again = found.settled()
    assert (again.scales, again.levels) == (found.scales, found.levels)
