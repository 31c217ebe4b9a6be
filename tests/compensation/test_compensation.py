"""Compensation: the actual ladle, warm and crooked, reaches the wanted pose in its four freedoms."""

import csv
import dataclasses
import io
import itertools

import numpy as np
import pytest

from pouring_robot.compensation.pose import commands_csv, compensate
from pouring_robot.exceptions import (
    BadInputError,
    CompensationError,
    LockedPoseError,
    UnknownFrameError,
    UnreachablePoseError,
)
from pouring_robot.mechanism.joint_limits import joint_reach
from pouring_robot.mechanism.transfer import closed_chain_transfer
from pouring_robot.robot.heat_section import HeatSection
from pouring_robot.robot.model import DriveOffset, RobotModel
from pouring_robot.robot.pouring.platform_pose import PlatformPose
from pouring_robot.robot.pouring_robot import PouringRobot
from pouring_robot.thermal.expansion.warm_pouring_robot import HeatedRobot
from tests.support import BOX_LOWER, BOX_UPPER, random_poses

POSE = PlatformPose((-0.100, 0.020, -0.600), 0.3)
MICRO_MM = 1e-9
"""1e-6 mm in m."""


@pytest.fixture(scope="module")
def hot(as_built):
    return HeatedRobot(as_built, HeatSection(melt_degC=1700.0))


def reachable(robot, pose):
    return joint_reach(robot.kinematics.mechanism, robot.kinematics.joint_values(pose))[0].relative_margin > 0.02


def corner_poses(robot):
    rows = itertools.product(*zip(BOX_LOWER, BOX_UPPER, strict=True))
    poses = [PlatformPose(tuple(float(v) for v in row[:3]), float(row[3])) for row in rows]
    return [pose for pose in poses if reachable(robot, pose)]


def test_over_the_box_at_1700_degrees_with_geometric_errors(hot, as_built):
    """Checked in the forward direction: the pose command is located, with temperatures settled anew."""
    poses = corner_poses(as_built) + random_poses(4, seed=31)
    before = []
    for pose in poses:
        found = compensate(hot, pose)
        actual = hot.locate(found.command).location.actual.pose_base_to_end
        left = PlatformPose.from_se3(actual)
        assert np.abs(np.subtract(left.position_m, pose.position_m)).max() < MICRO_MM
        assert abs(left.tilt_rad - pose.tilt_rad) < 1e-9
        # The reported drives are those of the pose command.
        for name, value in hot.robot.kinematics.inverse(found.command).items():
            assert value == pytest.approx(found.drives[name], abs=1e-12)
        before.append(found.before.distance_m)
    uncorrected = hot.locate(poses[-1]).location.difference("moving_platform").distance_m
    assert before[-1] == pytest.approx(uncorrected, abs=1e-9)
    assert len(poses) > 12
    assert np.median(before) > 2e-3 and min(before) > 5e-4


def test_a_direction_that_no_drive_moves_is_reported(as_built, monkeypatch):
    """As where a leg is perpendicular to the possible motion of its end."""

    def without_the_second_drive(*asked):
        found = closed_chain_transfer(*asked)
        return dataclasses.replace(found, matrix=found.matrix * [1.0, 0.0, 1.0, 1.0])

    monkeypatch.setattr("pouring_robot.compensation.pose.closed_chain_transfer", without_the_second_drive)
    with pytest.raises(LockedPoseError, match="the drives cannot move the robot in every direction here") as caught:
        compensate(as_built, POSE)
    assert caught.value.ratio < 1e-15


def test_errors_that_cannot_be_cancelled_are_reported(hot):
    found = compensate(hot, POSE)
    actual = hot.locate(found.command).location
    wanted = actual.nominal.mechanism  # frames only
    assert wanted.loops.working_frame == "ladle_lip"
    roll, yaw = found.uncontrolled_rad
    assert abs(roll) > 1e-6 and abs(yaw) > 1e-5
    lip = actual.actual.pose("fixed_platform", "ladle_lip").translation
    drawing = hot.robot.locate(POSE).nominal.pose("fixed_platform", "ladle_lip").translation
    assert found.left_at_lip.translation_m == pytest.approx(lip - drawing, abs=1e-9)
    assert 1e-6 < found.left_at_lip.distance_m < 1e-3
    assert found.state.unsettled_m < 1e-10


def test_the_lip_can_be_compensated_instead(hot):
    found = compensate(hot, POSE, "ladle_lip")
    lip = hot.locate(found.command).location.actual.pose("fixed_platform", "ladle_lip").translation
    drawing = hot.robot.locate(POSE).nominal.pose("fixed_platform", "ladle_lip").translation
    assert np.abs(lip - drawing).max() < MICRO_MM
    platform = hot.locate(found.command).location.actual.pose_base_to_end
    assert PlatformPose.from_se3(platform).tilt_rad == pytest.approx(POSE.tilt_rad, abs=1e-9)


def test_drive_offsets_of_a_cold_robot_are_subtracted():
    offsets = {"leg1_s3": 2.0, "leg2_s3": -1.0, "leg3_s3": 0.5}
    model = RobotModel(
        drive_offsets={name: DriveOffset(offset_mm=value) for name, value in offsets.items()}
        | {"leg4_s5": DriveOffset(offset_mrad=4.0)}
    )
    robot = PouringRobot(model)
    found = compensate(HeatedRobot(robot), POSE)
    nominal = robot.kinematics.inverse(POSE)
    for name, value in offsets.items():
        assert found.drives[name] == pytest.approx(nominal[name] - value * 1e-3, abs=1e-11)
    assert found.drives["leg4_s5"] == pytest.approx(nominal["leg4_s5"] - 4e-3, abs=1e-11)
    assert found.uncontrolled_rad == pytest.approx((0.0, 0.0), abs=1e-10)


