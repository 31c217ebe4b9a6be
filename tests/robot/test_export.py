"""Other programs get the closed robot: read back by Pinocchio, MuJoCo and trimesh, and simulated in MuJoCo."""

import csv
import json
import re
import shutil

import mujoco
import numpy as np
import pinocchio as pin
import pytest
import trimesh
import yourdfpy
from lxml import etree

from pouring_robot import PouringRobot, Robot, export_robot
from pouring_robot.cli.app import main
from pouring_robot.exceptions import BadInputError, DescriptionError, OutputError
from pouring_robot.io.files import write_together
from pouring_robot.mechanism.arrays import rms
from pouring_robot.mechanism.closure.energy import Loads
from pouring_robot.mechanism.closure.solver import ClosureSolver
from pouring_robot.robot.export.bodies_and_joints import Assembly
from pouring_robot.robot.export.folder import FORMATS, exported_files, joined_or_touching
from pouring_robot.robot.export.joints import JointRow
from pouring_robot.robot.export.mjcf import mjcf
from pouring_robot.robot.export.sdf import mimic_notes
from pouring_robot.robot.export.tree_at_closed_pose import ClosedRobot
from pouring_robot.robot.model import DriveOffset, RobotModel
from pouring_robot.robot.pouring_robot import robot_of
from tests.support import ROOT, crooked_model, pose_gap, random_poses

ROBOTS = ROOT / "examples" / "robots"
NAMES = ("arm", "delta", "five_bar", "hexapod")
PAYLOAD_KG = 500.0


def at_pose(model, pose):
    """Return the robot of a model, closed at a pose of the platform."""
    return ClosedRobot.of(model, pose)


def written(closed, folder, form="urdf", **options):
    """Write an export and return the path of its description."""
    return write_together(exported_files(closed, folder, form, **options))[-1]


def contents(folder):
    """Return the contents of the files of a folder, by relative path."""
    return {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*.*")}


@pytest.mark.parametrize("form", FORMATS)
def test_the_python_export_equals_that_of_the_command(form, tmp_path):
    robot, folders = ROBOTS / "five_bar" / "robot.yaml", (tmp_path / "python", tmp_path / "command")
    files = export_robot(Robot.load(robot), folders[0], form)
    assert main(["export", "--robot", str(robot), "--format", form, "--out", str(folders[1])]) == 0
    assert contents(folders[0]) == contents(folders[1]) and len(files) == len(contents(folders[0]))
    with pytest.raises(OutputError, match="exists already"):
        export_robot(Robot.load(robot), folders[0], form)


def test_an_unknown_format_and_other_objects_are_refused(tmp_path):
    with pytest.raises(BadInputError, match="unknown format 'mjc'; did you mean 'mjcf'"):
        export_robot(PouringRobot(), tmp_path, "mjc")
    with pytest.raises(BadInputError, match=r"give a Robot, .* not a str"):
        export_robot("robot.yaml", tmp_path)


def of_tree(urdf, values, base, tip):
    """Return a pose by Pinocchio's own reading of a URDF at joint values."""
    model = pin.buildModelFromXML(urdf)
    data, configuration = model.createData(), pin.neutral(model)
    for name, value in values.items():
        joint = model.joints[model.getJointId(name)]
        configuration[joint.idx_q : joint.idx_q + joint.nq] = value if joint.nq == 1 else (np.cos(value), np.sin(value))
    pin.framesForwardKinematics(model, data, configuration)
    base, tip = (data.oMf[model.getFrameId(name, pin.FrameType.BODY)] for name in (base, tip))
    return base.actInv(tip)


def sdf_pose(element):
    """Return the pose stated by an element of SDF, in the way of versions up to 1.8."""
    x, y, z, *rpy = (float(value) for value in element.find("pose").text.split())
    return pin.SE3(pin.rpy.rpyToMatrix(np.array(rpy)), np.array([x, y, z]))


@pytest.fixture(scope="module")
def crooked():
    """A robot with tilted axes and a drive beyond its command."""
    model = crooked_model(seed=3, axis_mrad=1.0)
    return model.model_copy(update={"drive_offsets": {"leg2_s3": DriveOffset(offset_mm=0.7)}})


@pytest.mark.parametrize("pose", random_poses(3, seed=11))
def test_the_tree_has_the_pose_of_the_closed_robot(crooked, pose):
    """The package's answer is from the model with its offset, the tree's from joint values that are commands."""
    from pouring_robot.robot.pouring_robot import PouringRobot

    closed, located = at_pose(crooked, pose), PouringRobot(crooked).locate(pose)
    for frame in ("ladle_lip", "leg2_foot", "leg4_moving_rod"):
        found = of_tree(closed.urdf, closed.joints, "fixed_platform", frame)
        assert pose_gap(found, located.actual.pose("fixed_platform", frame)) == pytest.approx([0.0, 0.0], abs=1e-9)
    assert closed.joints["leg2_s3"] == pytest.approx(located.drives["leg2_s3"], abs=1e-15)
    zero = of_tree(closed.urdf_zero_here(), {}, "fixed_platform", "ladle_lip")
    assert pose_gap(zero, located.poses("ladle_lip")[1]) == pytest.approx([0.0, 0.0], abs=1e-9)


LEG_DRIVES = ("leg1_s3", "leg2_s3", "leg3_s3")
# An arm that turns and slides; a belt, a wheel driven by it and the spindle of the slide follow, all about z.
TIED = {
    "turn": ('type="revolute"', "0 0 0.3", '<limit lower="-2" upper="2" effort="9" velocity="1"/>'),
    "slide": ('type="prismatic"', "0.35 0 0", '<limit lower="0" upper="0.2" effort="9" velocity="1"/>'),
    "belt": ('type="continuous"', "0.2 0 0", '<mimic joint="turn" multiplier="-0.5" offset="0.1"/>'),
    "wheel": ('type="continuous"', "0.1 0 0", '<mimic joint="belt" multiplier="3"/>'),
    "spindle": ('type="continuous"', "0.05 0 0", '<mimic joint="slide" multiplier="300"/>'),
    "tip_mount": ('type="fixed"', "0.02 0 -0.05", ""),
}
TIED_OFFSETS = {"turn": 2e-3, "slide": 0.5e-3}


@pytest.fixture
def tied(tmp_path):
    """A robot whose joints follow two drives that are beyond their commands, the spindle by 150 mrad."""
    mass = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    parts, parent = ['<robot name="tied"><link name="base"/>'], "base"
    for name, (kind, place, more) in TIED.items():
        parts.append(
            f'<link name="{name}_link">{mass}</link><joint name="{name}" {kind}><parent link="{parent}"/>'
            f'<child link="{name}_link"/><origin xyz="{place}"/><axis xyz="0 0 1"/>{more}</joint>'
        )
        parent = f"{name}_link"
    (tmp_path / "tied.urdf").write_text("".join((*parts, "</robot>")), encoding="utf-8")
    (tmp_path / "robot.yaml").write_text(
        "format: pouring_robot/robot/1\nname: tied\nurdf: tied.urdf\nbase_frame: base\nend_frame: tip_mount_link\n"
        "drives: [{joint: turn}, {joint: slide}]\n",
        encoding="utf-8",
    )
    offsets = {"turn": DriveOffset(offset_mrad=2.0), "slide": DriveOffset(offset_mm=0.5)}
    return RobotModel.for_robot(tmp_path / "robot.yaml").model_copy(update={"drive_offsets": offsets})


def tied_values(turn, slide):
    """Return the values of all joints of that arm, as a reader of the URDF computes them."""
    belt = -0.5 * turn + 0.1
    return {"turn": turn, "slide": slide, "belt": belt, "wheel": 3.0 * belt, "spindle": 300.0 * slide}


def tied_tip(turn, slide):
    """Return the pose of its tip at drive values, by plane trigonometry."""
    values = tied_values(turn + TIED_OFFSETS["turn"], slide + TIED_OFFSETS["slide"])
    heading, place = 0.0, np.array([0.0, 0.0, 0.3 + values["slide"] - 0.05])
    for name, length in (("turn", 0.35 + 0.2), ("belt", 0.1), ("wheel", 0.05), ("spindle", 0.02)):
        heading += values[name]
        place += length * np.array([np.cos(heading), np.sin(heading), 0.0])
    return pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, heading), place)


