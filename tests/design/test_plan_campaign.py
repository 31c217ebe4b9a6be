"""The plan as a function of the library."""

import pytest

from pouring_robot import BadInputError, PlanRequest, plan_campaign


def test_a_plan_is_as_large_as_asked(drawing):
    plan = plan_campaign(drawing, PlanRequest(poses=12, parameters=("drives",), candidates=200, starts=1))
    assert len(plan.poses) == 12


def test_what_does_not_exist_is_refused(drawing):
    with pytest.raises(BadInputError, match="no parameter"):
        plan_campaign(drawing, PlanRequest(parameters=("nothing",)))
