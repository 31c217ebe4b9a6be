"""What the drawing says of the rows of a campaign: poses, how drives move them, what weight puts on drives."""

import numpy as np
import pinocchio as pin

from pouring_robot.batch import BatchClosure, Engine
from pouring_robot.effects.conditions import NominalRows
from pouring_robot.effects.robot_causes import causes_of
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.closure.solver import ClosureSolver
from pouring_robot.mechanism.parameters import drive_parameters, placement_parameters
from pouring_robot.mechanism.transfer import closed_chain_transfer
from pouring_robot.robot.description.definition import RobotDefinition


def nominal_rows(robot: RobotDefinition, engine: Engine, closure: BatchClosure) -> NominalRows:
    """Return what the drawing says of rows that its engine, without errors, closed, all of them."""
    mechanism = engine.structure.mechanism
    drives = drive_parameters(mechanism)
    joints = filter(None, engine.structure.site_joints) if mechanism.anchors else ()
    turns = [turn for turn in placement_parameters(joints) if turn.unit == "rad"]
    moved = engine.transfer(closure, (*drives, *turns)).matrix
    values = engine.structure.joint_values(closure.joints)
    own, hangs = causes_of(robot).own_weight, robot.file.payload_frame or str(mechanism.loops.end_frame)
    return NominalRows(
        robot,
        closure.position,
        closure.rotation,
        moved[:, :, : len(drives)],
        tuple(turn.name for turn in turns),
        moved[:, :, len(drives) :],
        _up(mechanism),
        _swings(mechanism, values, len(closure)),
        _own_force(mechanism, values, len(closure)) if own else None,
        mechanism.placement_on_end(hangs).translation if own else None,
    )


def _up(mechanism: ClosedChainMechanism) -> FloatArray:
    """Return the direction against gravity in the base, (3,)."""
    model = mechanism.shared_model
    data = model.createData()
    pin.framesForwardKinematics(model, data, mechanism.neutral_configuration())
    axes = data.oMf[mechanism.frame_id(mechanism.loops.base_frame)].rotation
    gravity = np.array(model.gravity.linear)
    return np.asarray(axes.T @ (-gravity / np.linalg.norm(gravity)))


def _swings(mechanism: ClosedChainMechanism, values: dict[str, FloatArray], rows: int) -> FloatArray:
    """Return the angle of the first turning joint before each sliding drive that no drive moves, (n, D)."""
    drives, paths = mechanism.loops.drives, mechanism.frame_paths
    held = {*drives, *mechanism.loops.locked_joints}
    found = np.full((rows, len(drives)), np.nan)
    for k, drive in enumerate(drives):
        if mechanism.unit_of(drive) == "m":
            before = [j for j in paths[drive] if j in values and j not in held and mechanism.unit_of(j) == "rad"]
            found[:, k] = values[before[0]] if before else np.nan
    return found


def _own_force(mechanism: ClosedChainMechanism, values: dict[str, FloatArray], rows: int) -> FloatArray:
    """Return what the links' own weight puts on every drive, (n, D), in N and Nm.

    Pinocchio's generalised gravity is what the joints must give; the weight does the opposite to each drive, by the way
    in which it moves the joints.
    """
    model, drives = mechanism.shared_model, drive_parameters(mechanism)
    data, neutral, solver = model.createData(), mechanism.neutral_configuration(), ClosureSolver(mechanism)
    found = np.empty((rows, len(drives)))
    for row in range(rows):
        at = mechanism.with_joint_values(neutral, {name: float(course[row]) for name, course in values.items()})
        closed = solver.solve_from(at)
        moved = closed_chain_transfer(solver, closed, drives).joints
        found[row] = -moved.T @ pin.computeGeneralizedGravity(model, data, closed.configuration)
    return found