@pytest.mark.parametrize("command", [(0.35, 0.01), (-1.2, 0.0)])
def test_joints_that_mimic_a_drive_follow_its_offset_in_every_format(tied, command, tmp_path):
    expected, same = tied_tip(*command), pytest.approx([0.0, 0.0], abs=1e-12)
    location = robot_of(tied).location_at(list(command))
    assert pose_gap(location.actual.pose("base", "tip_mount_link"), expected) == same
    closed = at_pose(tied, list(command))
    for there in (command, (0.7, 0.02)):  # a reader's mimic also holds at other values
        tree = of_tree(closed.urdf, tied_values(*there), "base", "tip_mount_link")
        assert pose_gap(tree, tied_tip(*there)) == same
    assert pose_gap(of_tree(closed.urdf_zero_here(), {}, "base", "tip_mount_link"), expected) == same
    model = mujoco.MjModel.from_xml_path(str(written(closed, tmp_path / "mjcf", "mjcf")))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    there = data.body("tip_mount_link")
    assert pose_gap(pin.SE3(there.xmat.reshape(3, 3), there.xpos), expected) == same
    for form in ("sdf", "drake"):
        link = etree.parse(written(closed, tmp_path / form, form)).find("model/link[@name='tip_mount_link']")
        assert pose_gap(sdf_pose(link), expected) == same


@pytest.mark.parametrize("form", ["sdf", "drake"])
def test_sdf_reports_joints_that_cannot_follow(tied, tmp_path, capsys, form):
    assert main(["export", "--robot", str(tied.definition.path), "--out", str(tmp_path / "out"), "--format", form]) == 0
    said = (
        "SDF 1.7 has no mimic joints, so these joints move freely until the simulator couples them: belt = -0.5 turn, "
    )
    assert said in " ".join(capsys.readouterr().out.split())
    assert said in (tmp_path / "out" / "tied.sdf").read_text()
    assert mimic_notes(()) == []


