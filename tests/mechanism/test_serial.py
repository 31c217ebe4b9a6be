"""A mechanism without loops: forward kinematics; G against central differences, also with weight and soft drives."""

import dataclasses
import pickle

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import brentq

from pouring_robot.exceptions import ClosureError
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.closure.energy import Loads
from pouring_robot.mechanism.closure.solver import ClosureOptions, ClosureSolver
from pouring_robot.mechanism.gravity import GRAVITY_M_S2
from pouring_robot.mechanism.local_parameters import (
    DriveParameter,
    FrameParameter,
    PayloadParameter,
    PlacementParameter,
    StiffnessParameter,
    drive_parameters,
    placement_parameters,
)
from pouring_robot.mechanism.loops_file import LoopsFile
from pouring_robot.mechanism.transfer import closed_chain_transfer
from tests.support import ARM_JOINTS, arm, arm_urdf, perturbed, placement_error, pose_gap, round_off

VALUES = dict(zip(ARM_JOINTS, (0.7, -0.4, 1.1, 9.5, 0.6, -12.0), strict=True))
SOFT = Loads(
    gravity=True,
    payload_kg=12.0,
    payload_frame="flange",
    payload_centre_m=(0.03, 0.0, 0.1),
    drive_stiffness={"shoulder": 2e4, "elbow": 1e4, "roll": 6e3},
)


def solved(mechanism, loads, values=VALUES):
    solver = ClosureSolver(mechanism, loads)
    return solver, solver.solve(values, mechanism.neutral_configuration())


def displaced(mechanism, joint, twist):
    """Return the arm with one joint, fixed or moving, displaced by a separate URDF."""
    return perturbed(mechanism, {joint: placement_error(twist)})


def pose_with(parameter, step, loads):
    """Return the pose with one parameter changed, with everything built and solved anew."""
    mechanism, values, changed = arm(), dict(VALUES), {}
    if isinstance(parameter, PlacementParameter):
        mechanism = displaced(mechanism, parameter.joint, step * np.array(parameter.twist))
    elif isinstance(parameter, DriveParameter):
        values[parameter.joint] += step
    elif isinstance(parameter, StiffnessParameter):
        own = loads.drive_stiffness
        changed = {"drive_stiffness": {**own, parameter.joint: own[parameter.joint] + step}}
    else:
        changed = {"payload_kg": loads.payload_kg + step}
    loads = Loads(**{**vars(loads), **changed})
    return solved(mechanism, loads, values)[1].pose_base_to_end


def fourth_order(parameter, step, loads):
    columns = []
    for n in (1, 2):
        ahead, behind = (pose_with(parameter, s * n * step, loads) for s in (1, -1))
        turn = pin.log3(ahead.rotation @ behind.rotation.T)
        columns.append(np.r_[ahead.translation - behind.translation, turn])
    return (8.0 * columns[0] - columns[1]) / (12.0 * step)


def test_the_pose_is_that_of_the_tree():
    mechanism = arm()
    result = solved(mechanism, Loads())[1]
    model = mechanism.copy_model()
    data = model.createData()
    pin.framesForwardKinematics(model, data, mechanism.with_joint_values(pin.neutral(model), VALUES))
    expected = data.oMf[model.getFrameId("foot")].actInv(data.oMf[model.getFrameId("flange")])
    assert max(pose_gap(result.pose_base_to_end, expected)) < round_off(terms=50)
    assert (result.iterations, result.rank, result.freedoms) == (0, 0, 6)
    assert result.gap_m == result.gap_rad == result.internal_force_n == 0.0
    assert result.residual.shape == (0, 6)
    assert len(result.to_frame()) == 0