def test_very_crooked_and_hot(very_crooked):
    """4 mrad on every axis, with loops left open: compensation is still exact."""
    heated = HeatedRobot(very_crooked, HeatSection())
    for pose in random_poses(3, seed=5):
        found = compensate(heated, pose)
        assert found.before.distance_m > 1e-3
        assert np.abs(found.left.translation_m).max() < MICRO_MM
        assert abs(found.left_tilt_rad) < 1e-9


def test_out_of_reach_is_refused(hot):
    for pose in (PlatformPose((0.0, 0.0, -2.0), 0.0), PlatformPose((-0.1, 0.0, -0.6), 3.0)):
        with pytest.raises(UnreachablePoseError):
            compensate(hot, pose)


def test_a_limit_that_only_the_warm_robot_passes_is_refused(as_built):
    """The commanded leg is shorter than the wanted one by its expansion; at the shortest leg that is too short."""
    kinematics = as_built.kinematics
    low, high = -0.6, -0.2
    for _ in range(60):
        middle = 0.5 * (low + high)
        pose = PlatformPose((-0.1, 0.0, middle), 0.0)
        inside = joint_reach(kinematics.mechanism, kinematics.joint_values(pose))[0].margin > 1e-4
        low, high = (middle, high) if inside else (low, middle)
    pose = PlatformPose((-0.1, 0.0, low), 0.0)
    kinematics.inverse(pose)
    limiting = joint_reach(kinematics.mechanism, kinematics.joint_values(pose))[0]
    assert limiting.joint.endswith("_s3")
    with pytest.raises(UnreachablePoseError):
        compensate(HeatedRobot(as_built, HeatSection()), pose)


def test_unknown_frames_are_named(hot):
    with pytest.raises(UnknownFrameError):
        compensate(hot, POSE, "lip")


def test_the_commands_as_csv(hot):
    found = [compensate(hot, pose) for pose in random_poses(2, seed=8)]
    rows = list(csv.DictReader(io.StringIO(commands_csv(found))))
    for one, row in zip(found, rows, strict=True):
        assert float(row["q1_mm"]) == pytest.approx(one.drives["leg1_s3"] * 1e3, abs=1e-11)
        assert float(row["q4_rad"]) == pytest.approx(one.drives["leg4_s5"], abs=1e-11)
        command = PlatformPose.from_mm_deg(
            *(float(row[f"command_{name}"]) for name in ("x_mm", "y_mm", "z_mm", "tilt_deg"))
        )
        left = PlatformPose.from_se3(hot.locate(command).location.actual.pose_base_to_end)
        assert np.abs(np.subtract(left.position_m, one.wanted.position_m)).max() < MICRO_MM


def test_outside_the_box(drawing):
    for pose in (POSE, PlatformPose(tuple(BOX_UPPER[:3].tolist()), float(BOX_UPPER[3]))):
        shift, turn = drawing.outside_workspace(pose)
        assert not shift.any() and turn == 0.0
    assert drawing.outside_workspace(PlatformPose((-0.100, 0.051, -0.600), 0.3))[0] == pytest.approx([0.0, 1e-3, 0.0])
    assert drawing.outside_workspace(PlatformPose((-0.100, 0.0, -0.600), 1.2))[1] == pytest.approx(1.2 - BOX_UPPER[3])


def test_a_search_that_fails_reports_its_figures():
    error = CompensationError("x 1, y 2, z -600 mm, tilt 10 deg", 1e-3, 2e-3)
    assert (error.exit_code, error.left_m) == (3, 1e-3)
    assert "z -600 mm, tilt 10 deg: Newton's last step leaves 1 mm and 2 mrad" in str(error)


def test_a_result_is_shown_in_one_line(hot):
    found = compensate(hot, POSE)
    assert repr(found).startswith("<Compensation: 'moving_platform' ") and "\n" not in repr(found)
    assert found.to_frame()["q1_mm"][0] == pytest.approx(found.drives["leg1_s3"] * 1e3)


def test_a_robot_is_cold_by_default_and_other_types_of_poses_are_refused(as_built):
    assert compensate(as_built, POSE).drives == compensate(HeatedRobot(as_built), POSE).drives
    for call in (compensate, lambda robot, pose: HeatedRobot(robot).locate(pose)):
        with pytest.raises(BadInputError, match="a pose is a PlatformPose, not a ndarray"):
            call(as_built, np.zeros(4))


@pytest.mark.parametrize("given", [1e-3, [0.0, 1e-3], [0.0, 0.0, np.nan], "down"])
def test_the_displacement_by_heat_must_be_a_vector(as_built, given):
    with pytest.raises(BadInputError, match=r"by heat is three finite numbers \(x, y, z\), in m"):
        compensate(as_built, POSE, heat_moves_m=given)


def test_the_papers_sum_moves_the_cold_robot_as_far_the_other_way(as_built):
    found = compensate(as_built, POSE, heat_moves_m=[0.0, 0.0, 1e-3])
    assert found.left.translation_m == pytest.approx([0.0, 0.0, -1e-3], abs=1e-9)