@pytest.mark.parametrize("form", ["sdf", "drake"])
def test_sdf_has_a_motor_at_every_drive_and_nowhere_else(tied, tmp_path, form):
    """Readers put no motor where the effort is 0, which URDFs from CAD state for all joints."""
    urdf = tied.definition.path.with_name("tied.urdf")
    urdf.write_text(urdf.read_text("utf-8").replace('effort="9"', 'effort="0"'), "utf-8")
    closed = at_pose(RobotModel.for_robot(tied.definition.path), [0.35, 0.005])
    root = etree.parse(written(closed, tmp_path / "out", form))
    moving = {joint.get("name"): float(joint.findtext("axis/limit/effort", "0")) for joint in root.iter("joint")}
    assert {name for name, effort in moving.items() if effort > 0.0} == {"turn", "slide"}


def test_joint_tables_are_those_of_the_tree_whose_joints_include_offsets(tied):
    robot, command = robot_of(tied), [0.35, 0.005]
    row = JointRow.of(robot.location_at(command).actual, tied.drive_offset_values())
    for values in (row.values, at_pose(tied, command).joints):
        assert values == pytest.approx(tied_values(*command), abs=1e-12)


def test_joints_without_limits_turn_as_far_as_commanded(tied):
    """A closure holds their cosine and sine; a joint that follows a drive turns in proportion."""
    path, command = tied.definition.path, [0.35 + 10.0 * np.pi, 0.15]
    urdf = path.with_name("tied.urdf")
    urdf.write_text(urdf.read_text("utf-8").replace('"turn" type="revolute"', '"turn" type="continuous"'), "utf-8")
    tied = RobotModel.for_robot(path).model_copy(update={"drive_offsets": tied.drive_offsets})
    location = robot_of(tied).location_at(command)
    row = JointRow.of(location.actual, tied.drive_offset_values(), location.drives)
    assert row.values == pytest.approx(tied_values(*command), abs=1e-9)
    folder = path.parent / "turned"
    written(at_pose(tied, command), folder)
    pose = json.loads((folder / "joints.json").read_text("utf-8"))["poses"][0]
    assert pose["joints"] == pytest.approx(tied_values(*command), abs=1e-9)


def test_moved_zeros_keep_the_limits_in_place(crooked):
    closed = ClosedRobot.of(crooked)
    one, other = (pin.buildModelFromXML(text) for text in (closed.urdf, closed.urdf_zero_here()))
    values = np.array([closed.joints[name] for name in list(one.names)[1:]])
    np.testing.assert_allclose(other.lowerPositionLimit + values, one.lowerPositionLimit, rtol=0, atol=1e-12)
    np.testing.assert_allclose(other.upperPositionLimit + values, one.upperPositionLimit, rtol=0, atol=1e-12)


def test_moved_zeros_keep_soft_limits_and_switches_in_place(tied):
    path = tied.definition.path.with_name("tied.urdf")
    held = '<safety_controller soft_lower_limit="0.01" soft_upper_limit="0.19" k_velocity="5"/>'
    held += '<calibration rising="0.02"/>'
    text = path.read_text("utf-8").replace('<limit lower="0" upper="0.2"', f'{held}<limit lower="0" upper="0.2"')
    path.write_text(text, "utf-8")
    robot = RobotModel.for_robot(tied.definition.path)
    slide = etree.fromstring(at_pose(robot, [0.35, 0.05]).urdf_zero_here().encode()).find("joint[@name='slide']")
    holds, switch, limit = (slide.find(tag).attrib for tag in ("safety_controller", "calibration", "limit"))
    found = [holds["soft_lower_limit"], holds["soft_upper_limit"], switch["rising"], limit["lower"], limit["upper"]]
    assert [float(value) for value in found] == pytest.approx([-0.04, 0.14, -0.03, -0.05, 0.15], abs=1e-12)
    assert holds["k_velocity"] == "5"


def test_a_tree_with_ball_joints_is_closed_at_moved_zeros_and_reported_open_elsewhere(tmp_path, capsys):
    """A crank, a rod on a ball at its end, and a slide that the rod pushes: its tip is on the slide's pin."""
    mass = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    links = "".join(f'<link name="{name}">{mass}</link>' for name in ("base", "crank", "rod", "slider", "rod_tip"))
    joints = "".join(
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><origin xyz="{place}"/>'
        f'<axis xyz="{axis}"/><limit lower="-2" upper="2" effort="9" velocity="1"/></joint>'
        for name, kind, parent, child, place, axis in (
            ("turn", "revolute", "base", "crank", "0 0 0.5", "0 1 0"),
            ("ball", "revolute", "crank", "rod", "0.15 0.02 0", "0 0 1"),
            ("tip", "fixed", "rod", "rod_tip", "0.4 0 0", "0 0 1"),
            ("slide", "prismatic", "base", "slider", "0.5 0.03 0.5", "1 0 0"),
        )
    )
    (tmp_path / "rod.urdf").write_text(f'<robot name="rod">{links}{joints}</robot>', encoding="utf-8")
    (tmp_path / "robot.yaml").write_text(
        "format: pouring_robot/robot/1\nname: rod\nurdf: rod.urdf\nbase_frame: base\nend_frame: slider\n"
        "joint_types: {ball: spherical}\nloops: [{name: pin, frame_a: rod_tip, frame_b: slider, type: 3d}]\n"
        "drives: [{joint: turn}]\nhome: {turn: 0.3}\n",
        encoding="utf-8",
    )
    closed = at_pose(RobotModel.for_robot(tmp_path / "robot.yaml"), [0.5])
    # The crank's end is at radius 0.15, 0.5 rad; the rod is 0.4 long from there to the slide's pin at y 0.03, z 0.5.
    along = 0.15 * np.cos(0.5) + np.sqrt(0.4**2 - 0.01**2 - (0.15 * np.sin(0.5)) ** 2)
    for name in ("rod_tip", "slider"):
        found = of_tree(closed.urdf_zero_here(), {}, "base", name).translation
        assert found == pytest.approx([along, 0.03, 0.5], abs=1e-9)
    for more, said in ((), "at no joint values"), (("--zero-here",), "only at its zeros"):
        to = ["--robot", str(tmp_path / "robot.yaml"), "--drives", "28", "--out", str(tmp_path / f"out{len(more)}")]
        assert main(["export", *to, *more]) == 0
        printed = " ".join(capsys.readouterr().out.split())
        assert f"URDF has no ball joints: ball turns about one axis there, so the tree closes {said}" in printed


