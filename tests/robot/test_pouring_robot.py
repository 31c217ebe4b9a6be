"""Nominal and actual robot side by side."""

import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pinocchio as pin
import pytest

from pouring_robot.exceptions import BadInputError, ClosureError, UnknownFrameError, UnreachablePoseError
from pouring_robot.robot.model import DriveOffset, JointPlacement, RobotModel
from pouring_robot.robot.pouring.platform_pose import PlatformPose
from pouring_robot.robot.pouring_robot import PouringRobot, load_robot
from tests.support import ACTUAL, pose_gap, random_poses


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
    """The lip's error is the platform's error plus its rotation times the lever arm."""
    (pose,) = random_poses(1, seed=72)
    location = as_built.locate(pose)
    platform, actual_platform = location.poses("moving_platform")
    for frame in ("ladle", "ladle_lip"):
        nominal, actual = location.poses(frame)
        carried = actual_platform * platform.actInv(nominal)
        assert pose_gap(carried, actual) == pytest.approx([0.0, 0.0], abs=1e-12)


def test_threads_that_share_a_robot_do_not_disturb_each_other(as_built):
    switches = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)
    try:
        poses = random_poses(60, seed=73)

        def found(pose):
            location = as_built.locate(pose)
            return *pose_gap(*location.poses("ladle_lip")), *as_built.transfer(pose, "dh").to_numpy().ravel()

        alone = [found(pose) for pose in poses]
        with ThreadPoolExecutor(8) as threads:
            np.testing.assert_array_equal(list(threads.map(found, poses)), alone)
    finally:
        sys.setswitchinterval(switches)


def test_shifting_all_upper_centres_shifts_the_ladle_rigidly():
    """A closed form through the whole stack: the fixed platform's joints are all off by 1, -2, 3 mm."""
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


def test_reach_is_that_of_the_commanded_pose(drawing):
    location = drawing.locate(PlatformPose((-0.1, 0.02, -0.6), 0.3))
    reach = {one.joint: one.value for one in location.reach}
    assert reach == pytest.approx(
        {name: value for name, value in location.nominal.joint_values.items() if name.startswith("leg")}, abs=1e-12
    )


def test_a_joint_of_the_robot_as_built_beyond_its_limits_is_refused(drawing):
    """The drawing reaches this pose; legs that are 50 mm beyond their commands exceed their limit of 1100 mm."""
    pose = PlatformPose((-0.1, -0.02, -1.04), 0.0)  # off centre, so that leg 3 alone is the longest, not by round-off
    assert 0.0 < 1.1 - drawing.locate(pose).drives["leg3_s3"] < 0.05
    offsets = {f"leg{i}_s3": DriveOffset(offset_mm=50.0) for i in (1, 2, 3)}
    longer = PouringRobot(RobotModel(drive_offsets=offsets))
    assert longer.locate(PlatformPose((-0.1, 0.0, -0.8), 0.0)).drives["leg3_s3"] < 1.05
    with pytest.raises(UnreachablePoseError, match="'leg3_s3' would stand at 11") as located:
        longer.locate(pose)
    with pytest.raises(UnreachablePoseError) as found:
        longer.forward(drawing.kinematics.inverse(pose))
    assert str(found.value) == str(located.value)
    for many in (longer.locate([pose]), longer.locate_drives([longer.drives_of(pose)])):
        assert many.status.values.tolist() == ["out of reach"]


def test_axis_weakness_is_the_effect_of_a_tilted_axis():
    """Against closures with each axis tilted by ±0.2 mrad: none moves the lip further sideways, and this one does."""
    (pose,) = random_poses(1, seed=76)
    drawing = PouringRobot()
    weakness = drawing.axis_weakness(drawing.locate(pose))
    moved = {}
    for joint in [f"leg{i}_{part}" for i in (1, 2, 3, 4) for part in ("s1", "s2", "s4", "s5", "seat_mount")]:
        for k, component in enumerate(("rx", "ry", "rz")):
            ends = []
            for tilt in (-0.2, 0.2):
                turn = tuple(tilt * (k == j) for j in range(3))
                model = RobotModel(joint_placements={joint: JointPlacement(rotation_mrad=turn)})
                ends.append(PouringRobot(model).locate(pose).difference("ladle_lip").translation_m[1])
            moved[f"{joint}.{component}"] = abs(ends[1] - ends[0]) / 0.4e-3
    assert weakness.m_per_rad == pytest.approx(max(moved.values()), rel=1e-3)
    assert moved[weakness.parameter] == pytest.approx(weakness.m_per_rad, rel=1e-3)
    assert weakness.m_per_rad > 1.0


