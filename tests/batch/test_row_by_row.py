"""The general engine: equal to the engine for stars where both apply, and mechanisms that only it can close."""

import pickle
import re

import numpy as np
import pinocchio as pin
import pytest

from pouring_robot.batch import BatchStart, CompiledEngine, GeneralEngine, HomotopyStarts, SiteErrors, engine_for
from pouring_robot.batch.starts import closed_home
from pouring_robot.exceptions import BadInputError, ClosureError, UnknownJointError
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.closure.solver import ClosureOptions, ClosureSolver
from pouring_robot.mechanism.local_parameters import PayloadParameter, PlacementParameter, drive_parameters
from pouring_robot.mechanism.loops_file import LoopsFile
from pouring_robot.mechanism.transfer import closed_chain_transfer
from pouring_robot.mechanism.weight_on_joints import own_force
from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.pouring.kinematics import FourUPUKinematics
from pouring_robot.robot.pouring.platform_pose import PlatformPose
from tests.support import (
    BOX_LOWER,
    BOX_UPPER,
    arm,
    circle_meeting,
    perturbed,
    placement_error,
    planar_urdf,
    platform_star,
)

SAME = 1e-9  # m and rad: results do not depend on the engine
CRANKS, COUPLERS, GROUND = (0.4, 0.45), (0.6, 0.55), 0.5


def pouring():
    """Return the pouring robot with twenty commands, and starts off them."""
    mechanism = RobotModel().definition.mechanism()
    kinematics, random = FourUPUKinematics(mechanism), np.random.default_rng(3)
    command = kinematics.commands(random.uniform(BOX_LOWER, BOX_UPPER, (20, 4)))
    start = [kinematics.configuration(PlatformPose(tuple(pose[:3].tolist()), float(pose[3]))) for pose in command.poses]
    return mechanism, command.drives, np.array(start)


def five_bar_star():
    """Return a five-bar whose tool is a body of its own, twenty drive values, and its home for each."""
    chains = (("a", 0.0, (*CRANKS[:1], *COUPLERS[:1]), 0.0), ("b", GROUND, (CRANKS[1], COUPLERS[1], 0.0), 0.0))
    mechanism = platform_star(chains, ("a_j1", "b_j1"))
    drives = np.array([-2.0, -1.2]) + np.random.default_rng(4).uniform(-0.3, 0.3, (20, 2))
    tips = [tip_of(values) for values in drives]
    start = []
    for values, tip in zip(drives, tips, strict=True):
        joints = joints_at(values, tip)
        joints["b_j3"] = joints["a_j1"] + joints["a_j2"] - joints["b_j1"] - joints["b_j2"]
        configuration = mechanism.with_joint_values(mechanism.neutral_configuration(), joints)
        free = mechanism.shared_model.joints[mechanism.joint_id("platform_mount")]
        configuration[free.idx_q : free.idx_q + 7] = (0, 0, 0, 0, 0, 0, 1)
        start.append(configuration)
    return mechanism, drives, np.array(start)


def knees(drives):
    """Return where the cranks end, in the x-z plane; a positive turn about y lowers a link along x."""
    return [
        np.array([x + length * np.cos(angle), -length * np.sin(angle)])
        for x, length, angle in zip((0.0, GROUND), CRANKS, drives, strict=True)
    ]


def tip_of(drives):
    first, second = knees(drives)
    return circle_meeting(first, COUPLERS[0], second, COUPLERS[1], side=+1)


def joints_at(drives, tip):
    values = dict(zip(("a_j1", "b_j1"), drives, strict=True))
    for name, knee, angle in zip("ab", knees(drives), drives, strict=True):
        x, z = np.subtract(tip, knee)
        values[f"{name}_j2"] = np.arctan2(-z, x) - angle
    return values


def five_bar_3d(elbows="revolute"):
    """Return a five-bar that is no star: two chains whose tips meet in a point, one of them the end."""
    urdf = planar_urdf("five_bar", [("a", 0.0, [CRANKS[0], COUPLERS[0]]), ("b", GROUND, [CRANKS[1], COUPLERS[1]])])
    urdf = re.sub('(_j2" type=)"revolute"', rf'\1"{elbows}"', urdf)
    loops = LoopsFile(
        base_frame="ground",
        end_frame="a_tip",
        drives=("a_j1", "b_j1"),
        loops=({"name": "tips", "frame_a": "a_tip", "frame_b": "b_tip", "type": "3d"},),
    )
    return ClosedChainMechanism(urdf, loops)


def errors_of(engine, count, seed=5, spread=(1e-3, 2e-3)):
    scale = np.repeat(spread, 3)
    sites = (engine.structure.site_count, 6)
    errors = np.random.default_rng(seed).uniform(-1.0, 1.0, (count, *sites)) * scale
    errors[:, [not name for name in engine.structure.site_joints]] = 0.0
    return errors


