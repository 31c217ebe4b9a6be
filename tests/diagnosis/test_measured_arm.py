"""A real arm: a UR10 under a laser tracker. What is right there is known; see examples/machines/ur10."""

import numpy as np
import pytest

from pouring_robot.calibration.calibrate import calibrate
from pouring_robot.campaign.data import Campaign
from pouring_robot.diagnosis.diagnose import diagnose
from pouring_robot.robot.model import RobotModel
from tests.support import ROOT

UR10 = ROOT / "examples" / "machines" / "ur10"


@pytest.mark.slow
def test_error_of_each_joints_own_angle_is_named_and_no_other_cause():
    """After its geometry is calibrated; on rows held out the published 0.1 mm (three coordinates) are left.

    With few rows it is said besides that the geometry, calibrated without that error, stands elsewhere beside it.
    """
    drawing = RobotModel.for_robot(UR10 / "robot.yaml")
    campaign = Campaign.read(UR10 / "series_c.csv", drawing.definition)
    campaign = campaign.subset(np.arange(0, len(campaign), 3))
    found = diagnose(campaign, calibrate(campaign, drawing).calibrated)
    assert found.verdict == "named"
    named, *others = found.effects
    assert named.cause.effect == "joint_periodic"
    assert not named.cause.alternatives
    assert {other.cause.effect for other in others} <= {"joint_placement"}
    assert {name.rpartition("_")[2] for name, _ in found.parameters_of(named)} == {str(k) for k in range(1, 31)}
    assert found.held_out.position("before") > 0.2e-3
    assert np.sqrt(3.0) * found.held_out.position("after") <= 0.12e-3
