"""Nominal and actual robot side by side."""

import numpy as np
import pytest

from pouring_robot.exceptions import ClosureError, UnknownFrameError, UnreachablePoseError
from pouring_robot.model import JointPlacement, RobotModel
from pouring_robot.poses import PlatformPose
from pouring_robot.robot import PouringRobot, load_robot
from tests.checks import ACTUAL, pose_gap, random_poses


def test_without_errors_the_ladle_is_where_it_should_be(drawing):
    for pose in random_poses(20, seed=70):
        location = drawing.locate(pose)
        assert location.in_workspace
        for frame in ("moving_platform", "ladle", "ladle_lip"):
            difference = location.difference(frame)
            assert max(difference.distance_m, difference.angle_rad) < 1e-12


def test_the_nominal_platform_is_where_it_was_commanded(as_built):
    for pose in random_poses(20, seed=71):
        nominal, actual = as_built.locate(pose).poses("moving_platform")
        assert pose_gap(nominal, pose.to_se3()) == pytest.approx([0.0, 0.0], abs=1e-12)
        assert 1e-5 < pose_gap(nominal, actual)[0] < 0.02


def test_frames_of_the_ladle_are_rigid_on_the_platform(as_built):
    """The lip's error is the platform's error carried along its lever arm."""
    (pose,) = random_poses(1, seed=72)
    location = as_built.locate(pose)
    platform, actual_platform = location.poses("moving_platform")
    for frame in ("ladle", "ladle_lip"):
        nominal, actual = location.poses(frame)
        carried = actual_platform * platform.actInv(nominal)
        assert pose_gap(carried, actual) == pytest.approx([0.0, 0.0], abs=1e-12)


def test_shifting_all_upper_centres_shifts_the_ladle_rigidly():
    """A closed form through the whole stack: the fixed platform's joints all 1, -2, 3 mm off."""
    shift = (1.0, -2.0, 3.0)
    model = RobotModel(joint_placements={f"leg{i}_s1": JointPlacement(translation_mm=shift) for i in (1, 2, 3, 4)})
    for pose in random_poses(5, seed=73):
        difference = PouringRobot(model).locate(pose).difference()
        assert difference.translation_m * 1e3 == pytest.approx(shift, abs=1e-9)
        assert difference.angle_rad < 1e-11


def test_forward_agrees_with_locate(as_built):
    for pose in random_poses(10, seed=74):
        location = as_built.locate(pose)
        for near in (None, pose):
            found = as_built.forward(location.drives, near)
            gap = pose_gap(found.pose_base_to_end, location.actual.pose_base_to_end)
            assert gap == pytest.approx([0.0, 0.0], abs=1e-10)


@pytest.mark.parametrize(
    ("position_mm", "tilt", "outside_mm", "outside_rad"),
    [
        ((-150.0, 50.0, -825.0), 1.08155, (0.0, 0.0, 0.0), 0.0),
        ((-50.0, -50.0, -425.0), -0.4884, (0.0, 0.0, 0.0), 0.0),
        ((-155.0, 0.0, -600.0), 0.0, (5.0, 0.0, 0.0), 0.0),
        ((-40.0, 51.0, -600.0), 0.0, (10.0, 1.0, 0.0), 0.0),
        ((-100.0, -53.0, -830.0), -0.5, (0.0, 3.0, 5.0), 0.0116),
        ((-100.0, 0.0, -420.0), 1.09, (0.0, 0.0, 5.0), 0.00845),
    ],
)
def test_distance_from_the_workspace_box(drawing, position_mm, tilt, outside_mm, outside_rad):
    pose = PlatformPose(tuple(value / 1e3 for value in position_mm), tilt)
    location = drawing.locate(pose)
    assert location.outside_workspace_m * 1e3 == pytest.approx(outside_mm, abs=1e-9)
    assert location.outside_workspace_rad == pytest.approx(outside_rad, abs=1e-12)
    assert location.in_workspace == (not any(outside_mm) and not outside_rad)


def test_reach_is_of_the_commanded_pose(drawing):
    location = drawing.locate(PlatformPose((-0.1, 0.02, -0.6), 0.3))
    reach = {one.joint: one.value for one in location.reach}
    assert reach == pytest.approx(
        {name: value for name, value in location.nominal.joint_values.items() if name.startswith("leg")}, abs=1e-12
    )


def test_errors_that_no_closure_can_take_are_no_solution():
    # 50 mm off sideways against the other three: chain 4 cannot be forced onto its seat.
    placements = {
        "leg4_s1": JointPlacement(rotation_mrad=(100.0, 0.0, 100.0)),
        "leg4_seat_mount": JointPlacement(rotation_mrad=(-100.0, 0.0, -100.0)),
        "leg1_s1": JointPlacement(rotation_mrad=(-100.0, 0.0, -100.0)),
    }
    robot = PouringRobot(RobotModel(joint_placements=placements))
    with pytest.raises(ClosureError) as caught:
        robot.locate(PlatformPose((-0.1, 0.0, -0.6), 0.2))
    assert caught.value.exit_code == 3


def test_refusals(drawing):
    with pytest.raises(UnreachablePoseError, match="out of reach"):
        drawing.locate(PlatformPose((0.0, 0.0, -2.0), 0.0))
    location = drawing.locate(PlatformPose((-0.1, 0.0, -0.6), 0.0))
    with pytest.raises(UnknownFrameError):
        location.difference("spout")


def test_loading_takes_files_models_and_nothing():
    by_path, by_text = load_robot(ACTUAL), load_robot(str(ACTUAL))
    by_model = load_robot(RobotModel.load(ACTUAL))
    assert by_path.model == by_text.model == by_model.model
    assert load_robot().model == RobotModel()


def test_wide_layout_has_its_own_box_and_works():
    robot = PouringRobot(RobotModel(layout="wide"))
    for pose in random_poses(20, seed=75):
        location = robot.locate(pose)
        gap = pose_gap(location.actual.pose_base_to_end, pose.to_se3())
        assert gap == pytest.approx([0.0, 0.0], abs=1e-10)
        assert np.isfinite(robot.dexterity(location).condition)
