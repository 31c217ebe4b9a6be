"""Rows whose target was held at a place, and arms that change their posture: neither is a fault of the tracker."""

import dataclasses

import numpy as np
import pytest

from pouring_robot.campaign.nominal import PoseStack, nominal_poses
from pouring_robot.checks.check import check_campaign
from pouring_robot.checks.flags import FlagCode, Severity, wrong_rows
from pouring_robot.checks.smooth_errors import Aligned
from pouring_robot.checks.stationary_target import held_rows
from pouring_robot.mechanism.rotations import rotation_vectors
from tests.campaign.simulated import codes
from tests.checks.test_any_robot import EXAMPLES, Machine

BALL = np.array([0.02, -0.03, 0.12])  # position of the ball on the tool, in m
ZEROS = 1e-3 * np.array([0.0, 4.0, -6.0, 5.0, -4.0, 0.0])  # offsets of the drives of the arm, in rad
ELBOW_UP_AND_DOWN = np.array([[0.66, 1.41, -1.87, 0.24, 1.51, -3.26], [0.66, 0.91, -0.89, 0.28, 1.05, -3.38]])  # rad


@pytest.fixture(scope="module")
def arm():
    return Machine(EXAMPLES / "robots" / "arm" / "robot.yaml", count=200)


def ball(arm, drives):
    """Return the position of the ball of the real arm, (n, 3), in m, for commands."""
    poses = nominal_poses(arm.drawing, drives + ZEROS)
    return poses.position_m + poses.rotation @ BALL


def brought(arm, drives, places):
    """Return commands (n, 6) near others that bring the ball to positions (n, 3)."""
    small = 1e-6 * np.eye(6)
    for _ in range(60):
        off = places - ball(arm, drives)
        slope = np.stack([(ball(arm, drives + step) - ball(arm, drives)) / 1e-6 for step in small], axis=2)
        step = np.einsum("nij,nj->ni", np.linalg.pinv(slope), off)
        drives = drives + step * np.minimum(1.0, 0.2 / np.maximum(np.linalg.norm(step, axis=1), 1e-12))[:, None]
    there = np.linalg.norm(places - ball(arm, drives), axis=1) < 1e-9
    return drives[there & (np.abs(drives) < np.pi).all(axis=1) & arm.drawing.in_reach(arm.drawing.starts(drives))]


def measured(arm, drives, places, **changes):
    """Return a campaign of positions only, (n, 3), in m, at actual drive positions (n, 6)."""
    rows = arm.campaign.subset(np.arange(len(drives)))
    rows = rows.with_conditions(ambient=None)
    return dataclasses.replace(rows, drives=drives, position_m=places, rotation_vector_rad=None, **changes)


def stuck(flags):
    return [flag.severity for flag in flags if flag.code == FlagCode.STUCK_COLUMN]


@pytest.fixture(scope="module")
def into_sockets(arm):
    """Return commands (2, 25, 6) that bring the ball into two sockets, and the sockets' positions, (2, 25, 3), in m."""
    free, seats = arm.campaign.drives, np.array([[0.0, 0.0, 0.0], [0.05, 0.0, 0.0]])
    into = [brought(arm, free, ball(arm, free[[7]]) + seat + np.zeros((len(free), 3)))[:25] for seat in seats]
    return np.array(into), np.repeat(seats[:, None], 25, axis=1)


@pytest.mark.parametrize("sockets", [1, 2])
def test_a_ball_held_in_sockets_is_no_stuck_sensor(arm, into_sockets, sockets):
    """Many commands with different attitudes at one socket: data that calibrate an arm without any instrument."""
    drives, stated = (both[:sockets].reshape(25 * sockets, -1) for both in into_sockets)
    flags = check_campaign(measured(arm, drives, stated), arm.drawing)
    assert stuck(flags) == [Severity.NOTE]
    assert f"stood still{f' at each of {sockets} places' if sockets > 1 else ''} while" in str(flags)
    assert codes(flags) <= {FlagCode.STUCK_COLUMN, FlagCode.NO_TEMPERATURES}


@pytest.mark.parametrize(("lost", "places"), [(12, 1), (13, 0)])
def test_a_socket_where_most_rows_have_no_pose_is_not_reported(arm, into_sockets, lost, places):
    (drives, _), (stated, _) = into_sockets
    reached = nominal_poses(arm.drawing, drives)
    known = np.where(np.arange(len(drives)) < lost, np.nan, 1.0)
    poses = PoseStack(known[:, None] * reached.position_m, known[:, None, None] * reached.rotation)
    assert len(held_rows(measured(arm, drives, stated), arm.drawing, poses)) == places