@pytest.mark.parametrize("loads", [Loads(), Loads(gravity=True), SOFT], ids=["rigid", "heavy", "soft and loaded"])
def test_every_parameter_matches_central_differences(loads):
    mechanism = arm()
    solver, result = solved(mechanism, loads)
    joints = [*ARM_JOINTS, "rail", "flange_mount"]
    parameters = [*placement_parameters(joints), *drive_parameters(mechanism)]
    steps = [1e-4] * len(parameters)
    if loads is SOFT:
        parameters += [StiffnessParameter("elbow", "Nm/rad"), StiffnessParameter("roll", "Nm/rad"), PayloadParameter()]
        steps += [100.0, 50.0, 0.5]
    transfer = closed_chain_transfer(solver, result, parameters)
    for column, (parameter, step) in enumerate(zip(parameters, steps, strict=True)):
        expected = fourth_order(parameter, step, loads)
        own = np.abs(transfer.matrix[:, column]).max()
        # The tolerance of a pose over the step: the differences cannot be better.
        known = 100 * round_off(terms=50) / step
        np.testing.assert_allclose(
            transfer.matrix[:, column], expected, rtol=0, atol=1e-6 * own + known, err_msg=parameter.name
        )


def test_a_body_loads_the_joints_that_carry_it_whatever_its_links_are_called():
    """It is behind a fixed joint that has the name of another link down the chain."""
    mass = '<inertial><mass value="5"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>'
    urdf, found = arm_urdf().replace('<link name="flange"/>', f'<link name="flange">{mass}</link>'), []
    for name in ("flange_mount", "waist_link"):
        mechanism = ClosedChainMechanism(urdf.replace('"flange_mount"', f'"{name}"'), arm().loops)
        solver, result = solved(mechanism, SOFT)
        found.append(closed_chain_transfer(solver, result, placement_parameters(ARM_JOINTS)).matrix)
    np.testing.assert_array_equal(*found)


def test_the_base_and_the_tool_move_the_pose_as_frames_do():
    solver, result = solved(arm(), Loads())
    pose = result.pose_base_to_end
    parameters = [FrameParameter(side, c) for side in ("base", "tool") for c in ("tx", "ry")]
    matrix = closed_chain_transfer(solver, result, parameters).matrix
    np.testing.assert_allclose(matrix[:, 0], [1, 0, 0, 0, 0, 0], atol=1e-15)
    np.testing.assert_allclose(matrix[:3, 1], np.cross([0, 1, 0], pose.translation), atol=1e-15)
    np.testing.assert_allclose(matrix[:3, 2], pose.rotation[:, 0], atol=1e-15)
    np.testing.assert_allclose(matrix[3:, 3], pose.rotation[:, 1], atol=1e-15)


