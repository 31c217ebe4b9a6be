"""The batch engine against the one-at-a-time solver, its own differences, and bad input."""

import os
import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from pouring_robot.batch import (
    STATUS_NAMES,
    BatchClosure,
    BatchStart,
    CompiledEngine,
    SiteErrors,
    StarStructure,
)
from pouring_robot.batch.kernels.compiler import _Locator, outermost
from pouring_robot.batch.kernels.samples import close_samples
from pouring_robot.exceptions import (
    BadInputError,
    BatchClosureError,
    ClosureError,
    UnknownJointError,
    UnsupportedMechanismError,
)
from pouring_robot.io.cache import CACHE_VARIABLE
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.closure.solver import ClosureOptions, ClosureSolver
from pouring_robot.mechanism.local_parameters import (
    DriveParameter,
    PayloadParameter,
    PlacementParameter,
    placement_parameters,
)
from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.pouring.kinematics import FourUPUKinematics
from pouring_robot.robot.pouring.layout import render_urdf
from pouring_robot.robot.pouring.platform_pose import PlatformPose
from tests.support import BOX_LOWER, BOX_UPPER, ROOT, perturbed, placement_error, platform_star

SITES, PARAMETERS = 24, 144
# Up to 2 mm and 4 mrad in every component of every placement at once.
FULL_ERRORS = np.tile([2e-3] * 3 + [4e-3] * 3, SITES)
SHIFTS_ONLY = np.tile([2e-3] * 3 + [0.0] * 3, SITES)


def engine_and_kinematics(layout):
    mechanism = RobotModel(layout=layout).definition.mechanism()
    return CompiledEngine(mechanism, threads=2), FourUPUKinematics(mechanism)


@pytest.fixture(scope="module")
def robots():
    """Engine and kinematics of both shipped layouts."""
    return {layout: engine_and_kinematics(layout) for layout in ("paper", "wide")}


@pytest.fixture(scope="module")
def paper(robots):
    return robots["paper"]


def command_of(kinematics, count, seed):
    poses = np.random.default_rng(seed).uniform(BOX_LOWER, BOX_UPPER, size=(count, 4))
    return kinematics.commands(poses)


def errors_of(spread, count, seed):
    return np.random.default_rng(seed).uniform(-1.0, 1.0, size=(count, PARAMETERS)) * spread


def as_built(mechanism, engine, errors):
    """Return the mechanism whose URDF holds the errors of one sample, shape (sites * 6,)."""
    sites = zip(engine.structure.site_joints, errors.reshape(-1, 6), strict=True)
    return perturbed(mechanism, {name: placement_error(e) for name, e in sites})


def closed_one_at_a_time(mechanism, kinematics, command, sample):
    """Close one sample with Pinocchio."""
    pose = command.poses[sample]
    solver = ClosureSolver(mechanism)
    return solver.solve_from(kinematics.configuration(PlatformPose(tuple(pose[:3].tolist()), float(pose[3]))))


def difference_of(batch, sample, result):
    """Return the largest difference of pose, joint values and residual, in m and rad."""
    pose = result.pose_base_to_end
    names = [[f"leg{leg}_s{k}" for k in range(1, 6)] for leg in range(1, 5)]
    joints = np.array([[result.joint_values[name] for name in leg] for leg in names])
    return max(
        np.abs(batch.position[sample] - pose.translation).max(),
        np.abs(batch.rotation[sample] - pose.rotation).max(),
        np.abs(batch.joints[sample] - joints).max(),
        np.abs(batch.residual[sample] - result.residual).max(),
    )


@pytest.mark.parametrize("layout", ["paper", "wide"])
@pytest.mark.parametrize("spread", [SHIFTS_ONLY, 0.25 * FULL_ERRORS, FULL_ERRORS], ids=["shifts", "quarter", "full"])
def test_it_equals_the_one_at_a_time_solver(robots, layout, spread):
    engine, kinematics = robots[layout]
    mechanism = engine.structure.mechanism
    command, errors = command_of(kinematics, 30, seed=3), errors_of(spread, 30, seed=4)
    batch = engine.close(command.drives, command.start, errors).require_all()
    names, stopped = [name for chain in engine.structure.joint_names for name in chain], 0
    for sample in range(30):
        robot = as_built(mechanism, engine, errors[sample])
        try:
            result = closed_one_at_a_time(robot, kinematics, command, sample)
        except ClosureError:  # a narrow valley that only the batch engine's search gets through
            stopped += 1
            values = dict(zip(names, batch.joints[sample].ravel().tolist(), strict=True))
            result = ClosureSolver(robot).solve(values, robot.neutral_configuration())
        assert difference_of(batch, sample, result) < 1e-12
    assert stopped <= (1 if spread is FULL_ERRORS else 0)


