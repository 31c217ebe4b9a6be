"""Joints that tilt under what they carry: a mast that is extended by a joint of a separate branch."""

import json

import numpy as np
import pytest

from pouring_robot import diagnose
from pouring_robot.batch import engine_for
from pouring_robot.campaign.data import Campaign
from pouring_robot.cli.app import main
from pouring_robot.diagnosis.rows import CampaignRows
from pouring_robot.effects.available import all_effects
from pouring_robot.effects.conditions import conditions_of
from pouring_robot.effects.nominal_rows import nominal_rows
from pouring_robot.effects.robots_under_conditions import RobotUnderConditions
from pouring_robot.estimation.noise import NoiseLevel
from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.robot import Robot
from tests.campaign.simulated import write_text

GRAVITY = 9.80665
MAST_KG, ARM_KG, SHIFT, REACH = 20.0, 8.0, 0.1, 0.6
URDF = f"""<robot name="mast">
  <link name="ground"/><link name="height"/><link name="mast"><inertial><origin xyz="{SHIFT} 0 0.5"/>
    <mass value="{MAST_KG}"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="arm"><inertial><origin xyz="{REACH} 0 0"/><mass value="{ARM_KG}"/>
    <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link><link name="tool0"/>
  <joint name="lift" type="prismatic"><parent link="ground"/><child link="height"/><axis xyz="0 0 1"/>
    <limit lower="0" upper="2" effort="1" velocity="1"/></joint>
  <joint name="rise" type="prismatic"><parent link="ground"/><child link="mast"/><axis xyz="0 0 1"/>
    <limit lower="0.2" upper="1.2" effort="1" velocity="1"/><mimic joint="lift" multiplier="0.5" offset="0.2"/></joint>
  <joint name="pan" type="continuous"><parent link="mast"/><child link="arm"/><axis xyz="0 0 1"/></joint>
  <joint name="mount" type="fixed"><parent link="arm"/><child link="tool0"/><origin xyz="1.2 0 0.1"/></joint>
</robot>"""
ROBOT = (
    "format: pouring_robot/robot/1\nname: mast\nurdf: mast.urdf\nbase_frame: ground\nend_frame: tool0\n"
    "drives: [{joint: lift}, {joint: pan}]\n"
)
TABLE_KG, RAM_KG = 15.0, 20.0
MILL = f"""<robot name="mill">
  <link name="bed"/><link name="tool"/><link name="quill"><inertial><mass value="{RAM_KG}"/>
    <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="table"><inertial><origin xyz="0 0.1 -0.2"/><mass value="{TABLE_KG}"/>
    <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="ram" type="prismatic"><parent link="bed"/><child link="quill"/><origin xyz="0.1 0.3 0.5"/>
    <axis xyz="0 0 1"/><limit lower="0" upper="0.4" effort="1" velocity="1"/></joint>
  <joint name="spindle" type="fixed"><parent link="quill"/><child link="tool"/><origin xyz="0.3 0 -0.1"/></joint>
  <joint name="tilt" type="revolute"><parent link="bed"/><child link="table"/><origin xyz="0 0 0.2"/>
    <axis xyz="1 0 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
</robot>"""
ROWS, SOFT = 60, 2e-5  # rad/Nm of the slide half extended, and twice that fully extended


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    """Poses of the mast, tilted by a closed form at the foot of its slide."""
    folder, rng = tmp_path_factory.mktemp("mast"), np.random.default_rng(7)
    (folder / "mast.urdf").write_text(URDF, encoding="utf-8")
    (folder / "robot.yaml").write_text(ROBOT, encoding="utf-8")
    lift, pan = rng.uniform(0.0, 2.0, ROWS), rng.uniform(-3.0, 3.0, ROWS)
    out = np.column_stack([np.cos(pan), np.sin(pan)])
    at = SHIFT * MAST_KG * np.array([1.0, 0.0]) + REACH * ARM_KG * out  # mass times place, in kg m
    soft = SOFT * (1.0 + (lift - 1.0))
    tilt = (soft * GRAVITY)[:, None] * np.column_stack([-at[:, 1], at[:, 0]])  # r x (-m g z)
    place = np.column_stack([1.2 * out, 0.5 * lift + 0.3])
    seen = place + np.cross(np.column_stack([tilt, np.zeros(ROWS)]), place) + 5e-5 * rng.normal(size=(ROWS, 3))
    rows = [",".join(map(repr, row)) for row in np.column_stack([lift, pan, seen]).tolist()]
    metadata = "metrology: {sigma_position_mm: 0.05}\n"
    table = write_text(folder, "lift_m,pan_rad,x_m,y_m,z_m", rows, metadata)
    return Campaign.read(table, RobotModel.for_robot(folder / "robot.yaml").definition)


