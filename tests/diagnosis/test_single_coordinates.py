"""Campaigns in which one coordinate was not measured, or a different one in each row: diagnosed and calibrated."""

import json

import numpy as np
import pandas as pd
import pytest

from pouring_robot.campaign.data import Campaign
from pouring_robot.cli.app import main
from pouring_robot.diagnosis.diagnose import diagnose
from pouring_robot.diagnosis.suggest.candidates import PredictedMeasurements, candidates
from tests.support import ROOT

ROBOT = str(ROOT / "examples" / "robots" / "five_bar" / "robot.yaml")
COORDINATES = ["x_mm", "y_mm", "z_mm"]
UNSEEN = "mistakes in axes, signs or rows are not detected: 0 rows have a complete position"


@pytest.fixture
def campaign(tmp_path):
    """Return a function that writes a campaign of positions without some of their cells, given by row."""

    def written(missing):
        path = tmp_path / "c.csv"
        options = ("--robot", ROBOT, "--random", "30", "--seed", "1", "--position-only", "--quiet")
        assert main(["campaign", "simulate", *options, "--out", str(path)]) == 0
        table = pd.read_csv(path)
        for row in table.index:
            table.loc[row, COORDINATES[missing(row)]] = np.nan
        table.to_csv(path, index=False)
        return str(path)

    return written


@pytest.mark.parametrize("missing", [lambda row: 2, lambda row: row % 3])
def test_no_row_needs_all_three_coordinates(campaign, tmp_path, capsys, missing):
    assert main(["diagnose", campaign(missing), "--robot", ROBOT, "--out", str(tmp_path / "d")]) == 0
    assert UNSEEN in " ".join(capsys.readouterr().out.split())
    assert "<svg" in (tmp_path / "d" / "report.html").read_text(encoding="utf-8")


def test_the_tool_is_known_in_the_base_where_a_coordinate_was_not_measured(campaign, tmp_path, capsys):
    """In the tracker's axes it is as unknown as the tracker's position along that coordinate: decimetres."""
    assert main(["calibrate", campaign(lambda row: 2), "--robot", ROBOT, "--out", str(tmp_path / "c")]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert UNSEEN in said
    assert "in the robot's base, as the data hardly determine where device" in said
    ladle = json.loads((tmp_path / "c" / "calibration.json").read_text(encoding="utf-8"))["ladle"]
    assert ladle["axes"] == "base"
    assert ladle["half_width95_mm"]["largest"] < 20.0


def test_coordinates_that_are_not_measured_are_not_suggested(campaign):
    """An instrument that reads two coordinates of the target reads two in the next poses, and they count as two."""
    found = diagnose(Campaign.read(campaign(lambda row: 2), ROBOT))
    prospect = PredictedMeasurements(found, candidates(found.rows.campaign, found.model, 10, 0))
    assert prospect.components == 2
    assert len(prospect.frames) == 20