def test_sockets_may_alternate_and_have_a_wrong_row(arm, into_sockets):
    """They lie on a line, so that y and z are the same in all rows."""
    drives, stated = (both.swapaxes(0, 1).reshape(50, -1) for both in into_sockets)
    wrong = np.array(drives)
    wrong[20] = arm.campaign.drives[3]
    assert stuck(check_campaign(measured(arm, drives, stated), arm.drawing)) == [Severity.NOTE]
    flags = check_campaign(measured(arm, wrong, stated), arm.drawing)
    assert stuck(flags) == [Severity.NOTE]
    assert wrong_rows(flags).tolist() == [20]


def test_a_tracker_that_is_stuck_while_drives_move_freely_is_an_error(arm):
    place = np.array(arm.campaign.position_m)
    place[40:60] = place[40]
    flags = check_campaign(measured(arm, arm.campaign.drives, place), arm.drawing)
    assert stuck(flags) == [Severity.ERROR] * 3


@pytest.mark.parametrize("moving", [[0, 1, 1, 0, 0, 0], [0, 0, 0, 0, 0, 1]])
def test_a_tracker_that_is_stuck_while_drives_move_along_a_line_is_an_error(arm, moving):
    """They rotate the target nearly about some point or, if one moves alone, about its axis: no ball sits there."""
    drives, place = np.array(arm.campaign.drives), np.array(arm.campaign.position_m)
    drives[40:60] = drives[40] + 0.01 * np.outer(np.arange(20), moving)
    place[40:60] = place[40]
    flags = check_campaign(measured(arm, drives, place), arm.drawing)
    assert stuck(flags) == [Severity.ERROR] * 3


def test_a_stuck_column_is_found_where_sessions_have_frames_of_their_own(arm):
    """Transformed into the frame of another session it would vary."""
    seen = np.array(arm.campaign.position_m)
    seen[100:] = seen[100:] @ np.array([[0.6, -0.8, 0.0], [0.64, 0.48, -0.6], [0.48, 0.36, 0.8]]).T
    seen[150:160, 2] = seen[150, 2]
    metadata = arm.campaign.metadata.model_copy(update={"frames": "per session"})
    sessions = ("1",) * 100 + ("2",) * 100
    flags = check_campaign(measured(arm, arm.campaign.drives, seen, sessions=sessions, metadata=metadata), arm.drawing)
    assert stuck(flags) == [Severity.ERROR]


@pytest.mark.parametrize(("first", "told"), [(60, False), (12, True)])
def test_an_arm_that_changes_its_posture_is_no_moved_tracker(arm, first, told):
    """Elbow up in the first half, down in the second, at the same tool pose: the effect of drive errors has a step."""
    random = np.random.default_rng(3)
    drives = np.repeat(ELBOW_UP_AND_DOWN, 30, axis=0) + 0.1 * random.normal(size=(60, 6))
    place = ball(arm, drives) + 2e-5 * random.normal(size=(60, 3))
    place[first:] += 0.005
    assert (FlagCode.MEASUREMENT_JUMP in codes(check_campaign(measured(arm, drives, place), arm.drawing))) == told


def test_a_step_of_a_long_campaign_is_found_from_some_of_its_rows(arm, monkeypatch):
    """Errors of all joints in 20,000 rows would take gigabytes; far fewer on either side are sufficient."""
    asked, joint_terms = [], Aligned.joint_terms

    def terms(aligned, rows):
        asked.append(len(rows))
        return joint_terms(aligned, rows)

    monkeypatch.setattr(Aligned, "joint_terms", terms)
    monkeypatch.setattr("pouring_robot.checks.jumps.TELLING_ROWS", 60)
    place = np.array(arm.campaign.position_m)
    place[160:] += 0.005
    flags = check_campaign(measured(arm, arm.campaign.drives, place), arm.drawing)
    assert FlagCode.MEASUREMENT_JUMP in codes(flags)
    assert asked and max(asked) < 160


def test_rotations_that_are_stuck_while_the_ball_is_in_a_socket_are_an_error(arm, into_sockets):
    """The ball rotates there, and so must the measured rotation, for instance of an inclinometer."""
    drives, stated = into_sockets[0][0], into_sockets[1][0]
    turned = rotation_vectors(nominal_poses(arm.drawing, drives).rotation)
    turned[5:15] = turned[5]
    seen = dataclasses.replace(measured(arm, drives, stated), rotation_vector_rad=turned)
    assert sorted(stuck(check_campaign(seen, arm.drawing))) == [*[Severity.ERROR] * 3, Severity.NOTE]
