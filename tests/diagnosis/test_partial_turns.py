"""An error of a joint over part of a turn: whether it can be distinguished from one that is not periodic."""

import dataclasses

import numpy as np
import pytest

from pouring_robot import RobotModel, diagnose
from pouring_robot.campaign.plan import random_plan
from pouring_robot.campaign.simulate import MeasurementOptions, simulate_campaign
from pouring_robot.diagnosis import DiagnosisOptions
from pouring_robot.diagnosis.partial_turns import left_open, turned_deg
from pouring_robot.diagnosis.report.sentences import effect_lines
from pouring_robot.io.units import MRAD
from pouring_robot.robot.robot import Robot

SIGMA = 5e-5  # m and rad
URDF = """<robot name="mount"><link name="base"/><link name="fork"/><link name="tube"/><link name="top"/>
<joint name="azimuth" type="continuous"><parent link="base"/><child link="fork"/><axis xyz="0 0 1"/></joint>
<joint name="elevation" type="continuous"><parent link="fork"/><child link="tube"/><origin xyz="0 0 1"/>
<axis xyz="0 -1 0"/></joint>
<joint name="end" type="fixed"><parent link="tube"/><child link="top"/><origin xyz="1 0 0"/></joint></robot>"""
ROBOT = """format: pouring_robot/robot/1
name: mount
urdf: mount.urdf
base_frame: base
end_frame: top
drives: [{joint: azimuth}, {joint: elevation}]
"""
SMOOTH = (
    "in these poses a smooth error that does not repeat with turns, as of a bending part, looks the same: elevation"
)


def found(folder, ends_deg, error):
    """Diagnose a telescope's mount whose elevation errs by a function of its range (-1 to 1) and its angle in rad."""
    (folder / "mount.urdf").write_text(URDF)
    (folder / "robot.yaml").write_text(ROBOT)
    model = RobotModel.for_robot(folder / "robot.yaml")
    robot = Robot(model)
    plan = random_plan(robot, 80, 0)
    low, high = np.radians(ends_deg)
    commanded = np.column_stack([plan.drives[:, 0], np.random.default_rng(0).uniform(low, high, len(plan))])
    along = (2.0 * commanded[:, 1] - low - high) / (high - low)
    stood = commanded + np.column_stack([np.zeros(len(plan)), MRAD * error(along, commanded[:, 1])])
    moved = dataclasses.replace(plan, poses=tuple(stood), drives=stood)
    options = MeasurementOptions(sigma_position_m=SIGMA, sigma_rotation_rad=SIGMA)
    campaign = dataclasses.replace(simulate_campaign(robot, moved, options).campaign, drives=commanded)
    return diagnose(campaign, model, DiagnosisOptions(next_count=0))


@pytest.mark.parametrize(
    ("ends_deg", "error", "notes"),
    [
        ((60, 90), lambda along, _: 0.25 * along**2, (SMOOTH,)),
        ((-80, 80), lambda _, angle: 0.5 * np.sin(angle + 1.0), (SMOOTH,)),
        ((-150, 150), lambda _, angle: 0.5 * np.sin(angle + 1.0), ()),
    ],
)
def test_a_smooth_error_that_does_the_same_is_reported(tmp_path, ends_deg, error, notes):
    """A parabola of 0.25 mrad over 30 degrees was named a wave of 7 mrad, 99 % sure, without a remark."""
    diagnosis = found(tmp_path, ends_deg, error)
    (effect,) = diagnosis.firm
    assert (effect.cause.effect, effect.cause.form) == ("joint_periodic", "elevation_once")
    told = left_open(diagnosis, effect)
    assert [line.rpartition(" ")[0] for line in told] == list(notes)
    assert all(line in effect_lines(diagnosis, effect) for line in told)
    span = np.ptp(ends_deg)
    assert all(span - 10.0 < float(line.rpartition(" ")[2].removesuffix("°")) <= span for line in told)


def test_how_much_of_a_turn_was_covered():
    """The widest gap was not covered: from 350 to 20 degrees a joint turned by 30 degrees, not by 330."""
    courses = np.linspace(0, 350, 36), np.linspace(-10, 20, 36), np.linspace(0, 265, 36), np.zeros(36)
    assert [turned_deg(np.radians(angles)) for angles in courses] == pytest.approx([350.0, 30.0, 265.0, 0.0])
    first, second = (np.sin(order * np.radians(np.linspace(-135, 135, 1001))) for order in (8, 9))
    assert np.corrcoef(first, second)[0, 1] == pytest.approx(0.3, abs=0.05)


def test_indistinguishable_orders_are_reported_where_there_are_several(tmp_path):
    """The azimuth turned nearly once, the elevation by 30 degrees, in which its waves are not smooth."""
    diagnosis = found(tmp_path, (60, 90), lambda _, angle: 0.5 * np.sin(7.0 * angle) + 0.3 * np.sin(12.0 * angle))
    (effect,) = diagnosis.firm
    assert effect.cause.form == "turns"
    (told,) = left_open(diagnosis, effect)
    assert told == "turned too little to distinguish the orders: elevation 30°"
