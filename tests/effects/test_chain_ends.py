"""A chain that ends in a fixed joint: growth of its last link moves the seat back, against the URDF with it grown."""

import dataclasses

import numpy as np
import pinocchio as pin
import pytest

from pouring_robot.batch import engine_for
from pouring_robot.effects.available import all_effects
from pouring_robot.effects.conditions import bare_conditions, slide_offsets_m
from pouring_robot.effects.default_causes import causes_of
from pouring_robot.effects.link_attachments import carried, chain_ends, grown_places
from pouring_robot.effects.robots_under_conditions import RobotUnderConditions
from pouring_robot.estimation.changes import RowChanges
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.closure.solver import ClosureSolver
from pouring_robot.robot.description.urdf import perturb_urdf
from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.robot import Robot
from tests.support import ROOT, displacement

BRACKETED = """<robot name="bracketed">
  <link name="base"/><link name="upright"/><link name="bracket"/><link name="arm"/><link name="tip"/>
  <joint name="pan" type="continuous"><parent link="base"/><child link="upright"/><axis xyz="0 0 1"/></joint>
  <joint name="bolts" type="fixed"><parent link="upright"/><child link="bracket"/>
    <origin xyz="0.1 0 0.6" rpy="0.3 -0.2 0.5"/></joint>
  <joint name="lift" type="continuous"><parent link="bracket"/><child link="arm"/><axis xyz="0 1 0"/>
    <origin xyz="0.05 0 0.02" rpy="0 0.4 0"/></joint>
  <joint name="mount" type="fixed"><parent link="arm"/><child link="tip"/><origin xyz="0.5 0 0"/></joint>
</robot>"""
FOOT = """<link name="floor"/><link name="foot"/><link name="marker"/>
  <joint name="pillar" type="fixed"><parent link="floor"/><child link="foot"/>
    <origin xyz="0 0.1 0.7" rpy="0 0 1"/></joint>
  <joint name="plate" type="fixed"><parent link="foot"/><child link="base"/><origin xyz="0.2 0 0"/></joint>
  <joint name="pole" type="fixed"><parent link="floor"/><child link="marker"/>
    <origin xyz="-0.6 0.2 0.3" rpy="0 1 0"/></joint>
</robot>"""
ROCKER = """<robot name="rocker">
  <link name="base"/><link name="car"/><link name="rod"/><link name="tip"/><link name="lever"/><link name="seat"/>
  <link name="pin"/><link name="tool"/>
  <joint name="slide" type="prismatic"><parent link="base"/><child link="car"/><origin xyz="0.5 0 0"/>
    <axis xyz="0 1 0"/><limit lower="-0.1" upper="0.1" effort="1" velocity="1"/></joint>
  <joint name="hinge" type="continuous"><parent link="car"/><child link="rod"/><axis xyz="0 0 1"/></joint>
  <joint name="rod_end" type="fixed"><parent link="rod"/><child link="tip"/><origin xyz="-0.35 0.2 0"/></joint>
  <joint name="bearing" type="continuous"><parent link="base"/><child link="lever"/><axis xyz="0 0 1"/></joint>
  <joint name="boss" type="fixed"><parent link="lever"/><child link="seat"/><origin xyz="0.15 0.2 0"/></joint>
  <joint name="journal" type="continuous"><parent link="seat"/><child link="pin"/><axis xyz="0 0 1"/></joint>
  <joint name="head" type="fixed"><parent link="lever"/><child link="tool"/><origin xyz="0.3 0 0.1"/></joint>
</robot>"""
ROBOT_FILE = """format: pouring_robot/robot/1
name: bracketed
urdf: arm.urdf
base_frame: base
end_frame: tip
drives: [{joint: pan}, {joint: lift}]
"""


