"""Output files: complete, reloadable, and never silent about what is unknown."""

import json
import os
from dataclasses import replace

import pytest

from pouring_robot.calibration.report import described, write_calibration
from pouring_robot.exceptions import BadInputError, OutputError
from pouring_robot.io.files import check_folder
from pouring_robot.robot.heat_section import HeatSection
from pouring_robot.robot.model import RobotModel


def test_all_files_are_written_and_the_model_can_be_read_back(found, tmp_path):
    written = write_calibration(found, tmp_path / "out")
    names = {path.name for path in written}
    assert names == {"calibrated.yaml", "calibration.json", "loops.yaml", "pouring_robot.urdf", "report.html"}
    assert {path.name for path in (tmp_path / "out").iterdir()} == {*names, "meshes"}
    model = RobotModel.load(tmp_path / "out" / "calibrated.yaml")
    assert model.joint_placements.keys() == found.calibrated.joint_placements.keys()
    assert json.loads((tmp_path / "out" / "calibration.json").read_text())["status"] == "calibrated"
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_a_rank_deficient_fit_is_reported_in_every_file(found, tmp_path, undrawn):
    assert found.base.deficient
    write_calibration(found, tmp_path / "out")
    assert RobotModel.load(tmp_path / "out" / "calibrated.yaml").description.startswith("Rank deficient")
    assert json.loads((tmp_path / "out" / "calibration.json").read_text())["rank_deficient"] is True
    assert "rank deficient" in (tmp_path / "out" / "report.html").read_text()


def test_a_model_that_is_worse_on_held_out_rows_is_marked(found):
    worse = replace(found, before=found.after, after=found.before)
    assert "do not use this model" in described(worse).description


def test_a_failure_leaves_the_folder_as_it_was(found, tmp_path, monkeypatch, undrawn):
    write_calibration(found, tmp_path / "out")
    before = {path: path.read_bytes() for path in (tmp_path / "out").rglob("*") if path.is_file()}

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OutputError, match="No space left"):
        write_calibration(found, tmp_path / "out", overwrite=True)
    assert {path: path.read_bytes() for path in (tmp_path / "out").rglob("*") if path.is_file()} == before
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_placements_that_cannot_be_written_are_named(tmp_path):
    (tmp_path / "file").write_text("x")
    with pytest.raises(OutputError, match="give a folder"):
        check_folder(tmp_path / "file")
    with pytest.raises(OutputError, match="does not exist"):
        check_folder(tmp_path / "no" / "where")
    with pytest.raises(BadInputError, match="a folder for results is a path, not a NoneType"):
        check_folder(None)


def test_the_model_file_says_that_heat_was_not_used(found):
    warm = found.present.model_copy(update={"heat": HeatSection()})
    assert "heat section" not in described(found).description
    assert "heat section of the model was not used" in described(replace(found, present=warm)).description