def reordered(errors, source, target):
    """Return the errors of one structure in the order of sites of another."""
    moved = np.zeros((len(errors), target.site_count, 6))
    for site, name in enumerate(source.site_joints):
        if name:
            moved[:, target.site(name)] = errors[:, site]
    return moved.reshape(len(errors), -1)


@pytest.mark.parametrize("make", [pouring, five_bar_star], ids=["pouring robot", "five-bar"])
def test_both_engines_give_the_same(make):
    mechanism, drives, configurations = make()
    star, general = CompiledEngine(mechanism), GeneralEngine(mechanism)
    assert isinstance(engine_for(mechanism), CompiledEngine)
    assert set(general.structure.site_joints) == {name for name in star.structure.site_joints if name}
    errors = errors_of(star, len(drives))
    both = []
    parameters = [*general.parameters, *drive_parameters(mechanism)]
    for engine in (star, general):
        own = reordered(errors, star.structure, engine.structure)
        closed = engine.close(drives, engine.start_at(configurations), own).require_all()
        both.append((closed, engine.transfer(closed, parameters, own)))
    (one, one_g), (other, other_g) = both
    for name in ("position", "rotation", "residual"):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=0, atol=SAME, err_msg=name)
    assert not one_g.status.any()
    assert not other_g.status.any()
    np.testing.assert_allclose(one_g.matrix, other_g.matrix, rtol=0, atol=SAME * np.abs(one_g.matrix).max())


def test_a_serial_arm_is_the_same_to_both():
    mechanism = arm()
    drives = np.random.default_rng(6).uniform(-9.0, 9.0, (10, 6))
    star, general = CompiledEngine(mechanism), GeneralEngine(mechanism)
    found = []
    for engine in (star, general):
        start = engine.start_at(np.tile(mechanism.neutral_configuration(), (10, 1)))
        closed = engine.close(drives, start).require_all()
        found.append((closed.position, closed.rotation, engine.transfer(closed, star.parameters).matrix))
    for one, other in zip(*found, strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-13)


@pytest.fixture
def planar():
    mechanism = five_bar_3d()
    engine = engine_for(mechanism)
    assert isinstance(engine, GeneralEngine)
    home = np.array([-2.0, -1.2])
    return engine, home, HomotopyStarts(engine, joints_at(home, tip_of(home)))


def test_a_five_bar_with_a_3d_loop_is_where_its_circles_meet(planar):
    engine, home, homotopy = planar
    drives = home + np.random.default_rng(7).uniform(-0.4, 0.4, (20, 2))
    closed = engine.close(drives, homotopy.starts(drives)).require_all()
    expected = np.array([tip_of(values) for values in drives])
    np.testing.assert_allclose(closed.position[:, [0, 2]], expected, rtol=0, atol=1e-12)
    np.testing.assert_allclose(closed.position[:, 1], 0.0, rtol=0, atol=1e-12)


def test_joints_without_limits_stand_where_those_with_limits_do(planar):
    """Pinocchio stores them as cosine and sine; weight is worked out in the same assembly mode."""
    engine, home, _ = planar
    free = engine_for(five_bar_3d("continuous"))
    assert free.structure.mechanism.shared_model.nq == engine.structure.mechanism.shared_model.nq + 2
    drives, found = home + np.random.default_rng(7).uniform(-0.4, 0.4, (5, 2)), []
    for one in (engine, free):
        starts = HomotopyStarts(one, joints_at(home, tip_of(home))).starts(drives)
        structure, joints = one.structure, one.close(drives, starts).require_all().joints
        found.append((structure.joint_values(joints), own_force(structure.mechanism, structure.configurations(joints))))
    (values, force), (free_values, free_force) = found
    assert values.keys() == free_values.keys()
    for name, course in values.items():
        np.testing.assert_allclose(free_values[name], course, rtol=0, atol=SAME)
    np.testing.assert_allclose(free_force, force, rtol=SAME)


def displaced(mechanism, joints, errors):
    """Return the mechanism whose URDF holds errors, shape (joints, 6)."""
    return perturbed(mechanism, {name: placement_error(e) for name, e in zip(joints, errors, strict=True)})


def test_errors_displace_as_a_urdf_of_their_own_does(planar):
    engine, home, homotopy = planar
    mechanism, errors = engine.structure.mechanism, errors_of(engine, 3)
    sites = engine.structure.site_joints
    drives, start = np.tile(home, (3, 1)), homotopy.starts(np.tile(home, (3, 1)))
    single = np.where(np.arange(len(sites))[:, None] == 1, errors[0], 0.0)
    for given, held in ((errors.reshape(3, -1), errors[0]), (SiteErrors.one_each([1] * 3, errors[[0] * 3, 1]), single)):
        closed = engine.close(drives, start, given).require_all()
        transfer = engine.transfer(closed, None, given)
        solver = ClosureSolver(displaced(mechanism, sites, held))
        result = solver.solve(dict(zip(mechanism.loops.drives, home, strict=True)), start.joints[0])
        np.testing.assert_allclose(closed.position[0], result.pose_base_to_end.translation, rtol=0, atol=1e-12)
        expected = closed_chain_transfer(solver, result, engine.parameters).matrix
        np.testing.assert_allclose(transfer.matrix[0], expected, rtol=0, atol=1e-9 * np.abs(expected).max())


