"""The amended model: it predicts what the diagnosis predicted, and nothing is missing in it."""

import importlib
from functools import partial

import numpy as np
import pytest

from pouring_robot.cli.app import main
from pouring_robot.diagnosis.amend import amended, stands_still
from pouring_robot.diagnosis.diagnose import diagnose
from pouring_robot.diagnosis.report.notes import note_lines
from pouring_robot.diagnosis.rows import CampaignRows
from pouring_robot.effects.base import EffectParameter
from pouring_robot.inference.thresholds import Thresholds
from pouring_robot.robot.model import RobotModel
from tests.diagnosis.hidden import CENTRES_AND_LOAD, DRIFT, HOT, NOTHING, ZEROS, campaign
from tests.rig import Wanted

CASES = {"hot": HOT, "centres_and_load": CENTRES_AND_LOAD, "drift": DRIFT, "zeros": ZEROS, "nothing": NOTHING}


@pytest.fixture(scope="module", params=CASES)
def case(request, diagnosed, tmp_path_factory):
    found = diagnosed(CASES[request.param], background=request.param == "hot")
    file = amended(found).save(tmp_path_factory.mktemp(request.param) / "model.yaml")
    return found, RobotModel.load(file), file


def test_it_reproduces_the_residuals_of_all_rows_after_a_round_trip(case):
    found, model, _ = case
    rows = CampaignRows(found.campaign.subset(found.inliers), model, found.noise)
    state = found.final.state
    again, after = rows.linearise(rows.unchanged(), state.frames), state.every_row
    np.testing.assert_array_equal(again.row, after.row)
    # 1e-6 m: the model composes placements, where the diagnosis adds twists.
    np.testing.assert_allclose(again.residual * again.sigma, after.residual * after.sigma, rtol=0.0, atol=1e-6)


def test_nothing_is_missing_in_it(case):
    found, model, _ = case
    again = diagnose(found.campaign, model)
    assert again.judgement.verdict == "no_gap"
    assert again.effects == ()
    floor = again.train.position("floor")
    assert again.train.position("before") < 1.2 * floor


def test_a_minor_drift_belongs_to_these_rows_and_not_to_the_robot(tmp_path, monkeypatch):
    """Another campaign has another drift: it is no cause here, so the model is fitted again without it."""
    data = campaign(tmp_path, (Wanted("drive_scale", 8.0, "a"), Wanted("base_drift", 3.0, "a")), kind="pair", seed=7)
    most = partial(Thresholds, minor_share=0.9, minor_evidence=np.inf)
    monkeypatch.setattr(importlib.import_module("pouring_robot.diagnosis.diagnose"), "Thresholds", most)
    found = diagnose(data)
    assert ([e.cause.effect for e in found.effects], found.judgement.minor) == (["drive_scale"], ("base_drift",))
    assert {entry.effect for entry in amended(found).effects} & {"drive_scale", "base_drift"} == {"drive_scale"}
    assert found.train.position("after") > 1.5 * found.train.position("floor")
    told = [line for line in note_lines(found) if "base_drift" in line]
    assert told == [
        "left out of the model, as they add too little, or only what a larger cause does if its size varies, and "
        "depend on this campaign's own time or sessions: base_drift"
    ]


def test_every_parameter_is_in_the_stack_with_value_and_unit(case):
    found, model, _ = case
    entries = {(e.effect, name): p for e in model.effects for name, p in e.parameters.items()}
    for effect in found.effects:
        for p in effect.parameters:
            entry = entries[effect.cause.effect, p.parameter.name]
            assert entry.unit == p.parameter.unit
            assert entry.value == pytest.approx(p.value, abs=0.2 * p.std + 1e-9)  # one settling step apart
            assert entry.std == pytest.approx(p.std, rel=1e-3)


def test_constant_displacements_become_placements_and_others_do_not(case):
    _, model, _ = case
    for entry in model.effects:
        assert entry.placed == (entry.effect in {"joint_centre_offset", "joint_axis_tilt", "drive_zero_offset"})
    moved = any(e.placed for e in model.effects)
    assert moved == (not model.is_drawing)


def test_an_offset_found_is_an_offset_of_the_drive(diagnosed):
    found = diagnosed(ZEROS)
    assert [e.cause.effect for e in found.effects] == ["drive_zero_offset"]
    values = {p.parameter.name: p.value for p in found.effects[0].parameters}
    offsets = amended(found).drive_offsets
    joints = {f"l{k}_offset": f"leg{k}_s3" for k in (1, 2, 3)}
    found = {name: offsets[joint].offset_mm for name, joint in joints.items() if joint in offsets}
    assert found and found == pytest.approx({name: values[name] for name in joints if name in values}, abs=1e-3)


def test_other_commands_report_what_they_leave_out(case, capsys):
    _, model, file = case
    stays = {e.effect for e in model.effects if not e.placed}
    assert main(["robots", "--model", str(file)]) == 0
    said = capsys.readouterr().err
    assert all(effect in said for effect in stays)
    assert ("does not apply" in said) == bool(stays)


def test_a_second_effect_is_added_to_the_first(diagnosed):
    found = diagnosed(CENTRES_AND_LOAD)
    data, whole = found.campaign, amended(found)
    kept = [entry for entry in whole.effects if entry.effect != "leg_compliance"]
    second = diagnose(data, whole.model_copy(update={"effects": kept}))
    assert [e.cause.effect for e in second.effects] == ["leg_compliance"]
    model = amended(second)
    assert model.effects[: len(kept)] == kept
    assert [e.effect for e in model.effects if not e.placed] == ["leg_compliance"]
    assert diagnose(data, model).judgement.verdict == "no_gap"


@pytest.mark.parametrize(
    ("changes", "still"),
    [
        ({"drive.leg1_s3": np.ones(3)}, True),
        ({"drive.leg1_s3": np.array([1.0, 1.0, 2.0])}, False),
        ({"base.tz": np.ones(3)}, False),
        ({"drive.leg1_s3": np.ones(3), "metrology.scale": np.ones(3)}, False),
        ({"leg1_s1.tx": np.zeros(3)}, True),
    ],
)
def test_which_displacements_are_constant(changes, still):
    parameter = EffectParameter("p", "mm", 1.0, changes)
    assert stands_still(parameter, ("drive.leg1_s3", "leg1_s1.tx")) == still
