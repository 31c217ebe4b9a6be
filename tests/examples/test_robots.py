"""The example robots: they load anywhere, close at home, and reach the poses of their closed forms."""

import functools

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from pouring_robot.batch import CompiledEngine, GeneralEngine, HomotopyStarts
from pouring_robot.batch.kernels.samples import carry_samples, close_samples
from pouring_robot.batch.kernels.transfer import branch_samples, transfer_samples
from pouring_robot.mechanism.closure.solver import ClosureSolver
from pouring_robot.robot.description.definition import RobotDefinition
from tests.examples import arm, delta, five_bar, hexapod
from tests.support import ROOT, pose_gap

MACHINES = {"five_bar": five_bar, "delta": delta, "hexapod": hexapod, "arm": arm}
# Commands at home, and the pose there: from the drawing, in m and rad.
HOME = {
    "five_bar": ([0.0, 0.0], [0.0, 0.61, 0.0]),
    "delta": ([0.0, 0.0, 0.0], [0.0, 0.0, -0.6]),
    "hexapod": ([0.0] * 6, [0.0, 0.0, 0.7]),
    "arm": ([0.0, 0.0, 0.0, 0.0, np.pi / 2, 0.0], [0.77, 0.0, 1.07]),
}
TARGETS = 100


@functools.cache
def robot_of(name):
    return RobotDefinition.load(ROOT / "examples" / "robots" / name / "robot.yaml")


def at_home(mechanism, name):
    return mechanism.with_joint_values(mechanism.neutral_configuration(), robot_of(name).file.home)


@pytest.fixture(scope="module", params=MACHINES)
def name(request):
    return request.param


@pytest.fixture(scope="module")
def mechanism(name):
    return robot_of(name).mechanism()


def targets(name, seed=20261122):
    drives = MACHINES[name].targets(np.random.default_rng(seed), TARGETS)
    return drives, [pin.SE3(R, p) for p, R in zip(*MACHINES[name].forward(drives), strict=True)]


def on_the_way(name, drives):
    """Return drive values from home to some others: in one leap a five-bar or a delta may fold the other way."""
    home = np.array(HOME[name][0])
    return [home + share * (drives - home) for share in (0.25, 0.5, 0.75, 1.0)]


def test_a_drawing_is_closed_where_its_parts_meet_and_nowhere_else():
    """Two circles meet as long as their centres are no further apart than both radii; errors alone may stretch that."""
    drives = np.random.default_rng(7).uniform(-1.8, 1.8, size=(2000, 2))
    tips = five_bar.BASE + five_bar.CRANK[:, None] * np.stack([-np.sin(drives), np.cos(drives)], axis=-1)
    missing = np.linalg.norm(tips[:, 1] - tips[:, 0], axis=1) - five_bar.COUPLER.sum()
    closed = np.isfinite(robot_of("five_bar").drawing().starts(drives).position).all(axis=1)
    told = np.abs(missing) > 2e-4  # the drawing's own precision, twice
    assert (missing[told] > 0.0).sum() > 50
    np.testing.assert_array_equal(closed[told], missing[told] < 0.0)


@pytest.mark.parametrize("name", MACHINES)
def test_closed_forms_are_each_others_inverse(name):
    drives, poses = targets(name)
    position, rotation = np.array([p.translation for p in poses]), np.array([p.rotation for p in poses])
    arguments = {"five_bar": (position[:, :2],), "delta": (position,)}.get(name, (position, rotation))
    np.testing.assert_allclose(MACHINES[name].inverse(*arguments), drives, rtol=0.0, atol=1e-11)