def test_the_transfer_matrix_equals_differences_of_closures(planar):
    engine, home, _ = planar
    mechanism, step = engine.structure.mechanism, 1e-4
    parameters = [*engine.parameters, *drive_parameters(mechanism)]
    at_home = mechanism.with_joint_values(mechanism.neutral_configuration(), joints_at(home, tip_of(home)))
    closed = engine.close(home[None], engine.start_at(at_home[None])).require_all()
    matrix = engine.transfer(closed, parameters).matrix[0]
    count = len(engine.parameters)
    steps = step * np.array([-2, -1, 1, 2])
    for p in range(len(parameters)):
        errors, drives = np.zeros((4, count)), np.tile(home, (4, 1))
        if p < count:
            errors[:, p] = steps
        else:
            drives[:, p - count] += steps
        found = engine.close(drives, closed.as_start()[np.zeros(4, dtype=int)], errors).require_all()
        columns = [
            np.r_[found.position[b] - found.position[a], pin.log3(found.rotation[b] @ found.rotation[a].T)]
            for a, b in ((1, 2), (0, 3))
        ]
        expected = (8.0 * columns[0] - columns[1]) / (12.0 * step)
        np.testing.assert_allclose(matrix[:, p], expected, rtol=0, atol=1e-6 * np.abs(matrix).max())


def test_a_mechanism_displaced_twice_is_one_urdf_with_both_errors():
    mechanism = arm()
    model = mechanism.shared_model
    random = np.random.default_rng(8)
    joints = [n for n in mechanism.joint_paths if n != "universe"]
    first, second = random.normal(size=(2, len(joints), 6)) * 0.01
    found = mechanism
    for errors in (first, second):
        poses = [pin.SE3(pin.exp3(e[3:]), e[:3]) for e in errors]
        found = found.displaced(dict(zip(joints, poses, strict=True)))
    expected = displaced(displaced(mechanism, joints, first), joints, second)
    for changed in (found, pickle.loads(pickle.dumps(found))):
        for one, other in zip(changed.shared_model.frames, expected.shared_model.frames, strict=True):
            np.testing.assert_allclose(one.placement.homogeneous, other.placement.homogeneous, rtol=0, atol=1e-14)
        for one, other in zip(changed.shared_model.jointPlacements, expected.shared_model.jointPlacements, strict=True):
            np.testing.assert_allclose(one.homogeneous, other.homogeneous, rtol=0, atol=1e-14)
        for one, other in zip(changed.shared_model.inertias, expected.shared_model.inertias, strict=True):
            np.testing.assert_allclose(one.toDynamicParameters(), other.toDynamicParameters(), rtol=0, atol=1e-13)
    assert mechanism.shared_model == model  # the original stays as it was
    with pytest.raises(UnknownJointError):
        mechanism.displaced({"elbov": pin.SE3.Identity()})


def test_failed_samples_say_so_and_leave_the_others_alone(planar):
    engine, home, homotopy = planar
    drives = np.tile(home, (4, 1))
    drives[1, 0] = np.nan
    drives[2] = (np.pi, 0.0)  # the cranks point away from each other: the couplers do not reach
    start = homotopy.starts(np.tile(home, (4, 1)))
    errors = np.zeros((4, len(engine.parameters)))
    errors[3, 2] = np.inf
    closed = engine.close(drives, start, errors)
    assert closed.status[[0, 1, 3]].tolist() == [0, 3, 3]
    assert closed.status[2] in (1, 2)
    assert np.isnan(closed.position[1:]).all()
    transfer = engine.transfer(closed, None, errors)
    np.testing.assert_array_equal(transfer.status, closed.status)
    assert np.isfinite(transfer.matrix[0]).all()
    assert np.isnan(transfer.matrix[1:]).all()
    assert np.isnan(homotopy.starts(drives).position[2]).all()
    strict = GeneralEngine(engine.structure.mechanism, ClosureOptions(max_gap_m=1e-9))
    bent = errors_of(engine, 1, spread=(0.0, 5e-3)).reshape(1, -1)
    assert strict.close(home[None], start[:1], bent).status.tolist() == [2]


def test_a_home_that_does_not_close_says_so():
    with pytest.raises(ClosureError, match="do not close"):
        HomotopyStarts(engine_for(five_bar_3d()), {"a_j1": 3.1, "b_j1": 0.1})


