"""Virtual measurement: seeded, written completely or not at all, and read back unchanged."""

import json
import os

import numpy as np
import pinocchio as pin
import pytest

from pouring_robot.campaign.data import Campaign
from pouring_robot.campaign.plan import random_plan, read_plan
from pouring_robot.campaign.simulate import MeasurementOptions, simulate_campaign
from pouring_robot.checks.check import check_campaign
from pouring_robot.checks.flags import wrong_rows
from pouring_robot.exceptions import BadInputError, CampaignError, OutputError
from pouring_robot.robot.heat_section import HeatSection
from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.pouring_robot import PouringRobot
from tests.campaign.simulated import measure

PLAN = "x_mm,y_mm,z_mm,tilt_deg,session,payload_kg\n-100,0,-600,10,a,300\n-110,10,-610,12,a,\n-90,-10,-500,0,b,100\n"


@pytest.mark.parametrize("full", [True, False])
def test_round_trip_simulate_read_check(tmp_path, as_built, full):
    measured = measure(as_built, count=70, seed=21, outliers=3, lost=0.01, sigma_rotation_rad=5e-5 if full else None)
    measured.campaign.save(tmp_path / "c.csv")
    campaign = Campaign.read(tmp_path / "c.csv")
    assert campaign.full_pose is full
    for name in ("time", "payload", "leg1", "leg4", "platform"):
        np.testing.assert_allclose(campaign.quantity(name), measured.campaign.quantity(name), atol=1e-6, err_msg=name)
    for name in ("drives", "position_m", "approach"):
        np.testing.assert_allclose(getattr(campaign, name), getattr(measured.campaign, name), atol=1e-6, err_msg=name)
    assert campaign.metadata == measured.campaign.metadata
    assert "seed 21" in campaign.metadata.description
    assert campaign.headings["q1"] == "q1_mm"
    assert set(wrong_rows(check_campaign(campaign, as_built.kinematics)).tolist()) == set(measured.outlier_rows)


def test_noise_outliers_and_lost_cells_are_as_asked(as_built):
    exact = measure(as_built, seed=3, sigma_position_m=0.0, sigma_rotation_rad=1e-9)
    assert exact.campaign.metadata.sigma_position_m is exact.campaign.metadata.sigma_rotation_rad is None
    noisy = measure(as_built, seed=3, count=60, outliers=4, outlier_m=0.01, lost=0.1)
    error = noisy.campaign.position_m - exact.campaign.position_m
    wrong = list(noisy.outlier_rows)
    sound = np.setdiff1d(np.arange(60), wrong)
    assert np.nanstd(error[sound]) == pytest.approx(5e-5, rel=0.2)
    sizes = np.linalg.norm(error[wrong], axis=1)
    assert np.all((sizes[np.isfinite(sizes)] > 0.0049) & (sizes[np.isfinite(sizes)] < 0.0151))
    lost = ~np.isfinite(np.concatenate([noisy.campaign.position_m, noisy.campaign.rotation_vector_rad], axis=1))
    assert lost.sum() == len(noisy.lost_cells)
    assert 15 < lost.sum() < 60
    seen = exact.pose_tracker_to_fixed_platform * exact.actual_poses[7] * exact.pose_platform_to_target
    np.testing.assert_allclose(exact.campaign.position_m[7], seen.translation, atol=1e-14)
    assert exact.campaign.metadata.sigma_position_m is None


def test_is_seeded(drawing):
    one, two, other = (measure(drawing, count=10, seed=seed).campaign for seed in (4, 4, 5))
    np.testing.assert_array_equal(one.position_m, two.position_m)
    assert not np.array_equal(one.position_m, other.position_m)


def test_frames_may_be_given(drawing):
    outer = pin.SE3(np.eye(3), np.array([1.0, 2.0, 3.0]))
    measured = simulate_campaign(
        drawing,
        random_plan(drawing, 3, 0),
        MeasurementOptions(0.0, None, pose_tracker_to_fixed_platform=outer, pose_platform_to_target=pin.SE3.Identity()),
    )
    expected = np.array([pose.translation for pose in measured.actual_poses]) + outer.translation
    np.testing.assert_allclose(measured.campaign.position_m, expected, atol=1e-14)


def test_conditions_may_move_the_robot(drawing):
    plan = random_plan(drawing, 5, 0)
    loads = plan.given(drawing.model.definition)["payload_kg"]
    longer = [drawing.built_as(drawing.model.displaced({}, {"leg1_s3": 1e-5 * load})) for load in loads.tolist()]
    measured = simulate_campaign(drawing, plan, robots=longer)
    for pose, drives, load in zip(measured.actual_poses, plan.drives, loads, strict=True):
        reached = drawing.location_at(drives + np.array([1e-5 * load, 0.0, 0.0, 0.0])).nominal.pose_base_to_end
        np.testing.assert_allclose(pose.translation, reached.translation, atol=1e-9)


def test_says_at_which_temperature_the_heat_of_its_robot_has_the_drawing():
    heat = HeatSection(properties={"expansion": {"reference_temperature": 22.0}})
    robot = PouringRobot.without_warning(RobotModel(heat=heat))
    stated = simulate_campaign(robot, random_plan(robot, 1, 0)).campaign.metadata.reference_temperature_degC
    strains = {degC: heat.thermal_properties().strain(degC) for degC in (20.0, 22.0, 24.0)}
    assert [degC for degC, strain in strains.items() if strain == 0.0] == [stated]


