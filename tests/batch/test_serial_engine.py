"""The batch engine on arms without loops: against Pinocchio's kinematics, the one-at-a-time G, and differences."""

import pickle

import numpy as np
import pinocchio as pin
import pytest

from pouring_robot.batch import BatchStart, CompiledEngine, engine_for
from pouring_robot.exceptions import UnknownJointError, UnsupportedMechanismError
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.closure.solver import ClosureSolver
from pouring_robot.mechanism.local_parameters import drive_parameters, placement_parameters
from pouring_robot.mechanism.transfer import closed_chain_transfer
from pouring_robot.mechanism.weight_on_joints import own_force
from tests.support import ARM_JOINTS, arm, arm_urdf, perturbed, placement_error, round_off

COUNT = 600  # more than one range of samples


@pytest.fixture(scope="module")
def engine():
    return CompiledEngine(arm())


@pytest.fixture
def drives(rng):
    """Values of several turns where a joint has no stop."""
    return rng.uniform(-3.0, 3.0, (COUNT, 6)) * (1, 1, 1, 5, 1, 5)


def anywhere(engine, count=COUNT):
    """Return a start that says nothing but where the locked joints stand."""
    nothing = np.full((count, 3), np.nan), np.full((count, 3, 3), np.nan), np.full((count, 1, 6), np.nan)
    assert engine.structure.joint_names == (ARM_JOINTS,)
    return BatchStart(*nothing)


def errors_of(engine, rng, count=COUNT):
    errors = rng.uniform(-1.0, 1.0, (count, engine.structure.site_count, 6)) * ([2e-3] * 3 + [5e-3] * 3)
    errors[:, [not name for name in engine.structure.site_joints]] = 0.0
    return errors.reshape(count, -1)


def as_built(engine, errors):
    """Return the arm whose URDF holds the errors of one sample."""
    sites = zip(engine.structure.site_joints, errors.reshape(-1, 6), strict=True)
    return perturbed(engine.structure.mechanism, {n: placement_error(e) for n, e in sites if n})


def pinocchio_pose(mechanism, values):
    configuration = mechanism.with_joint_values(
        mechanism.neutral_configuration(), dict(zip(ARM_JOINTS, values, strict=True))
    )
    model = mechanism.copy_model()
    data = model.createData()
    pin.framesForwardKinematics(model, data, configuration)
    return data.oMf[model.getFrameId("foot")].actInv(data.oMf[model.getFrameId("flange")])


def test_poses_are_those_of_pinocchio_whatever_the_start(engine, drives, rng):
    errors = errors_of(engine, rng)
    closed = engine.close(drives, anywhere(engine), errors).require_all()
    np.testing.assert_array_equal(closed.joints[:, 0], drives)  # never wrapped
    assert closed.residual.shape == (COUNT, 0, 6)
    assert not closed.iterations.any()
    for k in range(0, COUNT, 37):
        pose = pinocchio_pose(as_built(engine, errors[k]), drives[k])
        np.testing.assert_allclose(closed.position[k], pose.translation, rtol=0, atol=round_off(terms=100))
        np.testing.assert_allclose(closed.rotation[k], pose.rotation, rtol=0, atol=round_off(terms=100))


def test_the_transfer_matrix_is_that_of_one_arm_at_a_time(engine, drives, rng):
    errors = errors_of(engine, rng)
    parameters = [*placement_parameters(ARM_JOINTS), *drive_parameters(engine.structure.mechanism)]
    found = engine.transfer(engine.close(drives, anywhere(engine), errors), parameters, errors)
    assert found.matrix.shape == (COUNT, 6, 42)
    assert not found.status.any()
    for k in range(0, COUNT, 37):
        mechanism = as_built(engine, errors[k])
        solver = ClosureSolver(mechanism)
        result = solver.solve(dict(zip(ARM_JOINTS, drives[k], strict=True)), mechanism.neutral_configuration())
        expected = closed_chain_transfer(solver, result, parameters).matrix
        np.testing.assert_allclose(found.matrix[k], expected, rtol=0, atol=round_off(terms=300, scale=2.0))