def test_a_slide_carries_what_it_lifts_and_yields_in_proportion_to_its_extension(campaign):
    rows = CampaignRows(campaign, RobotModel.for_robot(campaign.robot.path), NoiseLevel.stated(5e-5, None))
    given = rows.conditions
    np.testing.assert_allclose(given.slides_m["rise"], 0.5 * campaign.drives[:, 0] + 0.2, rtol=0, atol=1e-12)
    pan = campaign.drives[:, 1]
    about_y = GRAVITY * (SHIFT * MAST_KG + REACH * ARM_KG * np.cos(pan))
    np.testing.assert_allclose(given.joint_moments["rise.ry"], about_y, rtol=1e-9)
    # what moves at half the speed of a drive loads it with half its weight
    np.testing.assert_allclose(given.drive_force[:, 0], -0.5 * GRAVITY * (MAST_KG + ARM_KG), rtol=1e-9)
    effect = all_effects(campaign.robot)["joint_compliance"]
    parameters = {p.name: p for p in effect.form("rise_alone", given).parameters}
    assert {name.partition("_by_")[0] for name in parameters} == {f"rise.yield_{axis}" for axis in "xyz"}
    assert not parameters["rise.yield_z"].changes["rise.rz"].any()  # no moment acts about z
    out = (given.slides_m["rise"] - 0.7) / 0.5
    for power, word in enumerate(("", "_by_stroke", "_by_stroke_squared")):
        change = parameters[f"rise.yield_y{word}"].changes["rise.ry"]
        np.testing.assert_allclose(change, 1e-3 * out**power * about_y / effect.load, rtol=1e-9)


@pytest.fixture(scope="module")
def found(campaign):
    return diagnose(campaign, RobotModel.for_robot(campaign.robot.path))


def test_a_mast_that_leans_is_named(campaign, found):
    assert [effect.cause.effect for effect in found.firm] == ["joint_compliance"]
    assert found.held_out.position("after") < 1.2 * found.held_out.position("floor")
    values = {name.partition(" ")[0]: p for e in found.firm for name, p in found.parameters_of(e)}
    load = all_effects(campaign.robot)["joint_compliance"].load
    for axis in "xy":
        soft = values[f"rise.yield_{axis}"]
        assert abs(soft.value - 1e3 * SOFT * load) < 4.0 * soft.std


def test_the_saved_model_works_where_a_moment_vanishes(found, tmp_path, capsys):
    """Straight ahead no moment acts on the mast about x: the compliance about that axis has no effect."""
    found.save(tmp_path / "found")
    leant = {}
    for pan in ("0", "90"):
        words = ["pose", "--model", str(tmp_path / "found" / "model.yaml"), "--drives", f"1000 {pan}", "--json"]
        assert main(words) == 0
        leant[pan] = json.loads(capsys.readouterr().out)
    assert leant["0"] != leant["90"]


PLANAR = """<robot name="planar"><link name="base"/>{links}<link name="tip"/>{joints}
  <joint name="mount" type="fixed"><parent link="fore"/><child link="tip"/><origin xyz="0.4 0 0"/></joint></robot>"""
MASS = (
    '<inertial><origin xyz="0.2 0 0"/><mass value="3"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
    "</inertial>"
)


