"""The error-transfer matrix against central differences of the exact closure, and open branches against kinematics."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
import pinocchio as pin
import pytest

from pouring_robot import ClosedChainMechanism, ClosureSolver, Loads, PlatformPose, RobotModel
from pouring_robot.batch import CompiledEngine
from pouring_robot.exceptions import BadInputError, UnknownJointError
from pouring_robot.mechanism.local_parameters import (
    DriveParameter,
    FrameParameter,
    PayloadParameter,
    PlacementParameter,
    StiffnessParameter,
    placement_parameters,
)
from pouring_robot.mechanism.transfer import closed_chain_transfer
from pouring_robot.robot.description.urdf import perturb_urdf
from pouring_robot.robot.pouring.kinematics import FourUPUKinematics
from tests.support import carried_by, closure_condition, displacement, placement_error, round_off

CHAIN_JOINTS = [f"leg{i}_s{k}" for i in (1, 2, 3, 4) for k in (1, 2, 3, 4, 5)]
JOINTS = [*CHAIN_JOINTS, *(f"leg{i}_seat_mount" for i in (1, 2, 3, 4))]
ELSEWHERE = ["fixed_platform_mount", "trolley_travel", "ladle_mount"]
LOADED = Loads(
    gravity=True,
    payload_kg=400.0,
    payload_centre_m=(0.05, 0.0, -0.28),
    drive_stiffness={"leg1_s3": 2e7, "leg4_s5": 1e6},
)
STEP = 1e-5
LOOPS = RobotModel().definition.loops  # reading them takes as long as a closure


@dataclasses.dataclass(frozen=True)
class Case:
    """A robot with errors at one pose."""

    urdf: str
    loads: Loads
    drives: dict
    start: np.ndarray
    frame: str

    @functools.cached_property
    def mechanism(self):
        return ClosedChainMechanism(self.urdf, LOOPS)

    def solver(self):
        return ClosureSolver(self.mechanism, self.loads)

    def pose(self, parameter, step, start):
        """Close the robot anew from a nearby start with a parameter changed by a step: the exact answer."""
        mechanism, loads, drives = self.mechanism, self.loads, dict(self.drives)
        if isinstance(parameter, PlacementParameter):
            mechanism = self.displaced(parameter, step)
        elif isinstance(parameter, DriveParameter):
            drives[parameter.joint] += step
        elif isinstance(parameter, PayloadParameter):
            loads = dataclasses.replace(loads, payload_kg=loads.payload_kg + step)
        else:
            changed = {parameter.joint: loads.drive_stiffness[parameter.joint] + step}
            loads = dataclasses.replace(loads, drive_stiffness={**loads.drive_stiffness, **changed})
        return ClosureSolver(mechanism, loads).solve(drives, start).pose("fixed_platform", self.frame)

    def displaced(self, parameter, step):
        """Return the mechanism with a joint displaced further, as in a URDF with both errors."""
        return self.mechanism.displaced({parameter.joint: placement_error(step * np.array(parameter.twist))})

    def central_difference(self, parameter, step, start):
        ahead, behind = (self.pose(parameter, sign * step, start) for sign in (1.0, -1.0))
        rotation = pin.log3(ahead.rotation @ behind.rotation.T)
        return np.concatenate([ahead.translation - behind.translation, rotation]) / (2.0 * step)


def make_case(spread_rad, loads=None, frame="moving_platform", seed=3, layout="paper"):
    random = np.random.default_rng(seed)
    model = RobotModel(layout=layout)
    errors = {
        joint: displacement(random.normal(size=3) * 0.2 * spread_rad, random.normal(size=3) * spread_rad)
        for joint in JOINTS
    }
    kinematics = FourUPUKinematics(model.definition.mechanism())
    pose = PlatformPose(tuple(random.uniform((-0.15, -0.05, -0.8), (-0.05, 0.05, -0.45))), random.uniform(-0.4, 1.0))
    urdf = perturb_urdf(model.definition.urdf(), errors)
    return Case(urdf, loads or Loads(), kinematics.inverse(pose), kinematics.configuration(pose), frame)


@pytest.mark.parametrize(
    ("spread_rad", "loads", "frame"),
    [(0.0, Loads(), "moving_platform"), (4e-3, Loads(), "ladle_lip"), (4e-3, LOADED, "ladle_lip")],
    ids=["closed exactly", "left open", "left open, loaded"],
)
def test_every_parameter_matches_central_differences_of_the_closure(spread_rad, loads, frame):
    case = make_case(spread_rad, loads, frame)
    solver = case.solver()
    result = solver.solve(case.drives, case.start)
    assert (result.gap_rad > 1e-3) == (spread_rad > 0.0)
    parameters = [*placement_parameters([*JOINTS, *ELSEWHERE]), *(DriveParameter(j, "") for j in case.drives)]
    transfer = closed_chain_transfer(solver, result, parameters, frame)
    scale = np.abs(transfer.matrix).max()
    for k, parameter in enumerate(parameters):
        numeric = case.central_difference(parameter, STEP, result.configuration)
        np.testing.assert_allclose(transfer.matrix[:, k], numeric, atol=1e-6 * scale, rtol=0.0, err_msg=parameter.name)


def test_payload_and_stiffness_match_central_differences():
    case = make_case(4e-3, LOADED, "ladle_lip", seed=8)
    solver = case.solver()
    result = solver.solve(case.drives, case.start)
    steps = [
        (PayloadParameter(), 0.5),
        (StiffnessParameter("leg1_s3", "N/m"), 2e3),
        (StiffnessParameter("leg4_s5", ""), 50.0),
    ]
    transfer = closed_chain_transfer(solver, result, [parameter for parameter, _ in steps], "ladle_lip")
    for k, (parameter, step) in enumerate(steps):
        numeric = case.central_difference(parameter, step, result.configuration)
        scale = np.abs(numeric).max()
        np.testing.assert_allclose(transfer.matrix[:, k] / scale, numeric / scale, atol=2e-5, err_msg=parameter.name)


def test_frames_move_the_pose_as_a_rigid_body():
    case = make_case(1e-3)
    solver = case.solver()
    result = solver.solve(case.drives, case.start)
    pose = result.pose_base_to_end
    components = ("tx", "ty", "tz", "rx", "ry", "rz")
    parameters = [FrameParameter(side, c) for side in ("base", "tool") for c in components]
    matrix = closed_chain_transfer(solver, result, parameters).matrix
    for k, parameter in enumerate(parameters):
        step = pin.exp6(pin.Motion(1e-6 * np.eye(6)[k % 6]))
        moved = step * pose if parameter.side == "base" else pose * step
        expected = np.concatenate([moved.translation - pose.translation, pin.log3(moved.rotation @ pose.rotation.T)])
        np.testing.assert_allclose(matrix[:, k], expected / 1e-6, atol=2e-6)


@pytest.mark.parametrize("layout", ["paper", "wide"])
def test_an_open_branch_is_the_chain_alone_with_its_joints_held(layout):
    case = make_case(0.0, layout=layout)
    solver = case.solver()
    result = solver.solve(case.drives, case.start)
    parameters = placement_parameters(JOINTS)
    engine = CompiledEngine(solver.mechanism)
    joints = [[result.joint_values[name] for name in chain] for chain in engine.structure.joint_names]
    matrix = engine.transfer_open_branch(np.array([joints]), parameters).matrix[0]

    def platform_along_chain(mechanism, chain):
        model = mechanism.shared_model
        data = model.createData()
        pin.framesForwardKinematics(model, data, result.configuration)
        base, foot, seat, platform = (
            data.oMf[mechanism.frame_id(name)]
            for name in ("fixed_platform", f"leg{chain}_foot", f"leg{chain}_seat", "moving_platform")
        )
        return base.actInv(foot) * seat.actInv(platform)

    for k, parameter in enumerate(parameters):
        chain = int(parameter.joint[3])
        poses = [platform_along_chain(case.displaced(parameter, sign * STEP), chain) for sign in (1.0, -1.0)]
        rotation = pin.log3(poses[0].rotation @ poses[1].rotation.T)
        numeric = np.concatenate([poses[0].translation - poses[1].translation, rotation]) / (2.0 * STEP)
        np.testing.assert_allclose(matrix[:, k], numeric, atol=1e-8, err_msg=parameter.name)


def test_which_chain_carries_the_platform_does_not_change_the_matrix():
    model = RobotModel.load("examples/actual.yaml")
    pose = PlatformPose.from_mm_deg(-120.0, 20.0, -650.0, 15.0)
    matrices, lost = [], 0.0
    for order in ((1, 2, 3, 4), (3, 1, 4, 2), (4, 3, 2, 1)):
        nominal, actual = carried_by(model, order)
        kinematics, solver = FourUPUKinematics(nominal), ClosureSolver(actual)
        result = solver.solve(kinematics.inverse(pose), kinematics.configuration(pose))
        matrices.append(closed_chain_transfer(solver, result, placement_parameters(JOINTS)).matrix)
        condition, size = closure_condition(solver, result)
        lost += round_off(condition, np.abs(matrices[-1]).max(), terms=size)
    assert lost < 1e-6
    for other in matrices[1:]:
        np.testing.assert_allclose(other, matrices[0], rtol=0, atol=lost)


def test_parameters_that_do_not_apply_are_refused():
    case = make_case(0.0)
    solver = case.solver()
    result = solver.solve(case.drives, case.start)
    with pytest.raises(UnknownJointError, match="leg9_s1"):
        closed_chain_transfer(solver, result, placement_parameters(["leg9_s1"]))
    with pytest.raises(BadInputError, match="cut"):
        closed_chain_transfer(solver, result, placement_parameters(["moving_platform_mount"]))
    with pytest.raises(BadInputError, match="rigid"):
        closed_chain_transfer(solver, result, [StiffnessParameter("leg1_s3", "N/m")])
    with pytest.raises(BadInputError, match="gravity"):
        closed_chain_transfer(solver, result, [PayloadParameter()])
    with pytest.raises(UnknownJointError, match="leg4_s3"):
        closed_chain_transfer(solver, result, [DriveParameter("leg4_s3", "m")])
