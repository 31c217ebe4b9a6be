"""Poses and their differences in the user interface."""

import math

import numpy as np
import pinocchio as pin
import pytest

from pouring_robot.exceptions import BadInputError
from pouring_robot.mechanism.poses import PoseDifference
from pouring_robot.robot.pouring.platform_pose import PlatformPose


def test_mm_and_degrees():
    pose = PlatformPose.from_mm_deg(-100.0, 20.0, -600.0, 30.0)
    assert pose.position_m == pytest.approx((-0.1, 0.02, -0.6), abs=1e-15)
    assert pose.tilt_rad == pytest.approx(math.pi / 6, abs=1e-15)
    assert pose.to_mm_deg() == pytest.approx((-100.0, 20.0, -600.0, 30.0), abs=1e-12)


def test_a_positive_tilt_lowers_the_front():
    # Rotation about y, right-handed: the front (x) goes down.
    front = PlatformPose((0.0, 0.0, -0.6), math.pi / 2).to_se3().act(np.array([1.0, 0.0, 0.0]))
    assert front == pytest.approx([0.0, 0.0, -1.6], abs=1e-15)


def test_full_pose_and_back():
    for tilt in (-3.0, -0.4884, 0.0, 1.08155, 3.0):
        pose = PlatformPose((0.1, -0.2, 0.3), tilt)
        again = PlatformPose.from_se3(pose.to_se3())
        assert again.position_m == pose.position_m
        assert again.tilt_rad == pytest.approx(tilt, abs=1e-15)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_numbers_must_be_finite(bad):
    for index in range(3):
        position = [0.0, 0.0, 0.0]
        position[index] = bad
        with pytest.raises(BadInputError, match="pose's x, y, z must be finite numbers, in m"):
            PlatformPose(tuple(position), 0.0)
    with pytest.raises(BadInputError, match="tilt must be a finite number, in rad"):
        PlatformPose((0.0, 0.0, 0.0), bad)
    with pytest.raises(BadInputError, match="must be finite numbers, in mm and degrees"):
        PlatformPose.from_mm_deg("a", bad, 0.0, 0.0)


@pytest.mark.parametrize("bad", [(0.0, 0.0), None, "123", dict.fromkeys([1.0, 2.0, 3.0])])
def test_a_position_has_three_coordinates(bad):
    with pytest.raises(BadInputError, match="x, y, z must be finite numbers"):
        PlatformPose(bad, 0.0)


def test_a_pose_holds_plain_numbers_whatever_it_was_given():
    row = np.array([-0.1, 0.02, -0.6, 0.3])
    pose = PlatformPose(row[:3], row[3])
    assert {pose: "found"}[PlatformPose(["-0.1", 0.02, -0.6], "0.3")] == "found"
    row[:] = 0.0
    assert pose.position_m == (-0.1, 0.02, -0.6)


def test_difference_is_in_the_axes_of_the_base():
    turn = pin.utils.rotate("z", math.pi / 2)
    nominal = pin.SE3(turn, np.array([1.0, 0.0, 0.0]))
    # A small rotation about the base's x axis, whatever the frame's own axes are; a shift along the base's y.
    actual = pin.SE3(pin.utils.rotate("x", 0.01) @ turn, np.array([1.0, 0.003, 0.004]))
    difference = PoseDifference.between(nominal, actual)
    assert difference.translation_m == pytest.approx([0.0, 0.003, 0.004], abs=1e-15)
    assert difference.rotation_rad == pytest.approx([0.01, 0.0, 0.0], abs=1e-14)
    assert difference.distance_m == pytest.approx(0.005, abs=1e-15)
    assert difference.angle_rad == pytest.approx(0.01, abs=1e-14)
    translation, rotation = difference.to_mm_mrad()
    assert translation == pytest.approx([0.0, 3.0, 4.0], abs=1e-12)
    assert rotation == pytest.approx([10.0, 0.0, 0.0], abs=1e-11)