def test_the_matrix_labels_its_values():
    mechanism = arm()
    solver, result = solved(mechanism, SOFT)
    parameters = [*placement_parameters(["elbow"]), DriveParameter("roll", "rad"), PayloadParameter()]
    found = closed_chain_transfer(solver, result, parameters)
    names = [*(f"elbow.{c}" for c in ("tx", "ty", "tz", "rx", "ry", "rz")), "drive.roll", PayloadParameter().name]
    per = ["m"] * 3 + ["rad"] * 4 + ["kg"]
    assert found.frame == "flange"
    assert list(found.names) == names
    assert found.headline == "G of 'flange' by 8 local parameters"
    assert found.headline in repr(found)
    labelled = found.to_dataarray()
    np.testing.assert_array_equal(labelled, found.matrix)
    assert (labelled.name, labelled.attrs, labelled.dims) == ("G", {"frame": "flange"}, ("component", "parameter"))
    assert {name: labelled[name].values.tolist() for name in labelled.coords} == {
        "component": ["x", "y", "z", "rx", "ry", "rz"],
        "parameter": names,
        "unit": ["m"] * 3 + ["rad"] * 3,
        "per": per,
    }
    labelled[0, 0] += 1.0  # it is the caller's own
    assert labelled[0, 0] == found.matrix[0, 0] + 1.0
    table = found.to_frame()
    assert list(table) == ["parameter", "per", "x_m", "y_m", "z_m", "rx_rad", "ry_rad", "rz_rad"]
    assert (table["parameter"].tolist(), table["per"].tolist()) == (names, per)
    np.testing.assert_array_equal(table[list(table)[2:]], found.matrix.T)
    for name in ("matrix", "joints"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(found, name)[0, 0] = 1.0
    with pytest.raises(dataclasses.FrozenInstanceError):
        found.frame = "foot"


def test_links_before_a_drive_do_not_depend_on_it():
    mechanism = arm()
    solver, result = solved(mechanism, Loads())
    upper = closed_chain_transfer(solver, result, drive_parameters(mechanism), "shoulder_link")
    assert upper.frame == "shoulder_link"
    np.testing.assert_array_equal(upper.matrix[:, 2:], 0.0)
    np.testing.assert_allclose(np.linalg.norm(upper.matrix[3:, :2], axis=0), 1.0, rtol=1e-14)


def test_no_parameter_makes_no_column():
    mechanism = arm()
    solver, result = solved(mechanism, SOFT)
    none = closed_chain_transfer(solver, result, [])
    assert (none.matrix.shape, none.joints.shape) == ((6, 0), (mechanism.shared_model.nv, 0))


def test_a_soft_drive_sags_until_its_spring_carries_the_weight():
    """One drive is compliant: its moment about its own axis, from the weights beyond it, over its stiffness."""
    stiffness, mechanism = 3e4, arm()
    loads = Loads(gravity=True, drive_stiffness={"elbow": stiffness})
    result = solved(mechanism, loads)[1]
    model = mechanism.copy_model()
    data = model.createData()
    elbow = model.getJointId("elbow")
    moment = pin.computeGeneralizedGravity(model, data, result.configuration)[model.idx_vs[elbow]]
    assert result.joint_values["elbow"] - VALUES["elbow"] == pytest.approx(-moment / stiffness, rel=1e-9)
    assert abs(moment) > 1.0


@pytest.mark.parametrize("soft", [False, True])
def test_an_arm_may_have_one_joint(soft):
    """A rod upright on its hinge: its G is that of a lever, and the weight at half its length exerts a torque."""
    length, kg, angle, stiffness = 2.0, 3.0, 0.4, 1e3
    urdf = (
        '<robot name="rod"><link name="foot"/><link name="rod"><inertial><origin xyz="0 0 1"/><mass value="3"/>'
        '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link><link name="tip"/>'
        '<joint name="hinge" type="revolute"><parent link="foot"/><child link="rod"/><axis xyz="0 1 0"/>'
        '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
        '<joint name="end" type="fixed"><parent link="rod"/><child link="tip"/><origin xyz="0 0 2"/></joint></robot>'
    )
    mechanism = ClosedChainMechanism(urdf, LoopsFile(base_frame="foot", end_frame="tip", drives=("hinge",)))
    np.testing.assert_array_equal(mechanism.joint_axes([1]), [[0.0, 0.0, 0.0, 0.0, 1.0, 0.0]])
    solver, result = solved(
        mechanism, Loads(gravity=True, drive_stiffness={"hinge": stiffness} if soft else {}), {"hinge": angle}
    )
    moment = kg * GRAVITY_M_S2 * 0.5 * length
    if soft:
        angle = brentq(lambda a: stiffness * (a - 0.4) - moment * np.sin(a), 0.3, 0.6)
    at = length * np.array([np.sin(angle), 0.0, np.cos(angle)])
    np.testing.assert_allclose(result.pose_base_to_end.translation, at, rtol=0, atol=1e-12)
    parameters = drive_parameters(mechanism) + placement_parameters(["hinge"])
    found = closed_chain_transfer(solver, result, parameters).matrix
    gain = stiffness / (stiffness - moment * np.cos(angle)) if soft else 1.0  # of the angle by its command
    lever = np.array([at[2], 0.0, -at[0], 0.0, 1.0, 0.0])
    np.testing.assert_allclose(found[:, 0], gain * lever, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(found[:, 5], gain * lever, rtol=1e-9, atol=1e-12)  # hinge.ry


def test_drives_alone_hold_the_arm():
    solver, result = solved(arm(), Loads())
    transfer = closed_chain_transfer(solver, result, drive_parameters(solver.mechanism))
    assert np.linalg.matrix_rank(transfer.matrix) == 6


def test_an_arm_without_equilibrium_is_reported():
    hurried = ClosureSolver(arm(), SOFT, ClosureOptions(max_iterations=2))
    with pytest.raises(ClosureError, match=r"no equilibrium: .* after 2 iterations"):
        hurried.solve(VALUES, hurried.mechanism.neutral_configuration())


def test_an_arm_survives_pickling():
    mechanism = pickle.loads(pickle.dumps(arm()))
    assert isinstance(mechanism, ClosedChainMechanism)
    assert mechanism.loops == arm().loops
