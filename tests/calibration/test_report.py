"""The exit report: every figure that a shop-floor engineer asks for, as text and as a page."""

import dataclasses
import re
from html.parser import HTMLParser

import numpy as np
import pytest

from pouring_robot.calibration.findings import parameter_lines
from pouring_robot.calibration.report import (
    combination_table,
    effect_table,
    gap_table,
    group_lines,
    html_report,
    ladle_line,
    parameter_table,
    performance_line,
    split_line,
)
from pouring_robot.calibration.summary import calibration_metrics, warnings_of
from pouring_robot.checks.flags import DataFlag, FlagCode, Severity
from pouring_robot.estimation.intervals import Z95
from pouring_robot.estimation.noise import Noise, NoiseLevel


def test_the_headline_states_the_outcome(found, unchanged):
    test = found.split.test
    before, after = (found.misfit(test, after=a).rms_mm for a in (False, True))
    assert f"{before:.3f} to {after:.3f} mm" in found.headline
    assert "noise floor" in found.headline
    left = unchanged.misfit(unchanged.split.test, after=False)
    # Rotations are given next to positions, as the error may be in them.
    assert unchanged.headline.startswith(
        f"Nothing to calibrate: held-out rows are at {left.rms_mm:.3f} mm RMS and {left.rms_mrad:.3f} mrad; noise "
    )


@pytest.mark.parametrize("name", ["found", "unchanged"])
def test_the_headline_says_what_was_not_measured_in_the_held_out_rows(name, request):
    calibration = request.getfixturevalue(name)
    before, after = calibration.before.copy(), calibration.after.copy()
    before[calibration.split.test, :3] = after[calibration.split.test, :3] = np.nan
    said = dataclasses.replace(calibration, before=before, after=after).headline
    turned = calibration.misfit(calibration.split.test, after=False).rms_mrad
    assert "(no position measured)" in said
    assert f"{turned:.3f}" in said
    assert "mrad RMS" in said
    assert " mm" not in said
    assert "nan" not in said


def test_the_noise_floor_is_that_of_what_was_measured_in_the_rows(found):
    """The held-out rows have distances only, the fitted ones positions: each is compared with its own noise."""
    noise = NoiseLevel({"position": Noise(1e-4, "stated"), "distance": Noise(7e-4, "stated")})
    before = np.full((len(found.before), 7), np.nan)
    before[found.split.train, :2], before[found.split.test, 6] = 1e-3, 1e-3
    mixed = dataclasses.replace(found, noise=noise, before=before, after=before)
    line, place = (mixed.floor(rows) for rows in (found.split.test, found.split.train))
    assert (line["rms_mm"], line["p95_mm"]) == pytest.approx((0.7, 0.7 * Z95))
    assert (place["rms_mm"], place["p95_mm"]) == pytest.approx((0.1, 0.1 * np.sqrt(-2.0 * np.log(0.05))))
    assert "noise floor 0.700 mm" in mixed.headline
    assert [row[:3] for row in gap_table(mixed).rows[4:]] == [
        ("noise", "held out", "0.7000"),
        ("noise", "fitted", "0.1000"),
    ]


def test_rows_that_are_left_out_are_counted_and_named(found):
    for left_out, said in (([], "0 rows"), ([3], "1 row (line 5)"), ([3, 4], "2 rows (lines 5, 6)")):
        line = split_line(dataclasses.replace(found, left_out=np.array(left_out, dtype=np.intp)))
        assert line.endswith(f"left out: {said}")


def test_the_reason_is_given_for_rows_left_out_beyond_limits(found):
    """For a real arm a quarter of the rows were, and no reason was given."""
    flag = DataFlag(FlagCode.UNREACHABLE_DRIVES, Severity.ERROR, "the robot cannot take these", "mend the limits", (3,))
    assert "the robot cannot take these" in warnings_of(dataclasses.replace(found, flags=(flag,)))


def test_the_median_of_the_ladle_is_that_of_the_figures(found):
    ladle = dataclasses.replace(found.ladle, position_m=found.ladle.position_m[:2], std_m=np.array([[1e-3], [3e-3]]))
    few = dataclasses.replace(found, ladle=ladle)
    median = calibration_metrics(few)["ladle"]["half_width95_mm"]["median"]
    assert f"±{median:.3f} mm (95 %, median of 2 poses)" in ladle_line(few)


def test_before_after_and_floor_in_mm_and_mrad(found):
    table = gap_table(found)
    rows = table.rows
    assert [row[:2] for row in rows] == [
        ("held out", "before"),
        ("held out", "after"),
        ("fitted", "before"),
        ("fitted", "after"),
        ("noise", "floor"),
    ]
    assert all(len(row) == len(table.head) for row in rows)
    for column in (2, 3, 4, 5, 6, 7):
        assert float(rows[0][column]) > 0.0
    assert float(rows[1][2]) < float(rows[0][2])


def test_accuracy_and_repeatability(found, unchanged):
    line = performance_line(found)
    assert "4 poses, 6 or more repeats" in line
    before, after, repeatability = (float(x) for x in re.findall(r"([0-9.]+) mm", line)[:3])
    assert before > 3.0 * after
    assert 0.0 < repeatability < 1.0
    assert "unknown" in performance_line(unchanged)


def test_tables_fit_their_headings(found):
    assert effect_table(found).rows[0][0].startswith(("places", "axes"))
    assert all(len(row[0]) <= 30 for row in combination_table(found, 30).rows)
    assert not any("-0%" in row for row in parameter_table(parameter_lines(found)).rows)
    assert any("identifiable:" in line for line in group_lines(found))
    assert "95 %" in ladle_line(found)


class Reader(HTMLParser):
    def __init__(self):
        super().__init__()
        self.open, self.outside, self.text = [], [], []

    def handle_starttag(self, tag, attrs):
        if tag not in ("meta", "img"):
            self.open.append(tag)
        self.outside += [v for k, v in attrs if k in ("src", "href") and not v.startswith("data:")]

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)


def test_the_page_is_complete_and_needs_no_other_file(found, unchanged):
    for calibration in (found, unchanged):
        reader = Reader()
        reader.feed(html_report(calibration))
        assert not reader.open
        assert reader.outside == ["calibrated.yaml", "calibration.json"]  # next to it
        text = " ".join(reader.text)
        for heading in (
            "Calibration with ",
            "Error before and after",
            "What moved",
            "What to measure next",
            "How groups were chosen",
        ):
            assert heading in text


def test_an_empty_part_of_the_page_says_so(found):
    kept = dataclasses.replace(found, selection=dataclasses.replace(found.selection, steps=()), flags=())
    told = re.sub(r"<[^>]+>|\s+", " ", html_report(kept)).split("How groups were chosen")[1].split()
    assert " ".join(told).startswith("all were kept, as asked for Findings of the data checks nothing")