def test_the_transfer_matrix_equals_differences_of_pinocchios_poses(engine, drives):
    closed = engine.close(drives[:1], anywhere(engine, 1))
    parameters = [*engine.parameters, *drive_parameters(engine.structure.mechanism)]
    matrix = engine.transfer(closed, parameters).matrix[0]
    step = 1e-4
    for p in range(len(parameters)):
        columns = []
        for n in (1, 2):
            poses = []
            for sign in (-1, 1):
                errors, values = np.zeros(42), drives[0].copy()
                if p < 36:
                    errors[p] = sign * n * step
                else:
                    values[p - 36] += sign * n * step
                poses.append(pinocchio_pose(as_built(engine, errors), values))
            turn = pin.log3(poses[1].rotation @ poses[0].rotation.T)
            columns.append(np.r_[poses[1].translation - poses[0].translation, turn])
        expected = (8.0 * columns[0] - columns[1]) / (12.0 * step)
        known = 100 * round_off(terms=50) / step
        np.testing.assert_allclose(matrix[:, p], expected, rtol=0, atol=1e-8 + known)


def test_starts_read_pinocchios_configurations(engine, drives):
    mechanism = engine.structure.mechanism
    closed = engine.close(drives[:5], anywhere(engine, 5))
    configurations = [
        mechanism.with_joint_values(mechanism.neutral_configuration(), dict(zip(ARM_JOINTS, values, strict=True)))
        for values in drives[:5]
    ]
    start = engine.start_at(np.array(configurations))
    np.testing.assert_allclose(start.position, closed.position, rtol=0, atol=round_off(terms=100))
    np.testing.assert_allclose(np.cos(start.joints), np.cos(closed.joints), rtol=0, atol=round_off(terms=30))


def test_a_locked_rail_between_base_and_end_stands_where_the_start_says():
    engine = CompiledEngine(arm(base_frame="hall"))
    mechanism = engine.structure.mechanism
    still = dict.fromkeys(ARM_JOINTS, 0.2)
    configuration = mechanism.with_joint_values(mechanism.neutral_configuration(), {"rail": 0.7, **still})
    closed = engine.close(np.full((1, 6), 0.2), engine.start_at(configuration[None])).require_all()
    data = mechanism.copy_model().createData()
    pin.framesForwardKinematics(mechanism.shared_model, data, configuration)
    expected = data.oMf[mechanism.frame_id("flange")].translation
    np.testing.assert_allclose(closed.position[0], expected, rtol=0, atol=round_off(terms=100))
    assert engine.structure.site("rail") == 0


def test_what_is_not_finite_says_so_and_leaves_the_others_alone(engine, drives):
    broken = drives[:4].copy()
    broken[1, 2] = np.nan
    closed = engine.close(broken, anywhere(engine, 4))
    assert closed.status.tolist() == [0, 3, 0, 0]
    assert np.isnan(closed.position[1]).all()
    transfer = engine.transfer(closed)
    assert transfer.status.tolist() == [0, 3, 0, 0]
    assert np.isnan(transfer.matrix[1]).all()
    assert np.isfinite(transfer.matrix[[0, 2, 3]]).all()


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"drives": ARM_JOINTS[:5]}, "joint 'flange_turn' is neither driven nor locked"),
        ({"base_frame": "elbow_link"}, "drive 'waist' does not move 'flange'"),
        ({"base_frame": "flange", "end_frame": "foot"}, "the chain to 'foot' does not start on the base frame's body"),
        ({"base_frame": "flange_turn_link"}, "the chain to 'flange' has no joint"),
    ],
)
def test_what_is_no_serial_arm_is_refused_by_name(changes, problem):
    with pytest.raises(UnsupportedMechanismError, match=problem):
        CompiledEngine(arm(**changes))


def test_a_joint_whose_axis_has_no_length_is_refused_by_name():
    mechanism = arm()
    before, joint, after = mechanism.urdf.partition('<joint name="flange_turn" type="continuous">')
    stuck = ClosedChainMechanism(before + joint + after.replace("1 0 0", "0 0 0", 1), mechanism.loops)
    with pytest.raises(UnsupportedMechanismError, match="joint 'flange_turn' is neither revolute nor prismatic"):
        CompiledEngine(stuck)