def test_the_error_of_the_tree_elsewhere_is_reported(crooked):
    """Ten poses closed one by one agree with the printed figures."""
    from pouring_robot.robot.pouring_robot import PouringRobot

    closed, robot = ClosedRobot.of(crooked), PouringRobot(crooked.with_offsets_placed())
    off = []
    for pose in random_poses(10, seed=12):
        result = robot.locate(pose).actual
        found = of_tree(closed.urdf, result.joint_values, "fixed_platform", "ladle_lip")
        off.append(pose_gap(found, result.pose("fixed_platform", "ladle_lip"))[0])
    gap_m = closed.over_workspace()
    assert gap_m.size == 81 and 0.0 < rms(gap_m) < gap_m.max()
    assert 0.1 * rms(gap_m) < np.sqrt(np.mean(np.square(off))) < 3.0 * rms(gap_m)
    assert ClosedRobot.of(RobotModel()).over_workspace().max() < 1e-12


def test_a_joint_without_limits_turns_by_its_angle(tmp_path):
    """The five-bar is exact as a tree, whatever kind its URDF gives its joints; one joint has the name of its link."""
    shutil.copytree(ROBOTS, tmp_path / "robots")
    file = tmp_path / "robots" / "five_bar" / "robot.yaml"
    urdf = RobotModel.for_robot(file).definition.urdf().replace('type="revolute"', 'type="continuous"')
    urdf = urdf.replace('name="pen_mount"', 'name="pen"')
    (file.parent / "turning.urdf").write_text(re.sub(r'<limit lower="[^"]*" upper="[^"]*"', "<limit", urdf))
    text = re.sub(r"^(urdf|xacro):.*$", "urdf: turning.urdf", file.read_text(), flags=re.M)
    file.write_text(re.sub(r"^mappings:.*\n(  .*\n)*", "", text, flags=re.M))
    assert ClosedRobot.of(RobotModel.for_robot(file)).over_workspace().max() < 1e-12


@pytest.mark.parametrize("name", NAMES)
def test_other_robots_are_closed_in_mujoco_with_their_masses(name, tmp_path):
    closed = ClosedRobot.of(RobotModel.for_robot(ROBOTS / name / "robot.yaml"))
    model = mujoco.MjModel.from_xml_path(str(written(closed, tmp_path, "mjcf")))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    assembly = Assembly.of(closed)
    for body in assembly.bodies.values():
        if body.name != assembly.base:
            there = data.body(body.name)
            found = pin.SE3(there.xmat.reshape(3, 3), there.xpos)
            assert pose_gap(found, body.pose) == pytest.approx([0.0, 0.0], abs=1e-9)
            mass = body.inertia.mass if body.inertia else 0.0
            assert model.body(body.name).mass[0] == pytest.approx(mass, rel=1e-12)
    assert np.abs(data.efc_pos[: data.ne]).max(initial=0.0) < 1e-9
    assert data.ncon == 0
    for joint, value in closed.joints.items():
        assert data.joint(joint).qpos[0] == pytest.approx(value, abs=1e-12)


def test_mujocos_servos_have_the_effort_limits_of_the_urdf(crooked, tmp_path):
    """Without the keyframe its controls are zero, half a metre from the legs' lengths."""
    closed = ClosedRobot.of(crooked)
    model = mujoco.MjModel.from_xml_path(str(written(closed, tmp_path, "mjcf")))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    urdf = etree.fromstring(closed.urdf.encode())
    efforts = [float(urdf.find(f"joint[@name='{name}']/limit").get("effort")) for name in LEG_DRIVES]
    pulled = np.abs([data.actuator(name).force[0] for name in LEG_DRIVES])
    np.testing.assert_allclose(pulled, efforts, rtol=1e-12)


def test_a_servo_without_a_stated_effort_has_no_limit(tied, tmp_path):
    path = tied.definition.path.with_name("tied.urdf")
    path.write_text(path.read_text("utf-8").replace('upper="0.2" effort="9"', 'upper="0.2" effort="0"'), "utf-8")
    closed = ClosedRobot.of(RobotModel.for_robot(tied.definition.path))
    model = mujoco.MjModel.from_xml_path(str(written(closed, tmp_path / "out", "mjcf")))
    assert dict(zip(("turn", "slide"), model.actuator_forcelimited.tolist(), strict=True)) == {"turn": 1, "slide": 0}
    assert model.actuator("turn").forcerange.tolist() == [-9.0, 9.0]