def test_drives_that_home_does_not_name_give_way_where_they_must():
    """The first crank points away from the second, whose coupler cannot reach while it stands at zero."""
    mechanism = five_bar_3d()
    with pytest.raises(ClosureError):
        closed_home(mechanism, {"a_j1": 3.1, "b_j1": 0.0})
    result = closed_home(mechanism, {"a_j1": 3.1})
    assert result.gap_m < 1e-12
    assert result.joint_values["a_j1"] == pytest.approx(3.1, abs=1e-15)
    x, z = result.pose_base_to_end.translation[[0, 2]]
    drives = np.array([3.1, result.joint_values["b_j1"]])
    for knee, length in zip(knees(drives), COUPLERS, strict=True):
        assert np.hypot(x - knee[0], z - knee[1]) == pytest.approx(length, abs=1e-12)
    homotopy = HomotopyStarts(engine_for(mechanism), {"a_j1": 3.1})
    start = homotopy.starts(drives[None])
    np.testing.assert_allclose(start.position[0, [0, 2]], (x, z), rtol=0, atol=1e-12)


def test_shapes_and_names_that_do_not_fit_are_refused(planar):
    engine, home, homotopy = planar
    start = homotopy.starts(home[None])
    with pytest.raises(BadInputError, match="'drives' must have the shape"):
        engine.close(np.zeros((1, 3)), start)
    with pytest.raises(BadInputError, match="the start's joints"):
        engine.close(home[None], BatchStart(np.zeros((1, 3)), np.eye(3)[None], np.zeros((1, 9))))
    with pytest.raises(BadInputError, match="drives must have the shape"):
        homotopy.starts(home)
    with pytest.raises(BadInputError, match="no end_frame"):
        changed = engine.structure.mechanism.loops.model_copy(update={"end_frame": None})
        engine_for(ClosedChainMechanism(engine.structure.mechanism.urdf, changed))
    closed = engine.close(home[None], start)
    with pytest.raises(BadInputError, match="no column for 'payload'"):
        engine.transfer(closed, [PayloadParameter()])
    with pytest.raises(UnknownJointError, match="a_j9"):
        engine.transfer(closed, [PlacementParameter("a", "m", "a_j9", (1.0, 0.0, 0.0, 0.0, 0.0, 0.0))])
    with pytest.raises(UnknownJointError, match="a_j9"):
        engine.structure.site("a_j9")


def test_loops_may_share_joints_and_hang_on_any_body():
    """A third chain is pinned to the first crank's end, so two loops share its joint: circles that meet again."""
    chains = [("a", 0.0, [CRANKS[0], COUPLERS[0]]), ("b", GROUND, [CRANKS[1], COUPLERS[1]]), ("c", -0.5, [0.5, 0.45])]
    loops = LoopsFile(
        base_frame="ground",
        end_frame="c_l2",
        drives=("a_j1", "b_j1"),
        loops=(
            {"name": "tips", "frame_a": "a_tip", "frame_b": "b_tip", "type": "3d"},
            {"name": "pin", "frame_a": "c_tip", "frame_b": "a_l2", "type": "3d"},
        ),
    )
    engine = engine_for(ClosedChainMechanism(planar_urdf("three", chains), loops))
    home = np.array([-2.0, -1.2])

    def elbow(drives):
        return circle_meeting((-0.5, 0.0), 0.5, knees(drives)[0], 0.45, side=+1)

    x, z = elbow(home)
    foot = np.arctan2(-z, x + 0.5)
    along = knees(home)[0] - (x, z)
    values = joints_at(home, tip_of(home)) | {"c_j1": foot, "c_j2": np.arctan2(-along[1], along[0]) - foot}
    drives = home + np.random.default_rng(9).uniform(-0.2, 0.2, (10, 2))
    closed = engine.close(drives, HomotopyStarts(engine, values).starts(drives)).require_all()
    np.testing.assert_allclose(closed.position[:, [0, 2]], [elbow(d) for d in drives], rtol=0, atol=1e-12)
    assert {"a_j1", "c_j2", "b_j1"} <= set(engine.structure.site_joints)
    matrix = engine.transfer(closed, drive_parameters(engine.structure.mechanism)).matrix
    steps = 1e-4 * np.array([1.0, 0.0])
    for k, at in enumerate(drives):
        near, far = (elbow(at + n * steps) - elbow(at - n * steps) for n in (1, 2))
        slope = (8.0 * near - far) / 12e-4
        np.testing.assert_allclose(matrix[k][[0, 2], 0], slope, rtol=0, atol=1e-9 * np.abs(slope).max())
        np.testing.assert_allclose(matrix[k][:, 1], 0.0, rtol=0, atol=1e-12)  # the other crank does not reach it