def test_a_mechanism_that_is_displaced_already_equals_the_errors_given(paper):
    engine, kinematics = paper
    command, errors = command_of(kinematics, 20, seed=5), errors_of(FULL_ERRORS, 1, seed=6)[0]
    displaced_already = CompiledEngine(as_built(engine.structure.mechanism, engine, errors))
    one = displaced_already.close(command.drives, command.start).require_all()
    other = engine.close(command.drives, command.start, errors).require_all()
    np.testing.assert_allclose(one.position, other.position, rtol=0, atol=1e-12)
    np.testing.assert_allclose(one.residual, other.residual, rtol=0, atol=1e-12)


def test_one_set_of_errors_for_all_samples_equals_the_same_set_for_each(paper):
    engine, kinematics = paper
    count = 700  # more than one range of samples, so that each range has to put the errors in place
    command, errors = command_of(kinematics, count, seed=31), errors_of(FULL_ERRORS, 1, seed=32)[0]
    drives = command.drives.copy()
    drives[0], drives[512] = np.nan, np.nan  # the first samples of the ranges come to nothing
    assert errors.shape == (144,)
    shared = engine.close(drives, command.start, errors)
    repeated = engine.close(drives, command.start, np.tile(errors, (count, 1)))
    assert np.flatnonzero(shared.status).tolist() == [0, 512]
    for name in ("position", "rotation", "joints", "residual", "iterations", "status"):
        np.testing.assert_array_equal(getattr(shared, name), getattr(repeated, name))
    assert np.abs(shared.position[1] - command.poses[1, :3]).max() > 1e-4
    matrices = [engine.transfer(shared, None, e).matrix for e in (errors, np.tile(errors, (count, 1)))]
    np.testing.assert_array_equal(*matrices)


def test_all_chain_orders_give_the_same(paper):
    engine, kinematics = paper
    command = command_of(kinematics, 20, seed=7)
    errors = errors_of(FULL_ERRORS, 20, seed=8)
    expected = engine.close(command.drives, command.start, errors)
    other = CompiledEngine(ClosedChainMechanism(render_urdf(chain_order=(3, 1, 4, 2)), RobotModel().definition.loops))
    found = other.close(command.drives, command.start, errors)
    assert other.structure.site_joints == engine.structure.site_joints
    np.testing.assert_allclose(found.position, expected.position, rtol=0, atol=1e-12)


def test_every_start_in_reach_finds_the_same_pose(paper):
    engine, kinematics = paper
    command = command_of(kinematics, 300, seed=9)
    random = np.random.default_rng(10)
    away = random.uniform(-1.0, 1.0, size=(300, 4)) * (0.012, 0.012, 0.012, 0.05)
    start = kinematics.commands(command.poses + away).start
    closed = engine.close(command.drives, start).require_all()
    np.testing.assert_allclose(closed.position, command.poses[:, :3], rtol=0, atol=1e-12)
    np.testing.assert_allclose(closed.joints, command.start.joints, rtol=0, atol=1e-12)
    assert np.abs(closed.residual).max() < 1e-14
    assert closed.iterations.max() <= 8


def test_the_result_does_not_depend_on_threads_or_chunks(paper):
    engine, kinematics = paper
    count = 1500
    command, errors = command_of(kinematics, count, seed=11), errors_of(FULL_ERRORS, count, seed=12)
    whole = CompiledEngine(engine.structure.mechanism, threads=1).close(command.drives, command.start, errors)
    split = CompiledEngine(engine.structure.mechanism, threads=7).close(command.drives, command.start, errors)
    for name in ("position", "rotation", "joints", "residual", "iterations", "status"):
        np.testing.assert_array_equal(getattr(whole, name), getattr(split, name))
    part = slice(333, 901)
    piece = engine.close(command.drives[part], command.start[part], errors[part])
    np.testing.assert_array_equal(piece.joints, whole.joints[part])
    one = CompiledEngine(engine.structure.mechanism, threads=1).transfer(whole, None, errors)
    two = engine.transfer(piece, None, errors[part])
    np.testing.assert_array_equal(two.matrix, one.matrix[part])


