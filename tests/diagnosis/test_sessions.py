"""Causes that follow a campaign's sessions or the order of its rows: named, with what cannot be predicted."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from pouring_robot import Campaign, RobotModel, diagnose
from pouring_robot.campaign.plan import random_plan
from pouring_robot.diagnosis.diagnose import DiagnosisOptions
from pouring_robot.diagnosis.report.notes import note_lines
from pouring_robot.diagnosis.report.sentences import next_lines
from pouring_robot.robot.robot import Robot
from tests.diagnosis.hidden import campaign as hidden
from tests.rig import Wanted
from tests.support import ROOT

ARM = ROOT / "examples" / "robots" / "arm" / "robot.yaml"
SIGMA_MM = 0.03


SESSION = np.repeat(np.arange(4), 15)


def measured(folder, moved_mm):
    """Write and read sixty poses of the arm in four sessions, moved by (60, 3) in mm, given the flange's rotations."""
    arm, rng = Robot.load(ARM), np.random.default_rng(0)
    drives = random_plan(arm, 60, 3).drives
    flange = arm.locate_drives(drives).sel(frame="flange")
    turns = Rotation.from_rotvec(flange.actual_rotation.values)
    seen = 1e3 * flange.actual_position.values + moved_mm(turns, rng) + rng.normal(0.0, SIGMA_MM, (60, 3))
    table = pd.DataFrame(seen, columns=["x_mm", "y_mm", "z_mm"])
    for k, drive in enumerate(arm.model.definition.drives):
        table[f"{drive.column}_deg"] = np.degrees(drives[:, k])
    table["session"] = np.array(list("abcd"))[SESSION]
    table.to_csv(folder / "c.csv", index=False)
    (folder / "c.yaml").write_text(f"metrology: {{sigma_position_mm: {SIGMA_MM}}}\n", encoding="utf-8")
    return Campaign.read(folder / "c.csv", ARM)


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    """Each session sees the arm from another position, 1 mm apart."""
    return measured(tmp_path_factory.mktemp("sessions"), lambda _, rng: rng.normal(0.0, 1.0, (4, 3))[SESSION])


@pytest.fixture(scope="module")
def found(campaign):
    return diagnose(campaign, RobotModel.for_robot(ARM))


def test_a_shift_without_a_rotation_is_named_as_a_moved_instrument(found):
    assert (found.verdict, [e.cause.effect for e in found.effects]) == ("named", ["session_offset"])
    assert {p.parameter.unit for p in found.effects[0].parameters} == {"mm"}
    assert found.train.position("after") < 1.2e-3 * SIGMA_MM
    moved = np.random.default_rng(0).normal(0.0, 1.0, (4, 3))
    told = found.effects[0].parameters[:12]
    # A mean of 15 rows against one of 60, and little more from the frames; the common part is in no interval.
    np.testing.assert_allclose([p.std for p in told], SIGMA_MM * np.sqrt(1 / 15 - 1 / 60), rtol=0.1)
    np.testing.assert_allclose([p.value for p in told], (moved - moved.mean(axis=0)).ravel(), atol=4 * told[0].std)
    said = "no other session shows what session_offset is in session d, which is held out"
    assert any(line.startswith(said) for line in note_lines(found))


def test_a_target_that_slipped_on_the_flange_is_described_as_unknown(tmp_path):
    """By half a millimetre, before the third session: the shift in the tracker's axes turns with the flange."""
    slipped = [0.4, 0.3, 0.0] * (SESSION >= 2)[:, None]
    found = diagnose(measured(tmp_path, lambda turns, _: turns.apply(slipped)), RobotModel.for_robot(ARM))
    (left,) = found.remainder
    assert (found.verdict, left.structure.process.name) == ("unknown", "target by session")
    assert not found.firm
    assert any("slipped" in line for line in next_lines(found))


def test_a_session_for_each_row_is_no_session(campaign):
    found = diagnose(replace(campaign, sessions=[str(k) for k in range(len(campaign))]), RobotModel.for_robot(ARM))
    assert found.untestable["session_offset"] == ("session",)
    assert "60 sessions in 60 rows" in " ".join(map(str, found.flags))


def test_a_start_with_forms_the_rows_do_not_have_is_ignored(found):
    """As where a whole session is left out, or the forces of the remaining rows make two forms one."""
    (item,) = found.hypothesis.items
    gone = replace(found.hypothesis, items=(replace(item, form="of_another_session"),))
    assert found.diagnoser.found(gone)[1].keys == found.hypothesis.keys


def test_with_a_region_held_out_the_gap_closes(campaign):
    found = diagnose(campaign, RobotModel.for_robot(ARM), DiagnosisOptions(hold_out="region"))
    assert found.held_out.position("after") < 1.5e-3 * SIGMA_MM
    assert not any("no other session shows" in line for line in note_lines(found))


def test_a_drift_in_rows_without_times_is_not_passed_to_other_commands(tmp_path):
    without = hidden(tmp_path, (Wanted("base_drift", 6.0, "a"),), rows=45).with_conditions(time=None)
    found = diagnose(without)
    assert [effect.cause.effect for effect in found.effects] == ["base_drift"]
    assert any(line.startswith("without times it is unknown what base_drift does") for line in note_lines(found))
