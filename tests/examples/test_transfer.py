"""G of the example robots against central differences of their closed forms."""

import numpy as np
import pinocchio as pin
import pytest

from pouring_robot.mechanism.closure.solver import ClosureSolver
from pouring_robot.mechanism.gravity import GRAVITY_M_S2
from pouring_robot.mechanism.local_parameters import drive_parameters, placement_parameters
from pouring_robot.mechanism.transfer import closed_chain_transfer
from tests.examples import delta
from tests.examples.machines import MACHINES
from tests.examples.test_robots import at_home, on_the_way, robot_of
from tests.support import relative_error

POSES = 3
STEP = 1e-4
# Fourth-order differences of lengths about 1: truncation STEP^4, and rounding 1e-15 / STEP, leave a share of 1e-10.
TOLERANCE = 1e-8


def closed(name, drives):
    """Return solver and closed result at drive values."""
    mechanism = robot_of(name).mechanism()
    solver, configuration = ClosureSolver(mechanism), at_home(mechanism, name)
    for command in on_the_way(name, drives):
        result = solver.solve(dict(zip(mechanism.loops.drives, command, strict=True)), configuration)
        configuration = result.configuration
    return solver, result


def difference(name, drives, command=0.0, **geometry):
    """Return the twist of the end body, (6,), by a change of commands or geometry, of its closed form."""

    def pose(step):
        changed = {key: step * value for key, value in geometry.items()}
        position, rotation = MACHINES[name].forward((drives + step * command)[None], **changed)
        return pin.SE3(rotation[0], position[0])

    def twist(step):
        first, second = pose(-step), pose(step)
        return np.r_[second.translation - first.translation, pin.log3(second.rotation @ first.rotation.T)]

    return (8.0 * twist(STEP) - twist(2.0 * STEP)) / (12.0 * STEP)


def drives_of(name):
    return MACHINES[name].targets(np.random.default_rng(7), POSES)


@pytest.mark.parametrize("name", MACHINES)
def test_drives(name):
    for drives in drives_of(name):
        solver, result = closed(name, drives)
        found = closed_chain_transfer(solver, result, drive_parameters(solver.mechanism)).matrix
        expected = [difference(name, drives, unit) for unit in np.eye(len(drives))]
        assert relative_error(found, np.transpose(expected)) < TOLERANCE


def test_every_placement_of_the_arm():
    joints = [f"joint{k}" for k in range(1, 7)]
    for drives in drives_of("arm"):
        solver, result = closed("arm", drives)
        found = closed_chain_transfer(solver, result, placement_parameters(joints)).matrix
        units = np.eye(36).reshape(36, 6, 6)
        expected = [difference("arm", drives, origin=unit[:, :3], tilt=unit[:, 3:]) for unit in units]
        assert relative_error(found, np.transpose(expected)) < TOLERANCE


# Displaced joint centres: the joint of each, by chain, and the argument of the closed form; axes as in the base.
CENTRES = [
    ("hexapod", [f"leg{k}_u1" for k in range(1, 7)], "base"),
    ("hexapod", [f"leg{k}_seat_mount" for k in range(1, 7)], "table"),
    ("delta", [f"arm{k}_drive" for k in range(1, 4)], "base"),
    ("delta", [f"arm{k}_seat_mount" for k in range(1, 4)], "platform"),
    ("five_bar", ["left_drive", "right_drive"], "base"),
]


@pytest.mark.parametrize(("name", "joints", "argument"), CENTRES)
def test_displaced_joint_centres(name, joints, argument):
    for drives in drives_of(name):
        solver, result = closed(name, drives)
        model, at_zero = solver.mechanism.shared_model, solver.mechanism.shared_model.createData()
        pin.framesForwardKinematics(model, at_zero, pin.neutral(model))
        count, dimensions = MACHINES[name].centres[argument]
        for k, joint in enumerate(joints):
            # A column displaces along the joint's own axes, here as they stand in the base, or on the table at zero.
            axes = solver.mechanism.pose_world_to_placement(at_zero, joint).rotation.T[:dimensions, :dimensions]
            moved = np.zeros((dimensions, count, dimensions))
            moved[:, k] = axes
            expected = [difference(name, drives, **{argument: change}) for change in moved]
            columns = placement_parameters([joint])[:dimensions]
            found = closed_chain_transfer(solver, result, columns).matrix
            assert relative_error(found, np.transpose(expected)) < TOLERANCE


# Longer links: the joint at the end of each, the axis along it, and the argument of the closed form.
LENGTHS = [
    ("delta", [f"arm{k}_elbow1" for k in range(1, 4)], delta.OUTWARDS[0], "upper"),
    ("delta", [f"arm{k}_wrist1" for k in range(1, 4)], -np.eye(3)[2], "fore"),
    ("five_bar", ["left_elbow", "right_elbow"], np.eye(3)[1], "crank"),
    ("five_bar", ["left_tip_mount", "right_pivot"], np.eye(3)[1], "coupler"),
]


@pytest.mark.parametrize(("name", "joints", "axis", "argument"), LENGTHS)
def test_longer_links(name, joints, axis, argument):
    for drives in drives_of(name):
        solver, result = closed(name, drives)
        model = solver.mechanism.shared_model
        for k, joint in enumerate(joints):
            placement = (
                model.jointPlacements[model.getJointId(joint)]
                if model.existJointName(joint)
                else model.frames[model.getFrameId(joint)].placement
            )
            along = placement.rotation.T @ axis
            columns = [p for p in placement_parameters([joint]) if p.unit == "m"]
            found = closed_chain_transfer(solver, result, columns).matrix @ along
            longer = np.eye(len(joints))[k]
            assert relative_error(found, difference(name, drives, **{argument: longer})) < TOLERANCE


@pytest.mark.parametrize("name", [name for name in MACHINES if MACHINES[name].payloads])
def test_weight_on_the_drives(name):
    payload = MACHINES[name].payloads[-1]
    for drives in drives_of(name):
        solver, result = closed(name, drives)
        parameters = drive_parameters(solver.mechanism)
        moved = closed_chain_transfer(solver, result, parameters, robot_of(name).file.payload_frame)
        model = solver.mechanism.shared_model
        slope = pin.computeGeneralizedGravity(model, model.createData(), result.configuration)
        force = -moved.joints.T @ slope - payload * GRAVITY_M_S2 * moved.matrix[2]
        found = MACHINES[name].weight(drives[None], np.array([payload]))[0]
        assert relative_error(found, force) < TOLERANCE
