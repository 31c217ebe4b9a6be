"""Effects of drive errors on a target for any robot, and the inverse: against differences of the drawing's poses."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from pouring_robot.campaign.nominal import PoseStack, nominal_poses
from pouring_robot.checks.smooth_errors import drive_errors, prediction_variance, target_effect
from pouring_robot.estimation.frames.outer import OuterFrames
from pouring_robot.mechanism.local_parameters import drive_parameters
from pouring_robot.robot.description.definition import RobotDefinition
from tests.diagnosis.hidden import NOTHING, campaign
from tests.estimation.virtual import INNER

ROBOTS = Path(__file__).resolve().parents[2] / "examples" / "robots"
STEP = 1e-5
FRAMES = OuterFrames(pin.SE3.Identity(), INNER)


def drive_effect(drawing, drives):
    return target_effect(drawing, drives, FRAMES, drive_parameters(drawing.mechanism))


def some_drives(robot, drawing, count=5):
    drives, _ = robot.workspace(drawing)
    return drives[np.random.default_rng(3).permutation(len(drives))[:count]]


@pytest.fixture(params=["pouring", "arm", "delta", "hexapod"])
def robot_drives(request, drawing):
    """Definition's drives, drawing, and some drive values."""
    if request.param == "pouring":
        robot, closes = drawing.model.definition, drawing.kinematics
    else:
        robot = RobotDefinition.load(ROBOTS / request.param / "robot.yaml")
        closes = robot.drawing()
    return [drive.unit for drive in robot.drives], closes, some_drives(robot, closes)


def test_drive_effect_is_the_derivative_of_the_target(robot_drives):
    units, drawing, drives = robot_drives
    effect = drive_effect(drawing, drives)
    for k, axis in enumerate(np.eye(len(units))):
        plus, minus = (FRAMES.seen(nominal_poses(drawing, drives + s * STEP * axis)) for s in (1.0, -1.0))
        change = plus.difference(minus) / (2.0 * STEP)
        # Second-order remainder of the difference, and the tolerance of 1e-12 m of the closure.
        np.testing.assert_allclose(effect[:, :, k], change, atol=1e-5 * np.abs(change).max())


def test_small_drive_errors_are_recovered_from_the_full_pose(robot_drives):
    units, drawing, drives = robot_drives
    random = np.random.default_rng(1)
    error = 1e-6 * random.normal(size=drives.shape)
    before, after = (FRAMES.seen(nominal_poses(drawing, values)) for values in (drives, drives + error))
    effect = drive_effect(drawing, drives)
    found, left = drive_errors(effect, units, after.difference(before), 1.0)
    reach = np.median(np.linalg.norm(effect[:, :3], axis=1), axis=0)
    scale = np.where(np.array(units) == "rad", reach, 1.0)
    np.testing.assert_allclose(found, error * scale, atol=1e-3 * np.abs(error).max())
    np.testing.assert_allclose(left, 0.0, atol=1e-3 * np.abs(error).max())


def test_rows_without_pose_have_no_effect(drawing):
    sound = some_drives(drawing.model.definition, drawing.kinematics, 2)
    drives = np.array([[np.nan] * 4, [0.3, 9.0, 0.3, 0.0], *sound])
    effect = drive_effect(drawing.kinematics, drives)
    assert np.isfinite(effect).all(axis=(1, 2)).tolist() == [False, False, True, True]
    empty = PoseStack(np.zeros((4, 3)), np.tile(np.eye(3), (4, 1, 1)))
    errors, _ = drive_errors(effect, ["m", "m", "m", "rad"], empty.position_m, 1.0)
    assert np.isnan(errors[:2]).all()
    assert (errors[2:] == 0.0).all()


def test_the_variance_of_predictions_from_other_rows_is_that_of_least_squares(drawing, tmp_path):
    """For a linear model in every coordinate and condition, fitted to random noise of the other rows many times."""
    data = campaign(tmp_path, NOTHING, rows=90)
    poses, rows = nominal_poses(drawing.kinematics, data.drives), np.array([4, 17])
    pose = [*poses.position_m.T, poses.rotation[:, 0, 0], poses.rotation[:, 0, 2]]
    terms = np.column_stack([np.ones(90), *pose, *data.conditions.values(), *data.approach.T])
    terms = np.delete(terms, np.flatnonzero(np.ptp(terms[:, 1:], axis=0) == 0.0) + 1, axis=1)
    terms = terms / np.abs(terms).max(axis=0)
    others = np.delete(np.arange(90), rows)
    draws = np.random.default_rng(2).normal(size=(len(others), 20_000))
    told = terms[rows] @ np.linalg.lstsq(terms[others], draws, rcond=1e-10)[0]
    # The ridge shrinks what the rows hardly determine; a variance from 20,000 draws has a standard deviation of 1 %.
    np.testing.assert_allclose(prediction_variance(data, poses, rows), told.var(axis=1), rtol=0.05)


def test_rows_under_a_load_that_no_other_had_cannot_be_predicted(drawing, tmp_path):
    data = campaign(tmp_path, NOTHING)
    poses, rows = nominal_poses(drawing.kinematics, data.drives), np.array([4, 17])
    load = np.zeros(len(data))
    load[rows] = 500.0
    alone = prediction_variance(data.with_conditions(payload=load), poses, rows)
    load[30] = 500.0
    assert (alone > 1e3).all()
    assert (prediction_variance(data.with_conditions(payload=load), poses, rows) < 10.0).all()


def test_rows_under_conditions_that_one_other_had_elsewhere_are_hardly_predictable(drawing, tmp_path):
    """A temperature's effect may differ from pose to pose: one row at another pose does not determine it."""
    data = campaign(tmp_path, NOTHING)
    poses, rows = nominal_poses(drawing.kinematics, data.drives), np.array([4])
    parts = {name: np.full(len(data), 160.0) for name in ("leg1", "leg2", "leg3", "leg4", "platform")}
    for cold in (4, 17):
        for values in parts.values():
            values[cold] = 20.0
    few = prediction_variance(data.with_conditions(**parts), poses, rows)
    for cold in range(0, len(data), 2):
        for values in parts.values():
            values[cold] = 20.0
    half = prediction_variance(data.with_conditions(**parts), poses, rows)
    assert few > 5.0
    assert half < 1.0