def test_one_displaced_parameter_a_sample_equals_a_full_row(paper):
    engine, kinematics = paper
    command = command_of(kinematics, PARAMETERS, seed=13)
    site, component = np.divmod(np.arange(PARAMETERS), 6)
    values = np.where(component < 3, 2e-4, 4e-3)
    sparse = SiteErrors.one_each(site, values[:, None] * np.eye(6)[component])
    one = engine.close(command.drives, command.start, sparse).require_all()
    full = engine.close(command.drives, command.start, np.diag(values)).require_all()
    np.testing.assert_array_equal(one.position, full.position)
    np.testing.assert_array_equal(
        engine.transfer(one, None, sparse).matrix, engine.transfer(full, None, np.diag(values)).matrix
    )


def rotation_vectors(first, second):
    return np.array([pin.log3(b @ a.T) for a, b in zip(first, second, strict=True)])


def on_top(errors, parameter, step):
    """Return the errors of one sample with a further displacement of one parameter on top, as perturb_urdf does."""
    site, component = divmod(parameter, 6)
    present = errors[6 * site : 6 * site + 6]
    twist = step * np.eye(6)[component]
    pose = pin.SE3(pin.exp3(present[3:]), present[:3]) * pin.SE3(pin.exp3(twist[3:]), twist[:3])
    changed = errors.copy()
    changed[6 * site : 6 * site + 6] = np.r_[pose.translation, pin.log3(pose.rotation)]
    return changed


def fourth_order(closures, step):
    """Return the derivative of the pose from closures at -2, -1, 1 and 2 steps; shape (n, 6)."""
    far_back, back, ahead, far_ahead = closures
    columns = []
    for less, more in ((back, ahead), (far_back, far_ahead)):
        turn = rotation_vectors(less.rotation, more.rotation)
        columns.append(np.concatenate([more.position - less.position, turn], axis=1))
    return (8.0 * columns[0] - columns[1]) / (12.0 * step)


STEPS, STEP = (-2, -1, 1, 2), 2e-5


@pytest.mark.parametrize("spread", [0.0 * FULL_ERRORS, FULL_ERRORS], ids=["closed", "open_loops"])
def test_the_transfer_matrix_equals_differences_of_closures(paper, spread):
    engine, kinematics = paper
    count = 200
    command, errors = command_of(kinematics, count, seed=14), errors_of(spread, 1, seed=15)[0]
    closed = engine.close(command.drives, command.start, errors).require_all()
    drives = [DriveParameter(name, "m") for name in kinematics.mechanism.loops.drives]
    transfer = engine.transfer(closed, [*engine.parameters, *drives], errors)
    assert transfer.matrix.shape == (count, 6, PARAMETERS + 4)
    assert not transfer.status.any()
    start = closed.as_start()
    scale = np.abs(transfer.matrix).max(axis=(1, 2), keepdims=False)[:, None]
    for p in range(PARAMETERS):
        closures = [engine.close(command.drives, start, on_top(errors, p, k * STEP)) for k in STEPS]
        assert (np.abs(transfer.matrix[:, :, p] - fourth_order(closures, STEP)) < 1e-7 * scale).all()
        column = np.abs(transfer.matrix[:, :, p]).max(axis=1, keepdims=True)
        # Relative to the column itself, where it is not just round-off.
        large = np.where(column > 1e-2, column, np.inf)
        assert (np.abs(transfer.matrix[:, :, p] - fourth_order(closures, STEP)) <= 1e-6 * large).all()
    for d in range(4):
        moved = [command.drives + k * STEP * np.eye(4)[d] for k in STEPS]
        expected = fourth_order([engine.close(m, start, errors) for m in moved], STEP)
        assert (np.abs(transfer.matrix[:, :, PARAMETERS + d] - expected) < 1e-7 * scale).all()