def test_mujocos_loops_are_as_stiff_as_ours(crooked, tmp_path):
    model = mujoco.MjModel.from_xml_path(str(written(ClosedRobot.of(crooked), tmp_path, "mjcf")))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    rows = (data.efc_KBIP[: data.ne, 0] / data.efc_R[: data.ne]).reshape(-1, 6)
    scale = np.array([model.eq_data[k, 10] for k in range(model.neq)])
    np.testing.assert_allclose(rows[:, :3], 1e8, rtol=1e-6)
    np.testing.assert_allclose(rows[:, 3:] * (scale[:, None] / 2.0) ** 2, 1e5, rtol=1e-6)  # it counts half an angle


def test_mujocos_loops_are_as_stiff_at_a_link_whose_mass_is_in_another_fixed_to_it(tmp_path):
    source = ROBOTS / "five_bar" / "robot.yaml"
    root = etree.fromstring(RobotModel.for_robot(source).definition.urdf().encode())
    etree.SubElement(root, "link", name="pin_body").append(root.find("link[@name='right_pin']/inertial"))
    mount = etree.SubElement(root, "joint", name="pin_mount", type="fixed")
    etree.SubElement(mount, "parent", link="right_pin")
    etree.SubElement(mount, "child", link="pin_body")
    (tmp_path / "pin.urdf").write_bytes(etree.tostring(root))
    (tmp_path / "robot.yaml").write_text(source.read_text().replace("xacro: five_bar.urdf.xacro", "urdf: pin.urdf"))
    closed = ClosedRobot.of(RobotModel.for_robot(tmp_path / "robot.yaml"))
    model = mujoco.MjModel.from_xml_path(str(written(closed, tmp_path / "out", "mjcf")))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    rows = (data.efc_KBIP[: data.ne, 0] / data.efc_R[: data.ne]).reshape(-1, 6)
    np.testing.assert_allclose(rows[:, :3], 1e8, rtol=1e-6)


def settled(closed, payload_kg, most=40):
    """Simulate a robot in MuJoCo, the drives' servos at their commands; return the platform in the base at rest.

    The file holds the loops' and the servos' stiffness; gravity is switched on with a payload.
    """
    assembly = Assembly.of(closed)
    bare = etree.fromstring(mjcf(closed, assembly, joined_or_touching(closed, assembly)).encode())
    for mesh in bare.xpath("//asset/mesh | //geom[@mesh]"):
        mesh.getparent().remove(mesh)
    spec = mujoco.MjSpec.from_string(etree.tostring(bare, encoding="unicode"))
    if payload_kg:
        melt = spec.body("ladle").add_body(name="melt")
        melt.mass, melt.inertia, melt.explicitinertial = payload_kg, [1e-3] * 3, True
    else:
        spec.option.gravity = np.zeros(3)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    for _ in range(most):
        mujoco.mj_step(model, data, 500)
        if np.abs(data.qvel).max() < 1e-8:
            break
    else:
        raise AssertionError("it does not come to rest")
    base, tip = (
        pin.SE3(data.body(name).xmat.reshape(3, 3).copy(), data.body(name).xpos.copy())
        for name in ("fixed_platform", "ladle_lip")
    )
    return base.actInv(tip)


def ours(closed, loads):
    """Return the same by the package: servos are as compliant as in the file."""
    stiffness = {joint.name: joint.servo_stiffness for joint in Assembly.of(closed).servos}
    drives = {name: stiffness[name] for name in closed.mechanism.loops.drives}
    solver = ClosureSolver(closed.mechanism, Loads(drive_stiffness=drives, **loads))
    return solver.solve_from(closed.result.configuration).pose("fixed_platform", "ladle_lip")


def test_mujoco_settles_at_our_pose_under_a_full_ladle(crooked):
    for pose in random_poses(1, seed=13):
        closed = at_pose(crooked, pose)
        cold = closed.result.pose("fixed_platform", "ladle_lip")
        loaded = {"gravity": True, "payload_kg": PAYLOAD_KG, "payload_frame": "ladle"}
        for payload, loads in ((0.0, {}), (PAYLOAD_KG, loaded)):
            expected = ours(closed, loads)
            moved = max(np.linalg.norm(expected.translation - cold.translation), 1e-5)
            assert pose_gap(settled(closed, payload), expected)[0] < 0.02 * moved


def test_contacts_of_joined_bodies_are_excluded_and_no_others(crooked, tmp_path):
    closed = ClosedRobot.of(crooked)
    pairs = joined_or_touching(closed, Assembly.of(closed))
    assert ("leg2_upper_cross", "leg2_fixed_rod") in pairs
    assert ("leg3_foot", "moving_platform") in pairs  # by a loop
    assert ("leg1_fixed_rod", "leg3_fixed_rod") not in pairs
    path = written(closed, tmp_path)
    srdf = etree.parse(path.with_suffix(".srdf"))
    assert len(srdf.findall("disable_collisions")) == len(pairs)
    assert len(srdf.findall("passive_joint")) == 16