@pytest.mark.parametrize(("axis", "weighs", "acts"), [
    ("0 1 0", (True, True), False),  # all moments are about the joint axes
    ("0 0 1", (True, True), True),
    ("0 0 1", (True, False), True),  # a link without mass at the end
    ("0 0 1", (False, False), False),
])  # fmt: skip
def test_any_open_chain_is_diagnosed_with_or_without_masses(tmp_path, axis, weighs, acts):
    masses = zip(("arm", "fore"), weighs, strict=True)
    links = "".join(f'<link name="{name}">{MASS if heavy else ""}</link>' for name, heavy in masses)
    joints = "".join(
        f'<joint name="{name}" type="continuous"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{0.4 * (parent != "base")} 0 0"/><axis xyz="{axis}"/></joint>'
        for name, parent, child in (("one", "base", "arm"), ("two", "arm", "fore"))
    )
    (tmp_path / "planar.urdf").write_text(PLANAR.format(links=links, joints=joints), encoding="utf-8")
    text = ROBOT.replace("mast", "planar").replace("ground", "base").replace("tool0", "tip")
    (tmp_path / "robot.yaml").write_text(text.replace("lift", "one").replace("pan}", "two}"), encoding="utf-8")
    robot = Robot.load(tmp_path / "robot.yaml")
    drives = np.random.default_rng(5).uniform(-2.0, 2.0, (40, 2))
    places = np.array([robot.location_at(row).poses("tip")[0].translation for row in drives])
    noisy = places + 5e-5 * np.random.default_rng(6).normal(size=places.shape)
    rows = [",".join(map(repr, row)) for row in np.column_stack([drives, noisy]).tolist()]
    table = write_text(tmp_path, "one_rad,two_rad,x_m,y_m,z_m", rows, "metrology: {sigma_position_mm: 0.05}\n")
    found = diagnose(table, tmp_path / "robot.yaml")
    assert found.verdict == "no_gap"
    effect = all_effects(found.model.definition)["joint_compliance"]
    assert effect.can_occur(found.diagnoser.rows.conditions) == acts


def mill_under_load(folder, drives, load, base="table", end="tool", axis="1 0 0"):
    """Return the conditions of a mill whose table tilts about an axis, at drive values (n, 2) under a payload."""
    (folder / "mill.urdf").write_text(MILL.replace('xyz="1 0 0"', f'xyz="{axis}"'), encoding="utf-8")
    moved = "".join(f"{{joint: {name}}}, " for name in ("ram", "tilt") if end == "tool" or name == "tilt")
    said = f"name: mill\nurdf: mill.urdf\nbase_frame: {base}\nend_frame: {end}\ndrives: [{moved}]\n"
    (folder / "robot.yaml").write_text(f"format: pouring_robot/robot/1\n{said}", encoding="utf-8")
    robot = Robot.load(folder / "robot.yaml")
    engine = engine_for(robot.nominal_solver.mechanism)
    nominal = nominal_rows(robot.model.definition, engine, engine.close(drives, robot.drawing.starts(drives)))
    return conditions_of(RobotUnderConditions(robot, {"payload_kg": load})._rows(drives), nominal)


def test_a_table_under_a_tool_does_not_carry_its_weight(tmp_path):
    """In axes of a tilting table the tool's weight has a lateral part; it still loads the ram and not the trunnion."""
    drives, load = np.array([[0.1, 0.0], [0.2, 0.7]]), 50.0
    given = mill_under_load(tmp_path, drives, load)
    tilt = drives[:, 1]
    table = -TABLE_KG * GRAVITY * (0.1 * np.cos(tilt) + 0.2 * np.sin(tilt))  # its centre of mass is at (0, 0.1, -0.2)
    carried = np.column_stack([np.full(2, -GRAVITY * (RAM_KG + load)), table])
    np.testing.assert_allclose(given.drive_force, carried, rtol=0, atol=1e-9)
    np.testing.assert_allclose(given.force_by_weight, [[-1.0, 0.0]] * 2, rtol=0, atol=1e-12)
    np.testing.assert_allclose(given.joint_moments["ram.ry"], 0.3 * load * GRAVITY, rtol=1e-12)
    np.testing.assert_allclose(given.joint_moments["tilt.rx"], table, rtol=1e-12)


def test_a_bearing_yields_across_its_axis_in_whichever_direction_that_points(tmp_path):
    """Isotropically: in each direction by the moment across the axis, and not about the axis, which the drive holds."""
    axis, drives = np.array([0.0, 0.6, 0.8]), np.array([[0.2], [0.7]])
    given = mill_under_load(tmp_path, drives, 30.0, "bed", "table", " ".join(map(str, axis)))
    effect = all_effects(given.robot)["joint_compliance"]
    turned = np.zeros((2, 3))
    for parameter in effect.form("all", given).parameters:
        turned += np.stack([parameter.changes.get(f"tilt.r{name}", np.zeros(2)) for name in "xyz"], axis=1)
    moment = np.stack([given.joint_moments[f"tilt.r{name}"] for name in "xyz"], axis=1)
    across = moment - np.outer(moment @ axis, axis)
    np.testing.assert_allclose(turned, 1e-3 * across / effect.load, rtol=0, atol=1e-12)
    assert np.abs(moment @ axis).min() > 1.0
