"""A chain that ends in a fixed joint: its last link's growth is the seat moved back, against the URDF with it grown."""

import numpy as np
import pinocchio as pin

from pouring_robot.effects.conditions import set_apart
from pouring_robot.effects.families.heat import chain_ends
from pouring_robot.effects.robot_causes import causes_of
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.closure.solver import ClosureSolver
from pouring_robot.mechanism.poses import PlacementError
from pouring_robot.robot.description.urdf import perturb_urdf
from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.robot import Robot
from tests.support import ROOT


def test_the_last_link_of_a_five_bar_grows():
    robot = Robot.load(ROOT / "examples" / "robots" / "five_bar" / "robot.yaml")
    definition, strain = robot.model.definition, 1e-3
    ((seat, link, place),) = chain_ends(definition, causes_of(definition).placements.places)
    assert (seat, link) == ("left_seat_mount", "left_coupler")
    location, poses = robot.location_at([0.2, -0.1]), []
    # The URDF's own: the tip's mount stands 0.39 m out on the coupler, along its y.
    for joint, shift in ((seat, strain * place), ("left_tip_mount", strain * np.array([0.0, 0.39, 0.0]))):
        moved = perturb_urdf(definition.urdf(), {joint: PlacementError(translation_m=tuple(shift.tolist()))})
        solver = ClosureSolver(ClosedChainMechanism(moved, definition.loops))
        poses.append(solver.solve(location.drives, location.nominal.configuration).pose("base", "pen").translation)
    np.testing.assert_allclose(poses[0], poses[1], rtol=0, atol=1e-9)
    assert np.linalg.norm(poses[0] - location.poses("pen")[0].translation) > 1e-4


def test_a_slide_spans_the_joints_at_its_ends():
    """Of a hexapod: from its universal joint on the base to its spherical one on the table, by Pinocchio."""
    robot = Robot.load(ROOT / "examples" / "robots" / "hexapod" / "robot.yaml")
    drives = robot.model.definition.home_drives + np.linspace(0.0, 0.03, 6)
    closed = robot.location_at(drives).nominal
    model = closed.mechanism.shared_model
    data = model.createData()
    pin.forwardKinematics(model, data, closed.configuration)
    spans = drives + set_apart(robot.model.definition)
    for k in range(6):
        upper, lower = (data.oMi[model.getJointId(f"leg{k + 1}_{name}")].translation for name in ("s1", "u1"))
        assert abs(np.linalg.norm(upper - lower) - spans[k]) < 1e-12
    # The pouring robot's legs are counted from joint to joint.
    np.testing.assert_allclose(set_apart(RobotModel().definition), 0.0, rtol=0, atol=1e-12)