def test_the_transfer_matrix_equals_differences_of_perturbed_urdfs(paper):
    engine, kinematics = paper
    mechanism = engine.structure.mechanism
    command, errors = command_of(kinematics, 1, seed=16), errors_of(FULL_ERRORS, 1, seed=17)[0]
    closed = engine.close(command.drives, command.start, errors).require_all()
    matrix = engine.transfer(closed, None, errors).matrix[0]
    for p in range(0, PARAMETERS, 7):
        poses = []
        for k in (-1, 1):
            changed = as_built(mechanism, engine, on_top(errors, p, k * STEP))
            poses.append(closed_one_at_a_time(changed, kinematics, command, 0).pose_base_to_end)
        turn = pin.log3(poses[1].rotation @ poses[0].rotation.T)
        expected = np.r_[poses[1].translation - poses[0].translation, turn] / (2.0 * STEP)
        np.testing.assert_allclose(matrix[:, p], expected, rtol=0, atol=1e-6 * np.abs(matrix).max())


def test_twists_at_sites_combine_the_unit_columns(paper):
    engine, kinematics = paper
    command, errors = command_of(kinematics, 5, seed=18), errors_of(FULL_ERRORS, 5, seed=19)
    closed = engine.close(command.drives, command.start, errors)
    twist = (0.3, -1.0, 0.2, 0.5, 0.1, -0.7)
    unit = engine.transfer(closed, None, errors).matrix
    screw = [PlacementParameter("screw", "rad", joint, twist) for joint in ("leg4_seat_mount", "leg2_s3")]
    found = engine.transfer(closed, screw, errors).matrix
    for k, joint in enumerate(("leg4_seat_mount", "leg2_s3")):
        site = engine.structure.site(joint)
        expected = unit[:, :, 6 * site : 6 * site + 6] @ np.array(twist)
        np.testing.assert_allclose(found[:, :, k], expected, rtol=0, atol=1e-12 * np.abs(unit).max())


def test_open_branches_equal_differences_of_pinocchios_kinematics(paper):
    engine, kinematics = paper
    mechanism = engine.structure.mechanism
    command, errors = command_of(kinematics, 1, seed=20), errors_of(FULL_ERRORS, 1, seed=21)[0]
    names = [name for chain in engine.structure.joint_names for name in chain]
    drives = [DriveParameter(name, "m") for name in mechanism.loops.drives]
    transfer = engine.transfer_open_branch(command.start.joints, [*engine.parameters, *drives], errors)

    def carried(errors, leg, joints):
        """Return the platform's pose as chain ``leg`` alone carries it."""
        changed = as_built(mechanism, engine, errors)
        values = dict(zip(names, joints.ravel(), strict=True))
        data = changed.copy_model().createData()
        configuration = changed.with_joint_values(changed.neutral_configuration(), values)
        pin.framesForwardKinematics(changed.shared_model, data, configuration)
        pose = {n: data.oMf[changed.frame_id(n)] for n in ("fixed_platform", "moving_platform")}
        foot, seat = (data.oMf[changed.frame_id(f"leg{leg}_{part}")] for part in ("foot", "seat"))
        return pose["fixed_platform"].actInv(foot) * pose["moving_platform"].actInv(seat).inverse()

    def difference(less, more):
        turn = pin.log3(more.rotation @ less.rotation.T)
        return np.r_[more.translation - less.translation, turn] / (2.0 * STEP)

    held = command.start.joints[0]
    for chain in range(4):
        found = engine.carry(np.array([chain]), command.drives, command.start, errors).require_all()
        expected = carried(errors, chain + 1, held)
        np.testing.assert_allclose(found.position[0], expected.translation, rtol=0, atol=1e-13)
        np.testing.assert_allclose(found.rotation[0], expected.rotation, rtol=0, atol=1e-13)
        assert not found.residual.any()
    with pytest.raises(BadInputError, match="from 0 to 3"):
        engine.carry(np.array([4]), command.drives, command.start)
    for p in range(0, PARAMETERS, 5):
        leg = p // 36 + 1
        poses = [carried(on_top(errors, p, k * STEP), leg, held) for k in (-1, 1)]
        np.testing.assert_allclose(transfer.matrix[0, :, p], difference(*poses), rtol=0, atol=1e-8)
    for d, (chain, joint) in enumerate(engine.structure.star.drives):
        poses = []
        for k in (-1, 1):
            moved = held.copy()
            moved[chain, joint] += k * STEP
            poses.append(carried(errors, chain + 1, moved))
        np.testing.assert_allclose(transfer.matrix[0, :, PARAMETERS + d], difference(*poses), rtol=0, atol=1e-8)