@pytest.mark.parametrize("form", FORMATS)
def test_a_folder_is_complete_and_its_meshes_are_the_ladle(form, crooked, tmp_path):
    path = written(ClosedRobot.of(crooked), tmp_path / form, form)
    text = path.read_text(encoding="utf-8")
    assert not text.startswith("<?xml")
    for name in ("ladle.stl", "ladle.obj", "ladle.glb"):
        mesh = trimesh.load_mesh(path.parent / "meshes" / name)
        assert mesh.volume == pytest.approx(trimesh.load_mesh(path.parent / "meshes" / "ladle.stl").volume, rel=1e-4)
    table = json.loads((path.parent / "joints.json").read_text(encoding="utf-8"))
    (row,) = csv.DictReader((path.parent / "joints.csv").open(encoding="utf-8"))
    for name, value in table["poses"][0]["joints"].items():
        assert float(row[f"{name}_{table['units'][name]}"]) == value


def test_a_tree_with_moved_zeros_has_no_files_that_refer_to_others(crooked, tmp_path):
    closed = ClosedRobot.of(crooked)
    files = exported_files(closed, tmp_path, zero_here=True)
    assert not {path.name for path in files} & {"joints.csv", "joints.json", "loops.yaml"}
    written(closed, tmp_path)
    for stale in ("joints.csv", "joints.json", "loops.yaml"):
        with pytest.raises(BadInputError, match=f"{stale}: belongs to a tree with other zeros; delete it"):
            exported_files(closed, tmp_path, zero_here=True)
        (tmp_path / stale).unlink()
    exported_files(closed, tmp_path, zero_here=True)


@pytest.mark.parametrize(("name", "words"), [("arm", "link turret moves"), ("five_bar", "that 'left_elbow' moves")])
def test_links_without_mass_are_named_in_mjcf(name, words, tmp_path):
    source = ROBOTS / name / f"{name}.urdf.xacro"
    root = etree.fromstring(RobotModel.for_robot(source.with_name("robot.yaml")).definition.urdf().encode())
    for inertial in root.xpath("//link/inertial"):
        inertial.getparent().remove(inertial)
    (tmp_path / "bare.urdf").write_bytes(etree.tostring(root))
    file = source.with_name("robot.yaml").read_text(encoding="utf-8")
    file = file.replace(f"xacro: {source.name}", "urdf: bare.urdf")
    (tmp_path / "robot.yaml").write_text(file, encoding="utf-8")
    closed = ClosedRobot.of(RobotModel.for_robot(tmp_path / "robot.yaml"))
    with pytest.raises(DescriptionError, match=words):
        exported_files(closed, tmp_path / "out", "mjcf")


@pytest.mark.parametrize(("link", "moments", "lacks"), [
    ("tip_mount", "", ""),
    ("spindle", "", ""),  # the tip is fixed to it
    ("turn", "", "link turn_link moves and has no mass"),  # nor has the bracket
    ("belt", "0 0 0", "link belt_link moves and has no mass, or no moment of inertia about an axis"),
    ("belt", "0 1 1", "link belt_link moves and has no mass, or no moment of inertia about an axis"),
    ("tip_mount", "0 0 0", ""),  # a point mass that does not move by itself
    ("tip_mount", "0 1 1", "link tip_mount_link: principal moments of inertia 0, 1, 1"),
    ("tip_mount", "1 1 3", "link tip_mount_link: principal moments of inertia 1, 1, 3"),
    ("tip_mount", "1 -1 1", "link tip_mount_link: principal moments of inertia -1, 1, 1"),
])  # fmt: skip
def test_mujoco_has_the_stated_masses_of_links(tied, tmp_path, link, moments, lacks):
    """Whatever their shapes, and whether or not MuJoCo accepts them."""
    path = tied.definition.source
    root = etree.parse(path)
    for entry in root.iterfind("link"):
        etree.SubElement(etree.SubElement(etree.SubElement(entry, "visual"), "geometry"), "sphere", radius="0.1")
        if entry.get("name") == f"{link}_link":
            inertial = entry.find("inertial")
            for key, value in zip(("ixx", "iyy", "izz"), moments.split(), strict=False):
                inertial.find("inertia").set(key, value)
            if not moments:
                entry.remove(inertial)
    etree.SubElement(root.getroot(), "link", name="bracket")
    bracket = etree.SubElement(root.getroot(), "joint", name="bracket_mount", type="fixed")
    etree.SubElement(bracket, "parent", link="turn_link")
    etree.SubElement(bracket, "child", link="bracket")
    root.write(path)
    closed = ClosedRobot.of(RobotModel.for_robot(path.with_name("robot.yaml")), np.array([0.3, 0.1]))
    assert written(closed, tmp_path / "urdf").exists()
    if lacks:
        with pytest.raises(DescriptionError, match=lacks):
            written(closed, tmp_path / "out", "mjcf")
        return
    model = mujoco.MjModel.from_xml_path(str(written(closed, tmp_path / "out", "mjcf")))
    assert model.body_mass.sum() == pytest.approx(len(TIED) - (not moments))