def test_reads_a_plan_with_conditions(tmp_path, drawing):
    path = tmp_path / "plan.csv"
    path.write_text(PLAN)
    plan = read_plan(path, drawing)
    assert plan.sessions == ("a", "a", "b")
    assert plan.poses[1].position_m == pytest.approx((-0.11, 0.01, -0.61))
    assert plan.conditions["payload"][0] == 300.0
    assert np.isnan(plan.conditions["payload"][1])
    assert plan.conditions["approach_q1"][1:].tolist() == np.sign(np.diff(plan.drives[:, 0])).tolist()


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("-110", "-5000", ["line 3", "out of reach"]),
        ("-110", "", ["line 3", "x_mm"]),
        ("tilt_deg", "tilt_mm", ["tilt_mm"]),
        ("payload_kg", "approach_q1", ["approach"]),
        ("a,300", "a,-3", ["line 2", "'payload_kg'", "-3 kg is not a possible load"]),
    ],
)
def test_names_the_fault_of_a_plan(tmp_path, drawing, old, new, words):
    path = tmp_path / "plan.csv"
    path.write_text(PLAN.replace(old, new))
    with pytest.raises(CampaignError) as caught:
        read_plan(path, drawing)
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize(
    "options",
    [
        {"sigma_position_m": -1.0},
        {"sigma_position_m": np.nan},
        {"sigma_position_m": None},
        {"sigma_rotation_rad": "fine"},
        {"lost": 1.0},
        {"seed": -1},
        {"seed": 1.5},
        {"outliers": 99},
        {"outliers": 2.5},
        {"pose_tracker_to_fixed_platform": np.eye(4)},
    ],
)
def test_refuses_figures_that_mean_nothing(drawing, options):
    with pytest.raises(BadInputError):
        simulate_campaign(drawing, random_plan(drawing, 3, 0), MeasurementOptions(**options))
    with pytest.raises(BadInputError):
        random_plan(drawing, 0, 0)


def test_writes_both_files_or_none(tmp_path, clean, monkeypatch):
    path = tmp_path / "c.csv"
    sync, calls = os.fsync, []

    def fails_second(descriptor):
        calls.append(descriptor)
        if len(calls) == 2:
            raise OSError(28, "No space left on device")
        sync(descriptor)

    monkeypatch.setattr(os, "fsync", fails_second)
    with pytest.raises(OutputError, match=r"No space.*; free some space there"):
        clean.campaign.save(path)
    assert list(tmp_path.iterdir()) == []
    path.write_text("old")
    calls.clear()
    with pytest.raises(OutputError, match="--overwrite"):
        clean.campaign.save(path)
    with pytest.raises(OutputError, match="No space"):
        clean.campaign.save(path, overwrite=True)
    assert path.read_text() == "old"
    assert [entry.name for entry in tmp_path.iterdir()] == ["c.csv"]
    for name, words in {"c.yaml": "beside it", "c.xlsx": "not as .xlsx"}.items():
        with pytest.raises(OutputError, match=words):
            clean.campaign.save(tmp_path / name)


def test_truth_is_json(real):
    truth = json.loads(real.truth_text())
    assert truth["seed"] == 5
    assert len(truth["actual_poses"]) == 80
    assert set(truth["pose_platform_to_target"]) == {"translation_mm", "rotation_vector_rad"}


def test_refuses_what_is_no_plan_or_not_of_its_length(drawing):
    plan = random_plan(drawing, 3, seed=1)
    with pytest.raises(BadInputError, match="the plan is a PosePlan"):
        simulate_campaign(drawing, list(plan.poses))
    with pytest.raises(BadInputError, match="2 robots do not match 3 poses"):
        simulate_campaign(drawing, plan, robots=[drawing] * 2)
    with pytest.raises(BadInputError, match=r"give a Robot, .* not a int"):
        simulate_campaign(drawing, plan, robots=[1] * 3)
    for scale in ([1e-4] * 2, "large", np.nan):
        with pytest.raises(BadInputError, match="tracker's scale is one number, or one for each of 3 poses"):
            simulate_campaign(drawing, plan, scale=scale)
    with pytest.raises(BadInputError, match="MeasurementOptions, not a dict"):
        simulate_campaign(drawing, plan, {"seed": 1})
    with pytest.raises(BadInputError, match="path of a campaign is the one its table would have, not a int"):
        simulate_campaign(drawing, plan, path=3)
    with pytest.raises(BadInputError, match=r"give a Robot, .* not a str"):
        read_plan("plan.csv", "robot.yaml")
    with pytest.raises(BadInputError, match="seed of a plan is a whole number from 0 on, not -1"):
        random_plan(drawing, 3, seed=-1)


def test_plans_and_measurements_are_told_on_one_line(drawing):
    plan = random_plan(drawing, 3, seed=1)
    assert repr(plan).startswith("<PosePlan: 3 poses, approach_q1, ")
    for one in (plan, simulate_campaign(drawing, plan)):
        assert "\n" not in repr(one) and len(repr(one)) < 300