def test_displacements_that_the_fixed_platform_absorbs():
    placed = JointPlacement(translation_mm=(1.0, 2.0, 3.0))
    hidden = ("truss_travel", "trolley_travel", "fixed_platform_mount")
    names = (*hidden, "leg1_s1", "leg4_seat_mount", "ladle_mount", "ladle_lip_mount")
    for name in names:
        robot = PouringRobot(RobotModel(joint_placements={name: placed}))
        assert robot.unseen_displacements == ((name,) if name in hidden else ())
        moved = robot.locate(PlatformPose((-0.1, 0.0, -0.6), 0.2)).difference().distance_m
        assert (moved < 1e-12) == (name in hidden)


def test_locations_are_read_only_and_compare_by_identity(drawing):
    pose = PlatformPose((-0.16, 0.0, -0.6), 0.2)
    first, second = drawing.locate(pose), drawing.locate(pose)
    assert first != second
    assert len({first, second}) == 2
    difference = first.difference()
    for array in (first.outside_workspace_m, difference.translation_m, difference.rotation_rad):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0


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
    assert by_path.model == by_text.model == by_model.model == PouringRobot(ACTUAL).model
    assert load_robot().model == RobotModel()


def test_wide_layout_has_its_own_box_and_works():
    robot = PouringRobot(RobotModel(layout="wide"))
    for pose in random_poses(20, seed=75):
        location = robot.locate(pose)
        gap = pose_gap(location.actual.pose_base_to_end, pose.to_se3())
        assert gap == pytest.approx([0.0, 0.0], abs=1e-10)
        assert np.isfinite(robot.dexterity(location).condition)


@pytest.mark.parametrize("made", [load_robot, PouringRobot, PouringRobot.load])
def test_parts_of_the_model_that_a_robot_leaves_out_are_reported_to_the_caller(made):
    model = RobotModel.model_validate({"heat": {"melt_degC": 1650.0}, "effects": [{"effect": "a", "form": "b"}]})
    with pytest.warns(UserWarning) as said:
        made(model)
    heat, effects = (str(one.message) for one in said)
    assert "heat section of the model is left out" in heat
    assert "PouringRobot does not apply the effects of the model that depend on conditions: a" in effects
    assert {one.filename for one in said} == {__file__}


def test_poses_of_a_wrong_type_are_refused_in_one_line(drawing):
    with pytest.raises(BadInputError, match="from_se3"):
        drawing.locate(pin.SE3.Identity())
    with pytest.raises(BadInputError, match=r"one finite value for each drive: .* a pose is a PlatformPose"):
        drawing.transfer(np.zeros((2, 4)))
    for parameters in (None, [1]):
        with pytest.raises(BadInputError, match="parameters are asked for by name"):
            drawing.transfer(PlatformPose((-0.1, 0.0, -0.6), 0.0), parameters)
    with pytest.raises(BadInputError, match="RobotModel or the path of its file, not a int"):
        load_robot(3)
    assert repr(drawing) == "<PouringRobot: layout paper, 0 displaced joints and drives>"


def test_arguments_of_a_wrong_type_are_refused_in_one_line(drawing):
    pose = PlatformPose((-0.1, 0.0, -0.6), 0.0)
    for call, given, words in (
        (drawing.outside_workspace, [0.0, 0.0, -0.6, 0.0], "a pose is a PlatformPose, not a list"),
        (drawing.dexterity, pose, "give a location, .* not a PlatformPose"),
        (drawing.axis_weakness, pose, "give a location, .* not a PlatformPose"),
        (PlatformPose.from_se3, np.eye(4), "a full pose is a pinocchio.SE3, not a ndarray"),
        (drawing.locate(pose).difference, 3, "a frame is asked for by its name, not a int"),
    ):
        with pytest.raises(BadInputError, match=words):
            call(given)
