"""Plans and virtual campaigns of any robot: read back as planned; without noise, two frames alone explain them."""

import numpy as np
import pinocchio as pin
import pytest

from pouring_robot.campaign.columns import campaign_columns
from pouring_robot.campaign.data import Campaign
from pouring_robot.campaign.nominal import nominal_poses
from pouring_robot.campaign.plan import random_plan, read_plan
from pouring_robot.campaign.simulate import MeasurementOptions, simulate_campaign
from pouring_robot.design.planning import Planner
from pouring_robot.estimation.frames.outer import OuterFrames
from pouring_robot.exceptions import BadInputError, CampaignError
from pouring_robot.robot.description.robot_file import TAKEN
from pouring_robot.robot.robot import Robot
from tests.robot.test_robot import NAMES, ROBOTS


@pytest.mark.parametrize("name", NAMES)
def test_without_noise_two_frames_explain_what_the_drawing_would_give(name, tmp_path):
    robot = Robot.load(ROBOTS / name / "robot.yaml")
    outer = pin.SE3(pin.exp3(np.array([0.0, 1.0, 2.0])), np.array([3.0, 1.0, 0.0]))
    inner = pin.SE3(pin.exp3(np.array([1.0, 0.0, 0.0])), np.array([0.0, 0.1, 0.0]))
    exact = MeasurementOptions(0.0, 0.0, pose_tracker_to_fixed_platform=outer, pose_platform_to_target=inner)
    measured = simulate_campaign(robot, random_plan(robot, 12, 3), exact)
    path = tmp_path / "c.csv"
    measured.campaign.save(path)
    again = Campaign.read(path, robot.model.definition)
    assert again.metadata.robot == name
    for told in (robot, robot.model, ROBOTS / name / "robot.yaml", str(ROBOTS / name / "robot.yaml")):
        assert np.array_equal(Campaign.read(path, told).drives, again.drives)
    seen = OuterFrames(outer, inner).seen(nominal_poses(robot.drawing, again.drives))
    # Twice a closure to 1e-9 rad, seen over a platform of some decimetres, and the digits of the file.
    assert again.position_m == pytest.approx(seen.position_m, abs=5e-9)


def test_a_campaign_is_of_a_robot_and_a_plan_of_whole_poses(tmp_path):
    with pytest.raises(BadInputError, match="a model is a RobotModel or the path of its file, not a int"):
        Campaign.read(tmp_path / "c.csv", 3)
    with pytest.raises(BadInputError, match=r"a plan has 1 to 100000 poses, not 2\.5"):
        random_plan(Robot.load(ROBOTS / "arm" / "robot.yaml"), 2.5, seed=1)
    for call in (lambda: random_plan("robot.yaml", 2, seed=1), lambda: simulate_campaign("robot.yaml", None)):
        with pytest.raises(BadInputError, match=r"give a Robot, as load_robot and .* not a str"):
            call()


def test_redundant_drives_are_neither_planned_nor_simulated_from_commands():
    lines = Robot.load(ROBOTS.parent / "machines" / "hangprinter" / "robot.yaml")
    for call in (lambda: simulate_campaign(lines, random_plan(lines, 4, 3)), lambda: Planner(lines)):
        with pytest.raises(
            BadInputError, match=r"hangprinter has redundant drives.*robot file without redundant_drives"
        ):
            call()


def test_a_plan_of_drives_is_read_in_their_units(tmp_path):
    robot = Robot.load(ROBOTS / "delta" / "robot.yaml")
    (tmp_path / "p.csv").write_text("q1_deg,q2_deg,q3_deg,session\n10,20,15,a\n0,0,0,b\n")
    plan = read_plan(tmp_path / "p.csv", robot)
    assert plan.drives == pytest.approx(np.radians([[10.0, 20.0, 15.0], [0.0, 0.0, 0.0]]))
    assert plan.conditions["approach_q1"].tolist() == [1.0, -1.0]
    (tmp_path / "p.csv").write_text("q1_deg,q2_deg,q3_deg\n10,20,95\n")
    with pytest.raises(CampaignError, match=r"p\.csv: line 2: the pose is out of reach: joint 'arm3_drive'"):
        read_plan(tmp_path / "p.csv", robot)


def test_no_drive_is_called_as_a_column_that_every_campaign_has():
    robot = Robot.load(ROBOTS / "arm" / "robot.yaml").model.definition
    own = {*(drive.column for drive in robot.drives), *robot.thermometers, *robot.travels}
    every = {q.name for q in campaign_columns(robot)}
    assert {name for name in every - own if name.partition("_")[2] not in own} <= TAKEN
