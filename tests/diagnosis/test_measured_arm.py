"""A real arm: a UR10 under a laser tracker. What is right there is known; see examples/machines/ur10."""

import numpy as np
import pytest

from pouring_robot.calibration.calibrate import calibrate
from pouring_robot.campaign.data import Campaign
from pouring_robot.diagnosis.diagnose import DiagnosisOptions, diagnose
from pouring_robot.effects import all_effects
from pouring_robot.robot.model import RobotModel
from scripts.studies.transfer import figures
from tests.support import ROOT

UR10 = ROOT / "examples" / "machines" / "ur10"


@pytest.mark.slow
def test_error_of_each_joints_own_angle_is_named_and_no_other_cause():
    """After its geometry is calibrated; on rows held out the published 0.1 mm (three coordinates) are left.

    It may be said besides that the geometry, calibrated without that error, stands elsewhere beside it.
    """
    drawing = RobotModel.for_robot(UR10 / "robot.yaml")
    campaign = Campaign.read(UR10 / "series_c.csv", drawing.definition)
    found = diagnose(campaign, calibrate(campaign, drawing).calibrated)
    assert found.verdict == "named"
    named, *others = found.effects
    assert named.cause.effect == "joint_periodic"
    assert not named.cause.alternatives
    assert {other.cause.effect for other in others} <= {"joint_placement"}
    assert {name.rpartition("_")[2] for name, _ in found.parameters_of(named)} == {str(k) for k in range(1, 31)}
    assert found.held_out.position("before") > 0.2e-3
    assert np.sqrt(3.0) * found.held_out.position("after") <= 0.12e-3


@pytest.mark.slow
def test_waves_that_one_series_taught_do_no_harm_at_angles_it_did_not_have():
    """The pan joint of series A never stood where it stands in series C, months later."""
    drawing = RobotModel.for_robot(UR10 / "robot.yaml")
    taught, other = (Campaign.read(UR10 / f"series_{name}.csv", drawing.definition) for name in "ca")
    only = {"joint_periodic", "joint_placement", "drive_compliance"}
    options = DiagnosisOptions(exclude=tuple({*all_effects(drawing.definition)} - only))
    found = diagnose(taught.subset(np.arange(1, len(taught), 4)), drawing, options)
    assert found.effects[0].cause.effect == "joint_periodic"
    model = found.amended
    learned = {name: one.model_copy(update={"seen_rad": {}}) for name, one in model.learned.items()}
    everywhere = model.model_copy(update={"learned": learned})
    held_out, _ = zip(*(figures(m, other) for m in (drawing, model, everywhere)), strict=True)
    before, near, anywhere = held_out
    assert near < 0.65 * before
    assert near < 0.85 * anywhere
