"""Gross errors no larger than errors of the robot, so that no check before the fit distinguishes them."""

import dataclasses

import numpy as np
import pinocchio as pin
import pytest

from pouring_robot.calibration.calibrate import CalibrationOptions, calibrate
from pouring_robot.calibration.report import split_line
from pouring_robot.calibration.summary import calibration_metrics
from pouring_robot.checks.flags import FlagCode
from pouring_robot.exceptions import CalibrationError
from pouring_robot.robot.robot import Robot
from tests.campaign.simulated import SIGMA_M, damaged, measure
from tests.robot.test_definition import ROBOTS


def arm_as_built(seed):
    """Return an arm whose joints are off by 1 mm and 1 mrad and whose zeros by 5 mrad, standard deviations."""
    drawing, random = Robot.load(ROBOTS / "arm/robot.yaml").model, np.random.default_rng(seed)
    drives = [drive.joint for drive in drawing.definition.drives]
    off = {name: pin.SE3(pin.exp3(random.normal(0.0, 1e-3, 3)), random.normal(0.0, 1e-3, 3)) for name in drives}
    return Robot(drawing.displaced(off, dict(zip(drives, random.normal(0.0, 5e-3, len(drives)), strict=True))))


@pytest.fixture(scope="module")
def sound():
    """Eighty poses of such an arm, and their calibration."""
    arm = arm_as_built(1)
    campaign = measure(arm, count=80, seed=1).campaign
    return campaign, calibrate(campaign, Robot.load(ROBOTS / "arm/robot.yaml").model)


def off_by_8_mm(campaign, rows):
    """Return the campaign with rows (k,) off by that much, each in its own direction."""
    ways = np.random.default_rng(1).normal(size=(len(rows), 3))
    ways *= 8e-3 / np.linalg.norm(ways, axis=1)[:, None]
    return damaged(campaign, position_m=lambda p: p.__setitem__(rows, p[rows] + ways))


def test_no_row_of_a_sound_campaign_is_left_out(sound):
    _, found = sound
    assert not found.left_out.size
    assert found.misfit(found.split.test, after=False).rms_mm > 1.0


@pytest.mark.parametrize("stated", [True, False])
def test_rows_that_no_error_of_the_robot_explains_are_left_out_and_named(sound, stated):
    """One is among the fitted rows, one among those held out."""
    campaign, found = sound
    wrong = np.sort([found.split.train[7], found.split.test[3]])
    campaign = off_by_8_mm(campaign, wrong)
    if not stated:
        unstated = campaign.metadata.model_copy(update={"sigma_position_m": None, "sigma_rotation_rad": None})
        campaign = dataclasses.replace(campaign, metadata=unstated)
    found = calibrate(campaign, Robot.load(ROBOTS / "arm/robot.yaml").model)
    lines = campaign.lines[wrong].tolist()
    assert found.left_out.tolist() == wrong.tolist()
    assert not set(wrong.tolist()) & {*found.split.train.tolist(), *found.split.test.tolist()}
    assert found.misfit(found.split.test, after=True).rms_mm < 1.5 * SIGMA_M * 1e3
    assert f"left out: 2 rows (lines {lines[0]}, {lines[1]})" in split_line(found)
    assert calibration_metrics(found)["rows"]["left_out_lines"] == lines
    flags = [flag for flag in found.flags if flag.code is FlagCode.OUTLIER]
    assert [flag.rows for flag in flags] == [(row,) for row in wrong.tolist()]
    # The largest coordinate of 8 mm over a noise of 0.05 mm, which is known to a fifth.
    least, most = 0.8 * 160.0 / np.sqrt(3.0), 1.2 * 160.0
    assert all(least < flag.metrics["times_the_noise"] < most for flag in flags)
    assert found.noise.position_m == pytest.approx(SIGMA_M, rel=0.2)


def test_a_block_that_is_off_as_a_whole_is_no_gross_error(sound):
    """An unknown error acts on all its rows: the worst rows are no worse than the others."""
    campaign, found = sound
    test = found.split.test
    ways = np.random.default_rng(2).normal(0.0, 0.5e-3, (test.size, 3))
    moved = damaged(campaign, position_m=lambda p: p.__setitem__(test, p[test] + ways))
    assert not calibrate(moved, Robot.load(ROBOTS / "arm/robot.yaml").model).left_out.size


def test_too_few_rows_without_one_that_is_wrong_are_refused_with_its_line():
    options = CalibrationOptions(parameters=("drives",), choose=False, hold_out="time")
    few = measure(Robot.load(ROBOTS / "arm/robot.yaml"), count=15, seed=1).campaign
    few = damaged(few, position_m=lambda p: p.__setitem__(6, p[6] + 2e-3))
    line = int(few.lines[6])
    with pytest.raises(CalibrationError, match=rf"without the rows that fit nothing \(line {line}\) held-out blocks"):
        calibrate(few, Robot.load(ROBOTS / "arm/robot.yaml").model, options)
