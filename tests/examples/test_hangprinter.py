"""The Hangprinter: no tracker, only lines that must agree. One command names anchors and build-up, but no stretch."""

import contextlib
import importlib
import io
import shlex
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import pouring_robot
from pouring_robot.cli.app import main
from pouring_robot.diagnosis.report.sentences import gap_sentence
from pouring_robot.exceptions import BadInputError
from tests.docs.shown import assert_shown, commands, fences
from tests.support import ROOT

MACHINE = ROOT / "examples/machines/hangprinter"
PAGE = ROOT / "docs/lines_and_distances.md"


@pytest.fixture(scope="module")
def told(tmp_path_factory):
    """What the page says that its command prints, what it prints, its folder, and the diagnosis that it made."""
    ((command, shown),) = [one for _, text in fences(PAGE, "console") for one in commands(text) if "diagnose" in one[0]]
    module, folder, made = importlib.import_module("pouring_robot.diagnosis.diagnose"), tmp_path_factory.mktemp("a"), []
    diagnose = module.diagnose
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(io.StringIO()) as printed:
        patch.setattr(module, "diagnose", lambda *given: made.append(diagnose(*given)) or made[0])
        patch.setenv("COLUMNS", "120")
        patch.chdir(folder)
        Path("examples").symlink_to(ROOT / "examples")
        assert main(shlex.split(command)[1:]) == 0
    return shown, printed.getvalue(), folder / "found", *made


@pytest.fixture(scope="module")
def found(told):
    return told[-1]


def test_the_command_prints_what_its_page_shows(told):
    shown, printed, *_ = told
    assert_shown(shown, printed)


def test_a_report_without_a_tracker_speaks_of_none(told):
    page = (told[2] / "report.html").read_text(encoding="utf-8")
    assert "The gap of each component, before and after (RMS, logarithmic)" in page and "'s axes" not in page


def test_anchors_and_build_up_are_named_and_stretch_is_not(found):
    assert (found.verdict, found.misfit) == ("named", "")
    assert [effect.cause.effect for effect in found.effects] == ["joint_placement", "drive_scale"]
    values = {name: p.value for effect in found.effects for name, p in found.parameters_of(effect)}
    # A line that lies in layers: each turn pays out less the more is out already.
    assert all(values[f"line_{line}_progression"] < 0.0 for line in "abcd")
    assert found.spare["drive_compliance"] < 0.0


def test_a_misfit_that_is_too_large_for_noise_is_no_calm(tmp_path):
    """Angles of two motors that belong to other rows: nothing explains what is left, and no noise is stated."""
    table = pd.read_csv(MACHINE / "samples.csv").iloc[:12]
    for k, line in enumerate("cd", start=10):  # of other orders the search tries anchors metres away for twice as long
        table[f"line_{line}_deg"] = np.random.default_rng(k).permutation(table[f"line_{line}_deg"])
    table.to_csv(tmp_path / "samples.csv", index=False)
    shutil.copy(MACHINE / "samples.yaml", tmp_path)
    model = pouring_robot.RobotModel(robot=str(MACHINE / "robot.yaml"))
    found = pouring_robot.diagnose(tmp_path / "samples.csv", model)
    assert found.noise["closure"].sigma > 0.2
    assert found.verdict == "unknown"
    assert found.headline.startswith("UNKNOWN: the residuals are too large for noise: ")
    assert "RMS per closure, where all errors within the tolerances make " in found.misfit


def test_what_is_no_credible_robot_is_no_cause(monkeypatch, tmp_path):
    """Anchors metres away, which explain a motor that counts the other way; here any anchor is taken for one."""
    pd.read_csv(MACHINE / "samples.csv").iloc[:12].to_csv(tmp_path / "samples.csv", index=False)
    shutil.copy(MACHINE / "samples.yaml", tmp_path)

    def refuse(_):
        raise BadInputError("anchor_b_X is displaced by 250 mm")

    monkeypatch.setattr(pouring_robot.RobotModel, "check_errors", refuse)
    model = pouring_robot.RobotModel(robot=str(MACHINE / "robot.yaml"))
    found = pouring_robot.diagnose(tmp_path / "samples.csv", model)
    assert (found.verdict, found.amended) == ("unknown", found.model)
    assert found.headline.startswith(
        "UNKNOWN: what was found makes no credible robot (the fit is not credible: anchor_b_X "
    )
    assert "sure" not in found.headline


def test_held_out_lines_agree(found):
    before, after = (1e3 * found.held_out.position(which) for which in ("before", "after"))
    assert before > 30.0
    assert after < 1.2  # six rows of a region that no other row is in
    assert 1e3 * found.train.position("after") < 0.5
    assert (found.in_turn.blocks, found.in_turn.agreed) == (5, 5)
    assert 1e3 * found.in_turn.gap.position("after") < 1.5


def test_what_is_found_is_a_robot_whose_lines_agree(told):
    model = pouring_robot.RobotModel.load(told[2] / "model.yaml")
    assert set(model.joint_placements) == {"anchor_b_X", "anchor_c_X", "anchor_d_X"}
    assert [(entry.effect, entry.placed) for entry in model.effects if not entry.placed] == [("drive_scale", False)]


def test_it_says_that_the_rows_are_few_and_what_lines_cannot_tell(found):
    from pouring_robot.diagnosis.report.notes import note_lines

    notes = "\n".join(note_lines(found))
    assert (found.campaign.redundant_drives, found.campaign.seen) == (1, "closures")
    assert "44 rows are few" in notes
    assert "only ratios of lengths" in notes


def test_a_few_places_beside_the_lines_say_the_same_and_predict_better():
    """Nine poses seen by a camera, eight of them in two coordinates: rows of two instruments in one fit."""
    model = pouring_robot.RobotModel(robot=str(MACHINE / "robot.yaml"))
    found = pouring_robot.diagnose(MACHINE / "with_camera.csv", model)
    assert [effect.cause.effect for effect in found.effects] == ["joint_placement", "drive_scale"]
    assert found.spare["drive_compliance"] < 0.0
    closure = 7
    assert 1e3 * found.held_out.after[closure] < 0.75
    assert 1e3 * found.train.position("after") < 1.0
    assert not np.isfinite(found.held_out.after[:closure]).any()
    assert found.train.counts[[0, 1, 2, closure]].tolist() == [9, 9, 1, 38]
    assert 1e3 * found.train.position("before") == pytest.approx(28.686, abs=0.01)
    assert gap_sentence(found).startswith("Held-out rows (no position measured): 33.957 mm RMS per closure before, ")