@pytest.mark.parametrize("name", MACHINES)
def test_mujoco_moves_the_tree_as_pinocchio_does(name):
    urdf = robot_of(name).urdf()
    model, other = pin.buildModelFromXML(urdf), mujoco.MjModel.from_xml_string(urdf)
    assert model.nq == other.nq == sum(1 for _ in model.joints) - 1
    data, state = model.createData(), mujoco.MjData(other)
    q = np.random.default_rng(1).uniform(model.lowerPositionLimit, model.upperPositionLimit)
    for k, joint in enumerate(list(model.names)[1:]):
        state.qpos[other.joint(joint).qposadr] = q[k]
    mujoco.mj_kinematics(other, state)
    pin.forwardKinematics(model, data, q)
    for k, joint in enumerate(list(model.names)[1:], start=1):
        anchor = state.xanchor[other.joint(joint).id]
        if model.joints[k].shortname().startswith("JointModelR"):
            np.testing.assert_allclose(anchor, data.oMi[k].translation, rtol=0.0, atol=1e-12)


def test_it_weighs_something_and_its_joints_have_ratings(mechanism):
    model = pin.buildModelFromXML(mechanism.urdf)
    assert all(inertia.mass > 0.01 for inertia in list(model.inertias)[1:])
    assert all(np.linalg.eigvalsh(inertia.inertia).min() > 0.0 for inertia in list(model.inertias)[1:])
    assert np.all(model.upperEffortLimit > 0.0) and np.all(model.upperVelocityLimit > 0.0)
    assert np.all(model.lowerPositionLimit < 0.0) and np.all(model.upperPositionLimit > 0.0)


def test_home_names_every_joint_and_is_closed(mechanism, name):
    assert set(robot_of(name).file.home) == set(mechanism.joint_limits())
    start = at_home(mechanism, name)
    result = ClosureSolver(mechanism).solve({}, start)
    np.testing.assert_allclose(result.configuration, start, rtol=0.0, atol=1e-9)
    drives, position = HOME[name]
    values = mechanism.joint_values(start)
    assert [values[joint] for joint in mechanism.loops.drives] == pytest.approx(drives, abs=1e-15)
    np.testing.assert_allclose(result.pose_base_to_end.translation, position, rtol=0.0, atol=1e-12)
    assert result.freedoms == len(drives)


def test_every_target_is_reached_from_home(mechanism, name):
    solver, home = ClosureSolver(mechanism), at_home(mechanism, name)
    lower, upper = np.array(list(mechanism.joint_limits().values())).T
    for drives, wanted in zip(*targets(name), strict=True):
        configuration = home
        for command in on_the_way(name, drives):
            result = solver.solve(dict(zip(mechanism.loops.drives, command, strict=True)), configuration)
            configuration = result.configuration
        distance, angle = pose_gap(result.pose_base_to_end, wanted)
        assert distance < 1e-9 and angle < 1e-9
        values = np.array([result.joint_values[joint] for joint in mechanism.joint_limits()])
        assert np.all((lower <= values) & (values <= upper))


def test_a_kernel_is_compiled_once_for_whatever_robot_and_errors():
    """Ten seconds of compiling for each shape of robot, or way to hand over errors, would be its user's to wait for."""
    for name in MACHINES:
        engine = CompiledEngine(robot_of(name).mechanism())
        drives = np.array([HOME[name][0]] * 2)
        start = HomotopyStarts(engine, robot_of(name).file.home).starts(drives)
        # The second ones are so large that they grow step by step.
        for errors in (None, np.full((2, 6 * engine.structure.site_count), 0.02)):
            closed = engine.close(drives, start, errors)
            engine.transfer(closed, errors=errors)
            engine.transfer_open_branch(closed.joints, errors=errors)
            engine.carry(np.zeros(2, dtype=np.int64), drives, start, errors)
    for kernel in (close_samples, carry_samples, transfer_samples, branch_samples):
        assert len(kernel.signatures) == 1, kernel.__name__


@pytest.mark.parametrize("kind", [CompiledEngine, GeneralEngine])
def test_every_target_is_reached_through_the_engines(mechanism, name, kind):
    engine = kind(mechanism)
    drives, wanted = targets(name)
    closed = engine.close(drives, HomotopyStarts(engine, robot_of(name).file.home).starts(drives))
    assert np.all(closed.status == 0)
    for position, rotation, target in zip(closed.position, closed.rotation, wanted, strict=True):
        distance, angle = pose_gap(pin.SE3(rotation, position), target)
        assert distance < 1e-9 and angle < 1e-9