def test_sdf_links_are_closed_and_have_their_masses(crooked, tmp_path):
    closed = ClosedRobot.of(crooked)
    for form, loops in (("sdf", "joint"), ("drake", "{http://drake.mit.edu}linear_bushing_rpy")):
        model = etree.parse(written(closed, tmp_path / form, form)).find("model")
        mass = sum(float(value.text) for value in model.iterfind("link/inertial/mass"))
        assert mass == pytest.approx(sum(i.mass for i in closed.mechanism.shared_model.inertias), rel=1e-8)
        found = sdf_pose(model.find("link[@name='moving_platform']"))
        assert pose_gap(found, closed.result.pose("universe", "moving_platform")) == pytest.approx([0, 0], abs=1e-12)
        assert len(model.findall(loops)) == (4 if form == "drake" else 22 + 2 + 1 + 4)


def test_loops_of_sdf_join_links_where_their_frames_meet(tmp_path):
    """Readers of SDF 1.7 join links only; a ball joint turns about the position of the joint, not of the link."""
    closed = ClosedRobot.of(RobotModel.for_robot(ROBOTS / "delta" / "robot.yaml"))
    model = etree.parse(written(closed, tmp_path / "out", "sdf")).find("model")
    links = {link.get("name"): link for link in model.iterfind("link")}
    for loop in closed.mechanism.loops.loops:
        joint = model.find(f"joint[@name='{loop.name}_loop']")
        parent, child = (links[joint.find(end).text] for end in ("parent", "child"))
        assert parent is links[loop.frame_a]
        expected = closed.result.pose("universe", loop.frame_b)
        assert pose_gap(sdf_pose(child) * sdf_pose(joint), expected) == pytest.approx([0.0, 0.0], abs=1e-12)


@pytest.mark.parametrize("name", ["slide", "world"])
def test_a_link_is_renamed_where_its_name_is_taken(tied, tmp_path, name):
    """By a joint in SDF, where all names in a model are unique, or by what is fixed, in SDF and MuJoCo."""
    path = tied.definition.source
    path.write_text(path.read_text("utf-8").replace("slide_link", name), encoding="utf-8")
    closed = at_pose(RobotModel.for_robot(path.with_name("robot.yaml")), [0.35, 0.01])
    for form in ("sdf", "drake"):
        model = etree.parse(written(closed, tmp_path / form, form)).find("model")
        names = [part.get("name") for part in model.iterfind("*")]
        assert sorted(names) == sorted({*names} - {"world"})
        assert {end.text for end in model.iterfind("joint/child")} < {*names}
    model = mujoco.MjModel.from_xml_path(str(written(closed, tmp_path / "mjcf", "mjcf")))
    assert model.body_mass.sum() == pytest.approx(len(TIED))


def test_a_robot_named_like_a_path_stays_in_its_folder(tied, tmp_path):
    path = tied.definition.source
    path.write_text(path.read_text("utf-8").replace('robot name="tied"', 'robot name="../tied"'), encoding="utf-8")
    closed = at_pose(RobotModel.for_robot(path.with_name("robot.yaml")), [0.35, 0.01])
    for form in FORMATS:
        assert written(closed, tmp_path / form, form).parent == tmp_path / form
    again = RobotModel.for_robot(tmp_path / "urdf" / "robot.yaml")
    assert again.definition.source == tmp_path / "urdf" / ".._tied.urdf"


@pytest.mark.parametrize(("seen", "touched", "scale"), [
    ("visual/part.stl", "collision/part.stl", "1 1 1"),
    ("visual/part.stl", "collision/part.obj", "1 1 1"),
    ("visual/part.obj", "collision/part.stl", "1 1 1"),
    ("part.stl", "part.stl", "1 -3 1"),  # one mesh in two sizes, as for a left and a right leg
])  # fmt: skip
def test_every_format_keeps_meshes_of_the_same_name_apart(tied, tmp_path, seen, touched, scale):
    """A long box is visible, and the collision shape is a block, or the same box in another size."""
    path, sizes = tied.definition.source, {touched: np.array([0.1, 0.1, 0.1])} | {seen: np.array([0.1, 0.2, 0.3])}
    for name, size in sizes.items():
        (path.parent / name).parent.mkdir(exist_ok=True)
        trimesh.creation.box(size).export(path.parent / name)
    root = etree.parse(path)
    for what, name, size in (("visual", seen, "1 1 1"), ("collision", touched, scale)):
        geometry = etree.SubElement(etree.SubElement(root.find("link[@name='tip_mount_link']"), what), "geometry")
        etree.SubElement(geometry, "mesh", filename=name, scale=size)
    root.write(path)
    closed = ClosedRobot.of(RobotModel.for_robot(path.with_name("robot.yaml")), np.array([0.3, 0.1]))
    expected = [sizes[seen], sizes[touched] * np.abs(np.array(scale.split(), dtype=float))]

    model = mujoco.MjModel.from_xml_path(str(written(closed, tmp_path / "mjcf", "mjcf")))
    for geom, size in zip(model.geom_dataid, expected, strict=True):
        first = model.mesh_vertadr[geom]
        corners = model.mesh_vert[first : first + model.mesh_vertnum[geom]]
        assert sorted(np.ptp(corners, axis=0)) == pytest.approx(sorted(size), rel=1e-6)
    for form, tag, attribute in (("urdf", "mesh", "filename"), ("sdf", "uri", None)):
        out = written(closed, tmp_path / form, form)
        names = [entry.get(attribute) if attribute else entry.text for entry in etree.parse(out).iter(tag)]
        for name, size in zip(names, (sizes[seen], sizes[touched]), strict=True):
            assert np.ptp(trimesh.load_mesh(out.parent / name).bounds, axis=0) == pytest.approx(size, rel=1e-6)