def test_a_singular_pose_has_a_status_of_its_own():
    """With the four leg lengths driven, each pair of legs is a planar four-bar that keeps a freedom."""
    model = RobotModel()
    loops = model.definition.loops.model_copy(update={"drives": tuple(f"leg{i}_s3" for i in (1, 2, 3, 4))})
    mechanism = ClosedChainMechanism(model.definition.urdf(), loops)
    engine, kinematics = CompiledEngine(mechanism), FourUPUKinematics(mechanism)
    command = command_of(kinematics, 20, seed=34)
    start = command.start
    closed = BatchClosure(
        start.position,
        start.rotation,
        start.joints,
        np.zeros((20, 4, 6)),
        np.zeros(20, np.int32),
        np.zeros(20, np.uint8),
    )
    transfer = engine.transfer(closed)
    assert transfer.status.tolist() == [STATUS_NAMES.index("singular")] * 20
    assert np.isnan(transfer.matrix).all()
    assert STATUS_NAMES.index("not converged") != STATUS_NAMES.index("singular")


def test_results_are_read_only_and_compare_by_identity(paper):
    engine, kinematics = paper
    command = command_of(kinematics, 3, seed=35)
    closed = engine.close(command.drives, command.start)
    transfer = engine.transfer(closed)
    for array in (closed.position, closed.rotation, closed.joints, closed.residual, closed.status, transfer.matrix):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
    assert closed != engine.close(command.drives, command.start)


def test_failed_samples_say_so_and_leave_the_others_alone(paper):
    engine, kinematics = paper
    command = command_of(kinematics, 6, seed=22)
    drives, errors = command.drives.copy(), errors_of(0.1 * FULL_ERRORS, 6, seed=23)
    whole = engine.close(drives, command.start, errors).require_all()
    drives[1, 0] = np.nan
    drives[2] = (0.1, 5.0, 0.3, 1.0)
    errors[3, 50] = np.inf
    skewed = command.start.rotation.copy()
    skewed[4] *= 1.01
    start = BatchStart(command.start.position, skewed, command.start.joints)
    closed = engine.close(drives, start, errors)
    assert closed.status[[0, 1, 3, 4, 5]].tolist() == [0, 3, 3, 3, 0]
    assert closed.status[2] in (1, 2)
    np.testing.assert_array_equal(closed.position[0], whole.position[0])
    for name in ("position", "rotation", "joints", "residual"):
        assert np.isnan(getattr(closed, name)[1:5]).all()
    transfer = engine.transfer(closed, None, errors)
    np.testing.assert_array_equal(transfer.status, closed.status)
    assert np.isnan(transfer.matrix[1:5]).all()
    assert np.isfinite(transfer.matrix[[0, 5]]).all()
    with pytest.raises(BatchClosureError, match=r"4 of 6 samples do not close .*3 not finite; the first is sample 1"):
        closed.require_all()


def test_loops_left_open_too_far_have_their_own_status(paper):
    engine, kinematics = paper
    command, errors = command_of(kinematics, 6, seed=22), errors_of(FULL_ERRORS, 6, seed=23)
    strict = CompiledEngine(engine.structure.mechanism, options=ClosureOptions(max_gap_m=1e-6, max_gap_rad=1e-5))
    closed = strict.close(command.drives, command.start, errors)
    assert closed.status.tolist() == [2] * 6
    assert np.isnan(closed.position).all()
    assert not closed.closed.any()


