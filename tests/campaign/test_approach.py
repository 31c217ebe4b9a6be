"""The side of approach of each drive, from the row before where the table does not state it."""

import numpy as np
import pandas as pd
import pytest

from pouring_robot.campaign.columns import from_the_row_before
from pouring_robot.campaign.data import Campaign
from pouring_robot.campaign.plan import approaches
from pouring_robot.exceptions import DescriptionError
from pouring_robot.robot.model import RobotModel
from tests.campaign.simulated import write_text
from tests.support import ROOT

HEADER = "time_s,q1_mm,q2_mm,q3_mm,q4_rad,x_mm,y_mm,z_mm"
# In order of time: 2, 0, 1, 3. The second leg stands still but for jitter, the last drive turns in the last row only.
ROWS = (
    "20,510,500,600,0.1,1,2,3",
    "30,490,500.00001,600,0.1,1,2,3",
    "10,500,500,500,0.1,1,2,3",
    "40,490,500,600,0,1,2,3",
)
SIDES = [[1, np.nan, 1, np.nan], [-1, np.nan, 1, np.nan], [np.nan] * 4, [-1, np.nan, 1, -1]]
BY_ORDER = "drives: {approach: row before}\n"


def test_a_drive_came_from_where_it_stood_and_is_where_it_was_left(tmp_path):
    campaign = Campaign.read(write_text(tmp_path, HEADER, ROWS, BY_ORDER))
    np.testing.assert_array_equal(campaign.approach, SIDES)
    assert Campaign.read(write_text(tmp_path, HEADER, ROWS, "robot: pouring_robot\n")).approach is None


def test_without_all_times_rows_are_in_order():
    drives = np.array([[0.0, 0.0], [1.0, 1.0], [1.0 + 1e-6, 0.5], [0.0, np.nan], [0.5, 2.0]])
    expected = [[np.nan, np.nan], [1, 1], [1, -1], [-1, np.nan], [1, np.nan]]
    for time in (None, np.array([5.0, 4.0, 3.0, np.nan, 1.0])):
        np.testing.assert_array_equal(from_the_row_before(drives, time), expected)
    backwards = from_the_row_before(drives[::-1], np.arange(5.0)[::-1])
    np.testing.assert_array_equal(backwards[::-1], expected)


def test_what_the_table_says_counts_and_what_is_written_reads_the_same(tmp_path):
    rows = [f"{row},{said}" for row, said in zip(ROWS, ("-1", "", "1", ""), strict=True)]
    campaign = Campaign.read(write_text(tmp_path, f"{HEADER},approach_q1", rows, BY_ORDER))
    np.testing.assert_array_equal(campaign.approach[:, 0], [-1, -1, 1, -1])
    table, _ = campaign.save(tmp_path / "again.csv")
    again = Campaign.read(table)
    assert again.metadata == campaign.metadata
    np.testing.assert_array_equal(again.approach, campaign.approach)


def test_a_drive_rises_by_its_command(tmp_path):
    """A joint that falls where its command rises came from the other side, stated or by the row before."""
    folder = ROOT / "examples" / "robots" / "arm"
    (tmp_path / "arm.urdf").write_text(RobotModel.for_robot(folder / "robot.yaml").definition.urdf(), encoding="utf-8")
    text = (folder / "robot.yaml").read_text(encoding="utf-8").replace("xacro: arm.urdf.xacro", "urdf: arm.urdf")
    path = tmp_path / "robot.yaml"
    path.write_text(text.replace("column: q2", "column: q2, ratio: -0.5, zero: 0.1"), encoding="utf-8")
    robot = RobotModel.for_robot(path).definition
    commands = np.array([[0.0] * 6, [0.1] * 6, [-0.2] * 6])
    told = pd.DataFrame({f"q{k + 1}_rad": column for k, column in enumerate(commands.T)})
    told = told.assign(x_mm=1.0, y_mm=2.0, z_mm=3.0)
    rose = np.array([1.0, 1.0, -1.0])
    stated = Campaign.from_frame(told.assign(approach_q1=rose, approach_q2=rose), {}, robot)
    by_order = Campaign.from_frame(told, {"drives": {"approach": "row before"}}, robot)
    for campaign in (stated, by_order):
        np.testing.assert_array_equal(campaign.approach[1:, :2], [[1.0, -1.0], [-1.0, 1.0]])
        np.testing.assert_array_equal(campaign.to_frame().approach_q2[1:], rose[1:])
    for sides in approaches(robot, stated.drives).values():
        np.testing.assert_array_equal(sides, rose)


def test_another_word_is_refused(tmp_path):
    with pytest.raises(DescriptionError, match=r"drives\.approach"):
        Campaign.read(write_text(tmp_path, HEADER, ROWS, "drives: {approach: guess}\n"))


def test_what_creeps_rises_and_falls():
    """Steps far below what counts as standing still add up; a lost value does not make the others stand."""
    way = np.concatenate([np.linspace(0.0, 1.0, 15_000), np.linspace(1.0, 0.0, 15_000)])[:, None]
    sides = from_the_row_before(way)[:, 0]
    assert np.isnan(sides[0])
    assert (sides[10:15_000] == 1.0).all()
    assert (sides[15_010:] == -1.0).all()
    near = 0.5 + 3e-5 * np.array([[0.0], [1.0], [np.nan], [0.0], [-1.0]])
    np.testing.assert_array_equal(from_the_row_before(near)[:, 0], [np.nan, 1.0, np.nan, np.nan, -1.0])


def test_nobody_knows_where_the_first_of_a_session_came_from():
    drives, sessions = np.array([[0.0], [1.0], [0.5], [0.7]]), ("a", "a", "b", "b")
    np.testing.assert_array_equal(from_the_row_before(drives, None, sessions)[:, 0], [np.nan, 1.0, np.nan, 1.0])


def test_a_clock_that_begins_anew_mixes_no_sessions():
    drives, sessions = np.array([[0.0], [1.0], [0.5], [0.9], [0.7], [0.8]]), ("a", "a", "a", "b", "b", "b")
    sides = from_the_row_before(drives, np.array([0.0, 60.0, 120.0, 0.0, 50.0, 110.0]), sessions)[:, 0]
    np.testing.assert_array_equal(sides, [np.nan, 1.0, -1.0, np.nan, -1.0, 1.0])


def test_a_plan_says_the_same(drawing):
    """But that the first of all rose."""
    drives = np.array([[0.5, 0.5, 0.5, 0.0], [0.6, 0.4, 0.5, 0.1], [0.6, 0.4, 0.5, 0.0]])
    found = np.column_stack(list(approaches(drawing.model.definition, drives).values()))
    np.testing.assert_array_equal(found, [[1, 1, 1, 1], [1, -1, 1, 1], [1, -1, 1, -1]])