def test_the_last_link_of_a_five_bar_grows():
    robot = Robot.load(ROOT / "examples" / "robots" / "five_bar" / "robot.yaml")
    definition, strain = robot.model.definition, 1e-3
    ((seat, link, place),) = chain_ends(definition, causes_of(definition).placements.places)
    assert (seat, link) == ("left_seat_mount", "left_coupler")
    location, poses = robot.location_at([0.2, -0.1]), []
    # In the URDF the tip's mount is 0.39 m out on the coupler, along its y.
    for joint, shift in ((seat, strain * place), ("left_tip_mount", strain * np.array([0.0, 0.39, 0.0]))):
        moved = perturb_urdf(definition.urdf(), {joint: displacement(shift)})
        solver = ClosureSolver(ClosedChainMechanism(moved, definition.loops))
        poses.append(solver.solve(location.drives, location.nominal.configuration).pose("base", "pen").translation)
    np.testing.assert_allclose(poses[0], poses[1], rtol=0, atol=1e-9)
    assert np.linalg.norm(poses[0] - location.poses("pen")[0].translation) > 1e-4


def test_a_link_grows_through_the_fixed_joints_that_extend_it(tmp_path):
    """An upright with a bracket bolted on askew that carries the next joint: against the URDF with it grown."""
    (tmp_path / "arm.urdf").write_text(BRACKETED, encoding="utf-8")
    (tmp_path / "robot.yaml").write_text(ROBOT_FILE, encoding="utf-8")
    robot, strain = Robot.load(tmp_path / "robot.yaml"), 1e-3
    grown = grown_places(robot.model.definition, ("pan", "lift"))
    assert [(joint, link) for joint, link, _ in grown] == [("pan", "base"), ("lift", "bracket"), ("lift", "upright")]
    location = robot.location_at([0.4, -0.3])
    poses = []
    for moved in ({"lift": strain * grown[2][2]}, {"bolts": strain * np.array([0.1, 0.0, 0.6])}):
        errors = {joint: displacement(shift) for joint, shift in moved.items()}
        if "bolts" in errors:  # a placement error is given in the joint's own axes
            turned = pin.rpy.rpyToMatrix(0.3, -0.2, 0.5).T @ moved["bolts"]
            errors = {"bolts": displacement(turned)}
        solver = ClosureSolver(ClosedChainMechanism(perturb_urdf(BRACKETED, errors), robot.model.definition.loops))
        poses.append(solver.solve(location.drives, location.nominal.configuration).pose("base", "tip").translation)
    np.testing.assert_allclose(poses[0], poses[1], rtol=0, atol=1e-12)
    assert np.linalg.norm(poses[0] - location.poses("tip")[0].translation) > 5e-4


def test_the_last_link_of_an_open_chain_grows_to_the_end_frame(tmp_path):
    """In every pose the end frame is where it is in the URDF with its mount grown."""
    (tmp_path / "arm.urdf").write_text(BRACKETED, encoding="utf-8")
    (tmp_path / "robot.yaml").write_text(ROBOT_FILE, encoding="utf-8")
    robot, strain = Robot.load(tmp_path / "robot.yaml"), 1e-3
    ((link, place),) = carried(robot.model.definition, "tip", ("pan", "lift"))
    assert link == "arm"
    location = robot.location_at([0.4, -0.3])
    grown = perturb_urdf(BRACKETED, {"mount": displacement(np.array([0.5 * strain, 0.0, 0.0]))})
    solver = ClosureSolver(ClosedChainMechanism(grown, robot.model.definition.loops))
    actual = solver.solve(location.drives, location.nominal.configuration).pose("base", "tip").translation
    drawn = location.poses("tip")[0]
    np.testing.assert_allclose(drawn.translation + strain * drawn.rotation @ place, actual, rtol=0, atol=1e-12)
    rows = bare_conditions(robot.model.definition)
    rotation = pin.exp3(np.array([0.3, -0.4, 0.5])) @ rows.rotation
    turned = dataclasses.replace(rows, rotation=rotation, rises={"ambient": np.arange(3.0)})
    form = all_effects(robot.model.definition)["link_thermal_expansion"].forms(turned)[0]
    moved = np.column_stack([form.parameters[0].changes[f"base.t{axis}"] for axis in "xyz"])
    np.testing.assert_allclose(moved, 1e-6 * np.arange(3.0)[:, None] * (rotation @ place), rtol=1e-12)


