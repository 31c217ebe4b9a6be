"""The figures that are printed and written as JSON."""

import json
import math

import numpy as np
import pinocchio as pin
import pytest

from pouring_robot.mechanism.poses import PoseDifference
from pouring_robot.robot.location_figures import difference_figures, joint_figures, location_figures
from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.pouring.platform_pose import PlatformPose


def test_units_are_in_the_names():
    figures = joint_figures(RobotModel().definition.mechanism(), {"leg1_s3": 0.55, "leg4_s5": math.pi / 4})
    assert figures == {"leg1_s3_mm": pytest.approx(550.0), "leg4_s5_deg": pytest.approx(45.0)}


def test_difference():
    difference = PoseDifference(np.array([0.003, 0.0, -0.004]), np.array([0.0, 0.002, 0.0]))
    assert difference_figures(difference) == {
        "translation_mm": pytest.approx([3.0, 0.0, -4.0]),
        "rotation_mrad": pytest.approx([0.0, 2.0, 0.0]),
        "distance_mm": pytest.approx(5.0),
        "angle_mrad": pytest.approx(2.0),
    }


def test_location(very_crooked):
    location = very_crooked.locate(PlatformPose((-0.1, 0.03, -0.6), 0.5))
    dexterity = very_crooked.dexterity(location)
    figures = json.loads(json.dumps(location_figures(location, dexterity), allow_nan=False))
    assert figures["commanded"] == pytest.approx(
        {"x_mm": -100.0, "y_mm": 30.0, "z_mm": -600.0, "tilt_deg": math.degrees(0.5)}
    )
    assert figures["in_workspace"] is True
    assert figures["drives"]["leg2_s3_mm"] == pytest.approx(location.drives["leg2_s3"] * 1e3)
    nominal, actual = (result.pose("fixed_platform", "ladle_lip") for result in (location.nominal, location.actual))
    lip = figures["frames"]["ladle_lip"]
    assert lip["nominal_mm"] == pytest.approx(nominal.translation * 1e3)
    assert lip["actual_mm"] == pytest.approx(actual.translation * 1e3)
    assert lip["error"]["translation_mm"] == pytest.approx(1e3 * (actual.translation - nominal.translation))
    angle = pin.log3(actual.rotation @ nominal.rotation.T)
    assert lip["error"]["angle_mrad"] == pytest.approx(1e3 * np.linalg.norm(angle))
    closure = figures["closure"]
    assert (closure["rank_nominal"], closure["rank_actual"], closure["freedoms_nominal"]) == (22, 24, 4)
    assert closure["left_open_mrad"] == pytest.approx(
        1e3 * np.linalg.norm(location.actual.residual[:, 3:], axis=1).max()
    )
    # The moving U-joint centres lie sqrt(182.5² + 330²) mm from the platform's origin.
    assert figures["dexterity"]["characteristic_length_mm"] == pytest.approx(math.hypot(182.5, 330.0))


def test_limiting_joint_is_in_its_own_unit(drawing):
    low = drawing.locate(PlatformPose((-0.1, 0.0, -0.95), 0.0))
    figures = location_figures(low, drawing.dexterity(low))
    assert figures["in_workspace"] is False
    assert figures["outside_workspace_mm"] == pytest.approx([0.0, 0.0, 125.0])
    limiting = low.reach[0]
    assert limiting.joint.endswith("s3")
    assert figures["limiting_joint"]["margin_mm"] == pytest.approx((1.1 - limiting.value) * 1e3)
    tilted = drawing.locate(PlatformPose((-0.1, 0.0, -0.6), 1.25))
    figures = location_figures(tilted, drawing.dexterity(tilted))
    limiting = tilted.reach[0]
    assert not limiting.joint.endswith("s3")
    assert figures["limiting_joint"]["value_deg"] == pytest.approx(math.degrees(limiting.value))
    assert figures["limiting_joint"]["margin_deg"] == pytest.approx(math.degrees(limiting.margin))
