"""Poses of robots with errors: closed chains against the slow solver, open branches against the DH table."""

import numpy as np
import pinocchio as pin
import pytest

from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.pouring.platform_pose import PlatformPose
from pouring_robot.robot.pouring_robot import robot_of
from pouring_robot.sweeps import ErrorEntry
from tests.support import ACTUAL
from tests.sweeps.reference import OneAtATime

SIZES = {"half_width_mm": 0.3, "half_width_mrad": 2.0}


def test_closed_chains_equal_the_one_at_a_time_solver(plan):
    values = plan.draws.values(0, 6)
    errors, drives = plan.error_map.placement_errors(values), plan.error_map.drive_errors(values)
    closed, moved = plan.closed(values, plan.poses), plan.moved(values, plan.poses)
    slow = OneAtATime(plan.mechanism, plan.error_map.joints).platforms(plan.poses, errors, drives)
    position, rotation, gaps, turns, status = slow
    assert (moved.status == 0).all() and (status == 0).all()
    assert np.abs(closed.position.reshape(position.shape) - position).max() < 1e-11
    assert np.abs(closed.rotation.reshape(rotation.shape) - rotation).max() < 1e-11
    assert np.abs(moved.gap_m - gaps).max() < 1e-11
    assert np.abs(moved.gap_rad - turns).max() < 1e-10


def test_displacements_are_those_of_the_robot_with_these_errors(plan):
    values = plan.draws.values(3, 4)
    found = plan.moved(values, plan.poses).displacement
    solver = OneAtATime(plan.mechanism, plan.error_map.joints).solver(plan.error_map.placement_errors(values)[0])
    drives = dict(
        zip(
            [drive.joint for drive in plan.catalogue.drives],
            plan.poses.drives[2] + plan.error_map.drive_errors(values)[0],
            strict=True,
        )
    )
    names = [joint for joint in plan.error_map.joints if not joint.endswith("mount")]
    start = dict(zip(names, plan.poses.start.joints[2].ravel().tolist(), strict=True))
    neutral = plan.mechanism.neutral_configuration()
    actual = solver.solve(drives, solver.mechanism.with_joint_values(neutral, start))
    x, y, z, tilt = plan.poses.poses[2]
    nominal = pin.SE3(pin.utils.rotate("y", tilt), np.array([x, y, z]))
    lip = actual.pose("moving_platform", "ladle_lip")
    expected = actual.pose("fixed_platform", "ladle_lip").translation - (nominal * lip).translation
    assert np.abs(found[0, 2, 0] - expected).max() < 1e-11


def test_an_open_branch_is_the_chain_of_the_dh_table(make_plan):
    entry = ErrorEntry(parameters=("*_e?_*",), **SIZES)
    plan = make_plan(study="one_at_a_time", kind="open_branch", samples=None, errors=[entry])
    found, shape = plan.closed(plan.draws.values(0, plan.draws.count), plan.poses), (-1, len(plan.poses), 3)
    position, rotation = found.position.reshape(shape), found.rotation.reshape(*shape, 3)
    for k, p in enumerate(plan.parameters):
        error = {p.name: plan.draws.margins[k].tolerance}
        expected = plan.catalogue.table.chain_poses(p.chain, plan.poses.start.joints[:, p.chain - 1], error)
        assert np.abs(position[k] - expected[:, :3, 3]).max() < 1e-12, p.name
        assert np.abs(rotation[k] - expected[:, :3, :3]).max() < 1e-12, p.name


def test_an_open_branch_takes_all_errors_of_its_chain(make_plan):
    entry = ErrorEntry(parameters=("*_e4_*", "drive.leg4_s5"), **SIZES)
    plan = make_plan(kind="open_branch", errors=[entry], samples=3)
    values = plan.draws.values(0, 3)
    position = plan.closed(values, plan.poses).position.reshape(3, -1, 3)
    errors = dict(zip(plan.names, values[1].tolist(), strict=True))
    joints = plan.poses.start.joints[:, 3].copy()
    joints[:, 4] += errors.pop("drive.leg4_s5")
    expected = plan.catalogue.table.chain_poses(4, joints, errors)
    assert np.abs(position[1] - expected[:, :3, 3]).max() < 1e-12


def test_without_errors_nothing_moves(plan):
    moved = plan.moved(np.zeros((1, len(plan.names))), plan.poses)
    assert (moved.status == 0).all() and np.abs(moved.displacement).max() < 1e-12


def test_a_robot_as_built_is_compared_with_itself(make_plan):
    plan = make_plan(layout=None, model=str(ACTUAL))
    assert np.abs(plan.moved(np.zeros((1, len(plan.names))), plan.poses).displacement).max() < 1e-12
    assert 1e-5 < np.abs(plan.moved(plan.draws.values(0, 1), plan.poses).displacement).max() < 2e-2


def test_a_robot_as_built_has_its_drive_offsets_and_its_own_error_is_told(make_plan, tmp_path):
    ladle = {"ladle_mount": pin.SE3(np.eye(3), np.array([0.0, 3e-3, 0.0]))}
    model = RobotModel.load(ACTUAL).displaced(ladle, {"leg1_s3": 4e-3})
    path = tmp_path / "off.yaml"
    path.write_text(model.file_text(tmp_path))
    plan, without = make_plan(layout=None, model=str(path)), make_plan(layout=None, model=str(ACTUAL))
    robot = robot_of(model)
    poses = [PlatformPose((x, y, z), tilt) for x, y, z, tilt in plan.poses.poses.tolist()]
    errors = [robot.locate(pose).difference(plan.config.frames[0]).distance_m for pose in poses]
    assert plan.own_error_m == pytest.approx(max(errors), abs=1e-9)
    assert plan.content_hash != without.content_hash
    assert plan.off == "off its place in off.yaml"


def test_robots_without_a_solution_keep_their_status(make_plan):
    entry = {"parameters": ["leg?_s?.r?"], "half_width_mrad": 400.0}
    plan = make_plan(errors=[entry], samples=10)
    moved = plan.moved(plan.draws.values(0, 10), plan.poses)
    closed = moved.status == 0
    assert not closed.all()
    assert np.isnan(moved.displacement[~closed]).all() and np.isfinite(moved.displacement[closed]).all()