@pytest.mark.parametrize(("base", "end"), [("foot", "tip"), ("marker", "tip"), ("tip", "marker"), ("pole", "mount")])
def test_a_robot_that_grows_uniformly_is_the_same_robot_scaled(tmp_path, base, end):
    """For any base frame (beside the foot, the tool, a joint) and any set of joints that may be misplaced."""
    (tmp_path / "arm.urdf").write_text(BRACKETED.replace("</robot>", FOOT), encoding="utf-8")
    said = ROBOT_FILE.replace("base_frame: base\nend_frame: tip", f"base_frame: {base}\nend_frame: {end}")
    (tmp_path / "robot.yaml").write_text(said + "places: [lift]\n", encoding="utf-8")
    robot = Robot.load(tmp_path / "robot.yaml")
    structure, drives = engine_for(robot.nominal_solver.mechanism).structure, [0.4, -0.3]
    drawn = robot.location_at(drives).poses(end)[0]
    rows, rises = bare_conditions(robot.model.definition, 1), {"ambient": np.array([100.0])}
    warm = dataclasses.replace(rows, rotation=drawn.rotation[None], rises=rises)
    form = all_effects(robot.model.definition)["link_thermal_expansion"].forms(warm)[0]
    changes = RowChanges.of(form.parameters[0].changes, structure, 1)
    grown = RobotUnderConditions(robot, {})._standing(changes, 0, structure.site_joints)
    actual = grown.location_at(drives).actual.pose_base_to_end.translation
    np.testing.assert_allclose(actual, (1.0 + 1e-4) * drawn.translation, rtol=0, atol=1e-12)


@pytest.mark.parametrize(("one", "other", "kind"), [("tip", "seat", "3d"), ("seat", "tip", "3d"), ("tip", "pin", "6d")])
def test_rods_that_end_in_a_loop_have_a_length(tmp_path, one, other, kind):
    """It may be wrong, and it grows with the rest: for a rod that ends in a point or on a pin that turns in its end."""
    (tmp_path / "rocker.urdf").write_text(ROCKER, encoding="utf-8")
    loop = f"loops: [{{name: end, frame_a: {one}, frame_b: {other}, type: {kind}}}]\n"
    said = "name: rocker\nurdf: rocker.urdf\nbase_frame: base\nend_frame: tool\ndrives: [{joint: slide}]\n"
    (tmp_path / "robot.yaml").write_text(f"format: pouring_robot/robot/1\n{said}{loop}", encoding="utf-8")
    robot, strain = Robot.load(tmp_path / "robot.yaml"), 1e-4
    drawn = robot.location_at([0.05]).poses("tool")[0]
    assert "rod_end.tx" in {p.name for p in robot.parameters.match("geometry")}
    rows, rises = bare_conditions(robot.model.definition, 1), {"ambient": np.array([strain * 1e6])}
    warm = dataclasses.replace(rows, drives=np.array([[0.05]]), rotation=drawn.rotation[None], rises=rises)
    form = all_effects(robot.model.definition)["link_thermal_expansion"].forms(warm)[0]
    structure = engine_for(robot.nominal_solver.mechanism).structure
    changes = RowChanges.of(form.parameters[0].changes, structure, 1)
    actual = RobotUnderConditions(robot, {})._standing(changes, 0, structure.site_joints).location_at([0.05]).actual
    larger = pin.SE3(drawn.rotation, (1.0 + strain) * drawn.translation)
    assert np.linalg.norm(pin.log6(larger.actInv(actual.pose_base_to_end)).vector) < 1e-12


def test_a_slide_spans_the_joints_at_its_ends():
    """In a hexapod: from its universal joint on the base to its spherical one on the table, by Pinocchio."""
    robot = Robot.load(ROOT / "examples" / "robots" / "hexapod" / "robot.yaml")
    drives = robot.model.definition.home_drives + np.linspace(0.0, 0.03, 6)
    closed = robot.location_at(drives).nominal
    model = closed.mechanism.shared_model
    data = model.createData()
    pin.forwardKinematics(model, data, closed.configuration)
    spans = drives + slide_offsets_m(robot.model.definition)
    for k in range(6):
        upper, lower = (data.oMi[model.getJointId(f"leg{k + 1}_{name}")].translation for name in ("s1", "u1"))
        assert abs(np.linalg.norm(upper - lower) - spans[k]) < 1e-12
    # The pouring robot's legs are measured from joint to joint.
    np.testing.assert_allclose(slide_offsets_m(RobotModel().definition), 0.0, rtol=0, atol=1e-12)
