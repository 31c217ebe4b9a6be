"""A gross error that pulls the fit towards itself, and an unknown cause, for which no row is left out."""

from dataclasses import replace

import numpy as np
import pytest

from pouring_robot.checks.flags import wrong_rows
from pouring_robot.diagnosis.diagnose import diagnose
from pouring_robot.estimation.splits import split
from tests.diagnosis.hidden import campaign, distances_of_an_arm, stepped
from tests.rig import Wanted

ROW, OFF_M = 20, 10e-3


@pytest.fixture(scope="module")
def sagging(tmp_path_factory):
    """Return a truss that yields by as much as one row is off, so that the checks beforehand cannot find the row."""
    causes = (Wanted("truss_deflection", 8.0, "a"),)
    data = campaign(tmp_path_factory.mktemp("gross"), causes, rows=48, full_pose=False, background=True)
    position = np.array(data.position_m)
    position[ROW] += OFF_M / np.sqrt(3.0) * np.array([1.0, -1.0, 1.0])
    return replace(data, position_m=position)


@pytest.mark.parametrize("others", [[], [3, 11, 27, 36, 44]])
def test_the_row_is_left_out_and_the_cause_named(sagging, others):
    """Of 48 rows, also where the checks flag five others: the row is no sixth one of those."""
    position = np.array(sagging.position_m)
    position[others] += 30.0 * OFF_M
    found = diagnose(replace(sagging, position_m=position))
    assert wrong_rows(found.flags).tolist() == others
    assert (found.verdict, [e.cause.effect for e in found.firm]) == ("named", ["truss_deflection"])
    assert found.left_out.tolist() == sorted([ROW, *others])


def test_an_error_that_many_rows_show_is_no_gross_error(tmp_path):
    assert diagnose(stepped(tmp_path)).left_out.size == 0


def two_causes(folder):
    """Return fifty poses of a machine with two large causes."""
    causes = (Wanted("base_drift", 25.0, "b"), Wanted("drive_cyclic", 25.0, "a"))
    return campaign(folder, causes, rows=50, full_pose=False)


def found_without(data, rows, off_m):
    """Diagnose rows of which some are off; return those left out, and the causes that are almost certain."""
    position = np.array(data.position_m)
    position[rows] += off_m
    found = diagnose(replace(data, position_m=position))
    return found.left_out.tolist(), {e.cause.effect for e in found.firm if e.cause.probability > 0.95}


@pytest.mark.parametrize("along", [([0, 1, 0], [0, 1, 0]), ([1, 0, 0], [0, 1, 0])])
def test_two_rows_that_keep_two_causes_from_being_found_are_left_out(tmp_path, along):
    """They hide in the tails of causes not found; what was found with them is no start for the search without them."""
    rows = [6, 31]
    assert found_without(two_causes(tmp_path), rows, 18e-3 * np.array(along)) == (rows, {"base_drift", "drive_cyclic"})


@pytest.mark.parametrize("rows", [[22], [18, 48]])
def test_held_out_rows_are_tested_like_all_others(tmp_path, rows):
    """They would spoil the held-out error of the amended model and, where few rows are held out in turn, the causes."""
    data = two_causes(tmp_path)
    assert {*rows} <= {*split(data, np.zeros(0, dtype=np.intp), "auto").test.tolist()}
    assert found_without(data, rows, [0.0, 18e-3, 0.0]) == (rows, {"base_drift", "drive_cyclic"})


def test_an_effect_that_absorbs_any_row_does_not_hide_a_wrong_one(tmp_path):
    """Eighty distances of an arm and waves of all its joints, which leave no residual even with one distance off."""
    data = distances_of_an_arm(tmp_path, "lost_motion", ratio=8.0)
    distance = np.array(data.distance_m)
    distance[ROW] += 0.5 * OFF_M
    found = diagnose(replace(data, distance_m=distance).subset(np.arange(80)))
    assert (found.verdict, [e.cause.effect for e in found.firm]) == ("named", ["drive_backlash"])
    assert found.left_out.tolist() == [ROW]


FEW_WRONG = np.array([0.0, 0.005, -0.006])


@pytest.mark.parametrize("causes", [(), (Wanted("truss_deflection", 8.0, "a"),)])
def test_in_few_rows_a_wrong_one_is_left_out_and_no_cause_is_named_for_it(tmp_path, causes):
    """Effects absorb it: the nine rows have no residual left."""
    row, data = 4, campaign(tmp_path, causes, rows=40, full_pose=False).subset(np.arange(9))
    position = np.array(data.position_m)
    position[row] += FEW_WRONG
    found, sound = diagnose(replace(data, position_m=position)), diagnose(data)
    assert (found.left_out.tolist(), sound.left_out.tolist()) == ([row], [])
    assert found.verdict == sound.verdict
    assert [e.cause.effect for e in found.firm] == [e.cause.effect for e in sound.firm] == [c.effect for c in causes]


def test_where_too_few_rows_would_remain_the_one_to_be_measured_again_is_reported(tmp_path):
    data = campaign(tmp_path, (), rows=40).subset(np.arange(8))
    position = np.array(data.position_m)
    position[2] += [0.0, 0.05, -0.03]
    found = diagnose(replace(data, position_m=position))
    assert (found.left_out.size, found.verdict) == (0, "unknown")
    assert f"line {data.lines[2]} may be wrong" in found.headline
