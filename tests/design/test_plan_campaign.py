"""The plan as a function of the library."""

import pytest

from pouring_robot import BadInputError, PlanRequest, Robot, plan_campaign
from pouring_robot.campaign.plan import read_plan
from pouring_robot.design.planning import Planner, compare_with_random
from pouring_robot.design.result import plot
from tests.support import ROOT


def test_a_plan_is_as_large_as_asked(drawing):
    plan = plan_campaign(drawing, PlanRequest(poses=12, parameters=("drives",), candidates=200, starts=1))
    assert len(plan.poses) == 12


def test_what_does_not_exist_is_refused(drawing):
    with pytest.raises(BadInputError, match="no parameter"):
        plan_campaign(drawing, PlanRequest(parameters=("nothing",)))
    with pytest.raises(BadInputError, match=r"give a Robot, as load_robot and .* not a str"):
        plan_campaign("robot.yaml")


def test_another_robot_is_planned_by_its_drives(tmp_path):
    """Better than random poses, inside the limits, read back as planned, under payloads that its drives yield to."""
    robot = Robot.load(ROOT / "examples" / "robots" / "delta" / "robot.yaml")
    planner = Planner(
        robot, PlanRequest(poses=12, parameters=("drives",), loads_kg=(0.0, 1.5), candidates=300, starts=2)
    )
    plan = planner.plan()
    assert [p.name for p in plan.parameters if p.kind == "compliance"] == [
        f"compliance.arm{k}_drive" for k in (1, 2, 3)
    ]
    path = plan.save(tmp_path / "p.csv")
    with pytest.raises(BadInputError, match=r"as \.csv, not as \.xlsx"):
        plan.save(tmp_path / "p.xlsx")
    read = read_plan(path, robot)
    assert read.drives == pytest.approx(plan.poses, abs=1e-12)
    assert set(read.conditions["payload"]) == {0.0, 1.5}
    assert compare_with_random(planner, plan, 5).ratios[0] < 1.0
    limits = robot.nominal_solver.mechanism.joint_limits()["arm1_drive"]
    assert plan.poses.min() >= limits[0] and plan.poses.max() <= limits[1]
    assert plan.figures()["ladle"]["frame"] == robot.model.definition.loops.working_frame
    assert plot(plan).startswith(b"\x89PNG")
    with pytest.raises(BadInputError, match="pouring robot only"):
        Planner(robot, PlanRequest(leg_degC=(20.0, 100.0)))