def test_shapes_and_names_that_do_not_fit_are_refused(paper):
    engine, kinematics = paper
    command = command_of(kinematics, 3, seed=24)
    closed = engine.close(command.drives, command.start)
    with pytest.raises(BadInputError, match="'drives' must have the shape"):
        engine.close(command.drives[:, :3], command.start)
    with pytest.raises(BadInputError, match="errors must have the shape"):
        engine.close(command.drives, command.start, np.zeros((2, PARAMETERS)))
    with pytest.raises(BadInputError, match="not a finite number"):
        engine.close(command.drives, command.start, np.full(PARAMETERS, np.nan))
    with pytest.raises(BadInputError, match="a site must be 0 to 23"):
        engine.close(command.drives, command.start, SiteErrors.one_each([0, 1, 24], np.zeros((3, 6))))
    with pytest.raises(BadInputError, match="a start needs"):
        BatchStart(np.zeros((2, 3)), np.zeros((3, 3)), np.zeros((2, 4, 5)))
    with pytest.raises(BadInputError, match="the start's joints"):
        engine.close(command.drives, BatchStart(np.zeros((3, 3)), np.zeros((3, 3, 3)), np.zeros((3, 4, 4))))
    with pytest.raises(BadInputError, match="poses must have the shape"):
        kinematics.commands(np.zeros(4))
    for threads in (0, 1.5, "2"):
        with pytest.raises(BadInputError, match=f"threads must be positive, not {threads!r}"):
            CompiledEngine(engine.structure.mechanism, threads=threads)
    with pytest.raises(BadInputError, match="no column for 'payload'"):
        engine.transfer(closed, [PayloadParameter()])
    with pytest.raises(UnknownJointError, match="leg1_s9"):
        engine.transfer(closed, [PlacementParameter("a", "m", "leg1_s9", (1.0, 0.0, 0.0, 0.0, 0.0, 0.0))])
    nothing = engine.close(command.drives[:0], command.start[:0]).require_all()
    assert engine.transfer(nothing).matrix.shape == (0, 6, PARAMETERS)


CHAINS = (("a", 0.0, (0.5, 0.6, 0.1), 0.0), ("b", 1.0, (0.5, 0.6, 0.1), 0.4), ("c", 0.4, (0.8, 0.1), 0.2))


def closed_star(height=0.8, platform_x=0.3):
    """Return joint values that hold the platform level at a height: chains a and b with their elbows outwards."""
    values = {"c_j1": -np.pi / 2, "c_j2": np.pi / 2}
    for (name, ground_x, (first, second, last), seat_x), side in zip(CHAINS[:2], (-1, 1), strict=True):
        x = platform_x + seat_x - last - ground_x
        distance = np.hypot(x, height)
        to_elbow = np.arccos((first**2 + distance**2 - second**2) / (2 * first * distance))
        at_elbow = np.arccos((first**2 + second**2 - distance**2) / (2 * first * second))
        # About y, a positive turn lowers a link that points along x.
        values[f"{name}_j1"] = np.arctan2(-height, x) + side * to_elbow
        values[f"{name}_j2"] = side * (at_elbow - np.pi)
        values[f"{name}_j3"] = -values[f"{name}_j1"] - values[f"{name}_j2"]
    return values