def test_axes_are_normalised_for_readers_that_do_not_do_so(tied, tmp_path):
    path = tied.definition.source
    path.write_text(path.read_text("utf-8").replace('xyz="0 0 1"', 'xyz="0 0 2"'), encoding="utf-8")
    closed = at_pose(RobotModel.for_robot(path.with_name("robot.yaml")), [0.35, 0.01])
    robot = yourdfpy.URDF.load(str(written(closed, tmp_path / "out")))
    robot.update_cfg(closed.joints)
    expected = closed.result.pose("base", "slide_link").homogeneous
    np.testing.assert_allclose(robot.get_transform("slide_link", "base"), expected, atol=1e-12)


def test_each_shape_has_its_own_colour_where_materials_share_a_name(tied, tmp_path):
    """As those of CAD programs, which have no names; a name alone refers to the colour with that name."""
    path, root = tied.definition.source, etree.parse(tied.definition.source)
    etree.SubElement(etree.SubElement(root.getroot(), "material", name="blue"), "color", rgba="0 0 1 1")
    for name, rgba in (("", "1 0 0 1"), ("", "0 1 0 1"), ("blue", None)):
        visual = etree.SubElement(root.find("link[@name='tip_mount_link']"), "visual")
        etree.SubElement(etree.SubElement(visual, "geometry"), "sphere", radius="0.1")
        material = etree.SubElement(visual, "material", name=name)
        if rgba:
            etree.SubElement(material, "color", rgba=rgba)
    root.write(path)
    closed = ClosedRobot.of(RobotModel.for_robot(path.with_name("robot.yaml")), np.array([0.3, 0.1]))
    model = mujoco.MjModel.from_xml_path(str(written(closed, tmp_path / "mjcf", "mjcf")))
    np.testing.assert_array_equal(model.geom_rgba, [[1, 0, 0, 1], [0, 1, 0, 1], [0, 0, 1, 1]])


def test_mujoco_loads_flat_meshes(tied, tmp_path):
    path = tied.definition.source
    trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]]).export(
        path.parent / "flat.stl"
    )
    shape = '<visual><geometry><mesh filename="flat.stl"/></geometry></visual></link>'
    path.write_text(path.read_text("utf-8").replace("</link>", shape, 1), encoding="utf-8")
    closed = ClosedRobot.of(RobotModel.for_robot(path.with_name("robot.yaml")), np.array([0.3, 0.1]))
    model = mujoco.MjModel.from_xml_path(str(written(closed, tmp_path / "mjcf", "mjcf")))
    assert sorted(np.ptp(model.mesh_vert, axis=0)) == pytest.approx([0.0, 1.0, 1.0], abs=1e-6)


@pytest.mark.parametrize("name", ["part.stl", "part.obj", "part.dae", "part.ply"])
@pytest.mark.parametrize("content", ["", "version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n"])
@pytest.mark.parametrize("what", ["visual", "collision"])
def test_a_mesh_file_without_a_mesh_is_named(tied, tmp_path, what, content, name):
    """Such as the pointers to large files in a repository before they are fetched."""
    path = tied.definition.source
    (path.parent / name).write_text(content, encoding="utf-8")
    shape = f'<{what}><geometry><mesh filename="{name}"/></geometry></{what}></link>'
    path.write_text(path.read_text("utf-8").replace("</link>", shape, 1), encoding="utf-8")
    closed = ClosedRobot.of(RobotModel.for_robot(path.with_name("robot.yaml")), np.array([0.3, 0.1]))
    with pytest.raises(DescriptionError, match=rf"the mesh {name} (cannot be read|has no faces)"):
        exported_files(closed, tmp_path / "out")


def test_meshes_of_absent_packages_stay_addresses(tmp_path):
    source = ROBOTS / "arm" / "arm.urdf.xacro"
    urdf = RobotModel.for_robot(source.with_name("robot.yaml")).definition.urdf()
    shape = '<collision><geometry><mesh filename="package://elsewhere/cup.stl"/></geometry></collision></link>'
    (tmp_path / "arm.urdf").write_text(urdf.replace("</link>", shape, 1), encoding="utf-8")
    file = source.with_name("robot.yaml").read_text(encoding="utf-8").replace("xacro: arm.urdf.xacro", "urdf: arm.urdf")
    (tmp_path / "robot.yaml").write_text(file, encoding="utf-8")
    closed = ClosedRobot.of(RobotModel.for_robot(tmp_path / "robot.yaml"))
    assert "package://elsewhere/cup.stl" in written(closed, tmp_path / "out").read_text(encoding="utf-8")
    with pytest.raises(DescriptionError, match=r"cup\.stl is in a package that is not found"):
        exported_files(closed, tmp_path / "out", "mjcf")


def test_robot_wrapper_reads_absolute_meshes_without_a_folder(tmp_path):
    path = written(ClosedRobot.of(RobotModel()), tmp_path, absolute_meshes=True)
    wrapper = pin.RobotWrapper.BuildFromURDF(str(path))
    assert any("ladle.stl" in item.meshPath for item in wrapper.visual_model.geometryObjects)