def test_joints_beyond_the_end_do_not_matter():
    """As the fingers of a hand: free, or tied to each other by mimic."""
    mechanism = arm(end_frame="pitch_link", drives=ARM_JOINTS[:5])
    tied = mechanism.urdf.replace(
        '<joint name="flange_turn" type="continuous">',
        '<joint name="flange_turn" type="continuous"><mimic joint="pitch" multiplier="2"/>',
    )
    drives = np.array([[0.3, -0.2, 0.5, 7.0, -0.6]])
    for built in (mechanism, ClosedChainMechanism(tied, mechanism.loops)):
        engine, solver = CompiledEngine(built), ClosureSolver(built)
        start = built.neutral_configuration()
        closed = engine.close(drives, engine.start_at(start[None])).require_all()
        result = solver.solve(dict(zip(ARM_JOINTS, drives[0], strict=False)), start)
        assert result.idle_joints == (() if built.mimics else ("flange_turn",))
        np.testing.assert_allclose(closed.position[0], result.pose_base_to_end.translation, rtol=0, atol=1e-14)
        found = closed_chain_transfer(solver, result, engine.parameters).matrix
        np.testing.assert_allclose(engine.transfer(closed).matrix[0], found, rtol=0, atol=1e-14)


def test_what_a_joint_beside_the_chain_carries_weighs_where_it_stands():
    """One that mimics a drive, and one that is locked at its home, as a counterweight: virtual work by differences."""
    keys = {"end_frame": "roll_link", "drives": ARM_JOINTS[:4]}
    loops, locked = arm(**keys).loops, arm(**keys, locked_joints=("rail", "pitch", "flange_turn")).loops
    tied = arm_urdf().replace(
        '<joint name="pitch" type="revolute">',
        '<joint name="pitch" type="revolute"><mimic joint="elbow" multiplier="-0.5" offset="0.4"/>',
    )
    drives = np.array([0.3, -0.2, 0.5, 7.0])
    for urdf, said in ((tied, loops), (arm_urdf(), locked)):
        mechanism = ClosedChainMechanism(urdf, said, home={"pitch": 1.1, "elbow": 0.2})
        model = mechanism.shared_model
        data, structure = model.createData(), CompiledEngine(pickle.loads(pickle.dumps(mechanism))).structure

        def energy(values, mechanism=mechanism, model=model, data=data):
            pitch = 1.1 if not mechanism.mimics else 0.4 - 0.5 * values[2]
            named = dict(zip(ARM_JOINTS, [*values, pitch], strict=False))
            at = mechanism.with_joint_values(pin.neutral(model), named)
            return pin.computePotentialEnergy(model, data, at)

        step = 1e-5
        moved = step * np.eye(4)
        expected = [-(energy(drives + d) - energy(drives - d)) / (2.0 * step) for d in moved]
        joints = np.zeros((1, *structure.star.revolute.shape))
        joints[0, 0, :4] = drives
        found = own_force(mechanism, structure.configurations(joints))[0]
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-7)


def test_a_joint_of_the_chain_that_mimics_another_is_no_drive():
    mechanism = arm(drives=ARM_JOINTS[:5])
    tied = mechanism.urdf.replace(
        '<joint name="flange_turn" type="continuous">',
        '<joint name="flange_turn" type="continuous"><mimic joint="pitch" multiplier="2"/>',
    )
    mechanism = ClosedChainMechanism(tied, mechanism.loops)
    with pytest.raises(UnsupportedMechanismError, match="'flange_turn' mimics 'pitch'"):
        CompiledEngine(mechanism)
    engine = engine_for(mechanism)
    drives = np.array([[0.3, -0.2, 0.5, 7.0, -0.6]])
    closed = engine.close(drives, engine.start_at(mechanism.neutral_configuration()[None])).require_all()
    expected = pinocchio_pose(arm(), [*drives[0], -1.2])
    np.testing.assert_allclose(closed.position[0], expected.translation, rtol=0, atol=1e-14)
    slope = engine.transfer(closed, drive_parameters(mechanism)).matrix[0, :, 4]
    free = ClosureSolver(arm())
    result = free.solve(dict(zip(ARM_JOINTS, [*drives[0], -1.2], strict=True)), free.mechanism.neutral_configuration())
    every = closed_chain_transfer(free, result, drive_parameters(free.mechanism)).matrix
    np.testing.assert_allclose(slope, every[:, 4] + 2.0 * every[:, 5], rtol=0, atol=1e-14)


def test_the_tip_and_the_missing_seat_are_no_sites(engine):
    assert len(engine.parameters) == 36
    for name in ("flange_mount", "", "rail"):
        with pytest.raises(UnknownJointError):
            engine.structure.site(name)
