"""The plan as a function of the library."""

import numpy as np
import pytest

from pouring_robot import BadInputError, PlanRequest, Robot, plan_campaign
from pouring_robot.campaign.plan import read_plan
from pouring_robot.design.plan_rows import PlannedConditions
from pouring_robot.design.planning import Planner, compare_with_random
from pouring_robot.design.result import plot
from pouring_robot.estimation.noise import NoiseLevel
from tests.support import ROOT, gantry_file


def test_a_plan_has_the_size_asked_for(drawing):
    plan = plan_campaign(drawing, PlanRequest(poses=12, parameters=("drives",), candidates=200, starts=1))
    assert len(plan.poses) == 12


def test_names_that_do_not_exist_are_refused(drawing):
    with pytest.raises(BadInputError, match="no parameter"):
        plan_campaign(drawing, PlanRequest(parameters=("nothing",)))
    with pytest.raises(BadInputError, match=r"give a Robot, as load_robot and .* not a str"):
        plan_campaign("robot.yaml")


def test_one_drive_alone_is_planned_and_drawn(tmp_path):
    """Of a slide only its backlash shows, by two sides of k of n poses: as from the difference of two means."""
    path = gantry_file(tmp_path)
    text = path.read_text(encoding="utf-8").replace("end_frame: z", "end_frame: x")
    path.write_text(f"{text.partition('drives:')[0]}drives: [{{joint: x_slide}}]\n", encoding="utf-8")
    n, k = 6, 2
    plan = plan_campaign(Robot.load(path), PlanRequest(poses=n, both_sides=k, candidates=60, starts=1))
    assert [p.name for p in plan.parameters] == ["backlash.x_slide"]
    assert plan.quality.parameter_std == pytest.approx(5e-5 * np.sqrt(1.0 / n + 1.0 / k))
    assert plot(plan).startswith(b"\x89PNG")
    for asked, words in (((), "name others, or all"), (("geometry",), "frames of tracker and target$")):
        with pytest.raises(BadInputError, match=words):
            plan_campaign(Robot.load(path), PlanRequest(parameters=asked, reduce=True, candidates=60))


def test_another_robot_is_planned_by_its_drives(tmp_path):
    """Better than random poses, inside the limits, read back as planned, under payloads that deflect its drives."""
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
    with pytest.raises(BadInputError, match="no sliding drive has a thermometer"):
        Planner(robot, PlanRequest(drive_degC=(20.0, 100.0)))


def test_legs_of_another_robot_expand_by_the_distance_of_their_joints(tmp_path):
    """In a hexapod that is no drive's value, which is zero in the middle of its stroke."""
    robot = Robot.load(ROOT / "examples" / "robots" / "hexapod" / "robot.yaml")
    planner = Planner(robot, PlanRequest(parameters=("drives",), drive_degC=(20.0, 70.0), candidates=100, starts=1))
    poses, visits = planner.poses[-4:], [PlannedConditions(drive_degC=20.0), PlannedConditions(drive_degC=70.0)]
    rows, _ = planner.columns.measured(poses, visits, NoiseLevel.stated(1.0, 1.0), np.zeros(3))
    column = {p.name: rows[..., 12 + k] for k, p in enumerate(planner.parameters)}
    stood = [robot.location_of(robot.command_at(pose)).nominal for pose in poses]
    for leg in range(1, 7):
        ends = [[one.pose("base", f"leg{leg}_{link}").translation for one in stood] for link in ("barrel", "ball_x")]
        lengths = np.linalg.norm(np.subtract(*ends), axis=1)
        growth, drive = column[f"expansion.leg{leg}_stroke"], column[f"drive.leg{leg}_stroke"]
        assert not growth[:, 0].any()
        assert growth[:, 1] == pytest.approx(50.0 * lengths[:, None] * drive[:, 1])
    read = read_plan(planner.plan().save(tmp_path / "plan.csv"), robot)
    assert {*read.conditions["leg3_rod"].tolist()} == {20.0, 70.0}
