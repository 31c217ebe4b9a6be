"""Interpretations of what the paper leaves open: their sizes, their robots, and scores that follow from verdicts."""

import numpy as np
import pytest

from pouring_robot.robot.pouring.layout import load_layout
from pouring_robot.robot.pouring_robot import PouringRobot
from scripts.paper.geometry.study import run_open_study
from scripts.paper.readings import (
    COLDEST_DEGC,
    NORMALS,
    SIZES,
    STATISTICS,
    ReadingsReport,
    Scored,
    Sizes,
    _geometry,
    models,
)


@pytest.mark.parametrize(("layout", "sizes"), [("paper", Sizes("Mm", "Mm")), ("wide", Sizes("Nn", ""))])
def test_the_shipped_layouts_are_two_of_them(layout, sizes):
    shipped = load_layout(layout)
    for centres, own in zip(
        sizes.centres_mm(), (shipped.fixed_centres.metres, shipped.moving_centres.metres), strict=True
    ):
        np.testing.assert_allclose(np.array(centres) / 1e3, own)
    assert sizes in SIZES and len(set(SIZES)) == 8


def test_a_reading_is_a_robot_and_the_papers_own_agrees_with_the_study(tmp_path):
    robots = models(tmp_path)
    wanted = Sizes("Mm", "Mm")
    assert np.allclose(
        PouringRobot(robots[wanted]).layout.fixed_centres.metres, load_layout("paper").fixed_centres.metres
    )
    study = run_open_study(robots[wanted], 400, 5, chain=1)
    one, other = (_geometry(study, normals, "largest") for normals in NORMALS)
    assert one["both_signs"] == "reproduced" and other["both_signs"] == "differs"
    assert {key for key in one if one[key] != other[key]} == {"both_signs"}
    turned = run_open_study(robots[wanted], 400, 5, chain=1, tilt_sign=-1.0)
    assert turned.command.poses[:, 3] == pytest.approx(-study.command.poses[:, 3])


def test_scores_count_what_is_reproduced():
    def scored(sizes, first, heat):
        return [
            Scored(sizes, "as printed", normals, statistic, cold, {"a": first, "b": "differs"}, heat)
            for normals in NORMALS
            for statistic in STATISTICS
            for cold in COLDEST_DEGC
        ]

    good, lost = scored(SIZES[0], "reproduced", {"c": "reproduced"}), scored(SIZES[1], "differs", None)
    assert good[0].score == (1, 1) and lost[0].score == (0, 0)
    report = ReadingsReport(1, [*good, *lost])
    assert "most in all: 2 of 3" in report.text() and "out of" in report.text()
    assert {row["c"] for row in report.claim_rows()} == {"reproduced", "out of reach"}