def test_another_star_with_chains_of_different_lengths():
    mechanism = platform_star(CHAINS, ("a_j1", "b_j1"))
    structure = StarStructure.from_mechanism(mechanism)
    assert [len(names) for names in structure.joint_names] == [3, 3, 2]
    assert structure.site_joints[8:] == ("c_j1", "c_j2", "", "c_seat_mount")
    assert "c_seat_mount.rz" in {p.name for p in placement_parameters(structure.placed_joints)}
    values = closed_star()
    joints = np.zeros((1, 3, 3))
    for i, names in enumerate(structure.joint_names):
        joints[0, i, : len(names)] = [values[name] for name in names]
    start = BatchStart(np.array([[0.3, 0.0, 0.8]]), np.eye(3)[None], joints)
    drives = np.array([[values["a_j1"] + 0.02, values["b_j1"] - 0.01]])
    engine = CompiledEngine(mechanism)
    closed = engine.close(drives, start).require_all()
    solver = ClosureSolver(mechanism)
    configuration = mechanism.with_joint_values(mechanism.neutral_configuration(), values)
    moved = dict(zip(("a_j1", "b_j1"), drives[0].tolist(), strict=True))
    expected = solver.solve(moved, configuration)
    assert np.abs(closed.position[0] - start.position[0]).max() > 1e-3
    np.testing.assert_allclose(closed.position[0], expected.pose_base_to_end.translation, rtol=0, atol=1e-12)
    np.testing.assert_allclose(closed.rotation[0], expected.pose_base_to_end.rotation, rtol=0, atol=1e-12)
    with pytest.raises(BadInputError, match="chain 3 has 2 joints"):
        engine.close(drives, BatchStart(start.position, start.rotation, np.ones((1, 3, 3))))


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"cut_joints": ()}, "not on one free body"),
        ({"end_frame": None}, "end_frame is not on the body"),
        ({"end_frame": "c_tip"}, "end_frame is not on the body"),
        ({"base_frame": "c_l1"}, "'a' does not start on the base frame's body"),
        ({"locked_joints": ("platform_mount",)}, "driven or locked"),
        ({"loops": [{"name": "a", "frame_a": "a_tip", "frame_b": "a_seat"}]}, "joint 'b_j1' belongs to no chain"),
        (
            {
                "loops": [
                    {"name": "a", "frame_a": "a_tip", "frame_b": "a_seat"},
                    {"name": "twice", "frame_a": "a_l2", "frame_b": "b_seat"},
                ]
            },
            "two chains share joint 'a_j1'",
        ),
        ({"loops": [{"name": "a", "frame_a": "ground", "frame_b": "a_seat"}]}, "has no joint"),
        ({"loops": [{"name": "a", "frame_a": "a_tip", "frame_b": "a_seat", "type": "3d"}]}, "3d"),
    ],
)
def test_a_mechanism_that_is_no_star_is_refused(changes, problem):
    mechanism = platform_star(CHAINS, ("a_j1", "b_j1"), **changes)
    with pytest.raises(UnsupportedMechanismError, match=problem) as caught:
        CompiledEngine(mechanism)
    assert "\n" not in str(caught.value)
    assert "engine_for" in str(caught.value)


def test_results_and_commands_pickle(paper):
    engine, kinematics = paper
    command = command_of(kinematics, 3, seed=25)
    closed = engine.close(command.drives, command.start)
    again = pickle.loads(pickle.dumps(engine)).close(pickle.loads(pickle.dumps(command)).drives, command.start)
    np.testing.assert_array_equal(again.joints, pickle.loads(pickle.dumps(closed)).joints)


def test_a_second_process_reads_the_kernels_from_disk(tmp_path):
    script = (
        "import numpy as np\n"
        "from pouring_robot.batch import CompiledEngine\n"
        "from pouring_robot.batch.kernels.samples import close_samples\n"
        "from pouring_robot.robot.pouring_robot import PouringRobot\n"
        "robot = PouringRobot()\n"
        "command = robot.kinematics.commands(np.array([[-0.1, 0.02, -0.6, 0.3]]))\n"
        "CompiledEngine(robot.nominal_solver.mechanism).close(command.drives, command.start).require_all()\n"
        "print(sum(close_samples.stats.cache_hits.values()))\n"
    )
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    run = [sys.executable, "-c", script]

    def hits():
        done = subprocess.run(run, env=environment, cwd=tmp_path, capture_output=True, text=True, check=True)
        return int(done.stdout)

    # Only where nobody has compiled them yet, the first process has to.
    assert hits() == 1 or hits() == 1


def test_where_a_kernel_is_kept_says_nothing_of_the_checkout(tmp_path, monkeypatch):
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path))
    places = [_Locator.from_function(close_samples.py_func, file) for file in ("/here/samples.py", "/there/samples.py")]
    assert len({place.get_cache_path() for place in places}) == 1
    assert Path(places[0].get_cache_path()).is_relative_to(tmp_path)
    assert len({place.get_source_stamp() for place in places}) == 1


def test_a_damaged_file_or_a_place_that_may_not_be_written_to_is_no_trouble(tmp_path, monkeypatch):
    def add_one(x):
        return x + 1.0

    def hits():
        kernel = outermost(add_one)
        assert kernel(2.0) == 3.0
        return sum(kernel.stats.cache_hits.values())

    kept = tmp_path / "kept"
    monkeypatch.setenv(CACHE_VARIABLE, str(kept))
    kept.write_text("a file where the folder should be")
    assert [hits(), hits()] == [0, 0]
    kept.unlink()
    assert [hits(), hits()] == [0, 1]
    for ending in ("*.nbi", "*.nbc"):
        next(kept.rglob(ending)).write_bytes(b"damaged")
        assert [hits(), hits()] == [0, 1]
