"""Robot files: their content, what is refused, and that the pouring robot has one."""

import math
import re
import shutil

import numpy as np
import pytest

from pouring_robot.batch import engine_for
from pouring_robot.effects import all_effects
from pouring_robot.effects.condition_facts import sources
from pouring_robot.effects.conditions import bare_conditions
from pouring_robot.effects.default_causes import causes_of
from pouring_robot.exceptions import BadInputError, DescriptionError, NoSolutionError, PouringRobotError
from pouring_robot.io.typed_yaml import read_yaml, yaml_text
from pouring_robot.mechanism.closure.redundancy import redundant_drives
from pouring_robot.mechanism.loops_file import load_loops
from pouring_robot.robot.description.definition import RobotDefinition
from pouring_robot.robot.description.first_file import first_robot_file
from pouring_robot.robot.description.urdf import description_folder, perturb_urdf
from pouring_robot.robot.model import JointPlacement, RobotModel
from pouring_robot.robot.parameter_catalogue import ParameterCatalogue
from pouring_robot.robot.pouring.definition import PouringDefinition
from pouring_robot.robot.robot import Robot
from pouring_robot.robot.tolerances import Tolerances
from tests.support import ROOT, displacement

ROBOTS = ROOT / "examples" / "robots"
ARM = """<robot name="two_joints">
  <link name="base"/><link name="arm"/><link name="slide"/><link name="tip"/><link name="rail"/>
  <joint name="carriage" type="fixed"><parent link="rail"/><child link="base"/></joint>
  <joint name="shoulder" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/></joint>
  <joint name="reach" type="prismatic"><parent link="arm"/><child link="slide"/><axis xyz="1 0 0"/>
    <limit lower="0" upper="1" effort="1" velocity="1"/></joint>
  <joint name="mount" type="fixed"><parent link="slide"/><child link="tip"/><origin xyz="0.1 0 0"/></joint>
</robot>"""
TIP = '<link name="tip"><inertial><mass value="{}"/></inertial></link>'
FAR = '<link name="tip"><inertial><origin xyz="{}"/><mass value="2"/></inertial></link>'
FILE = """format: pouring_robot/robot/1
name: two_joints
urdf: arm.urdf
base_frame: base
end_frame: tip
drives:
  - {joint: shoulder, column: turn, ratio: 0.5}
  - {joint: reach, mm_per_turn: 10.0}
"""


# A bridge on rails, its trolley and hoist, and a measuring wire from the bridge to the hook.
GANTRY_JOINTS = (
    ("rails", "prismatic", "hall", "bridge", "0 0 3", "1 0 0", 0.5, 8.0),
    ("trolley", "prismatic", "bridge", "carriage", "0 0 0", "0 1 0", 0.5, 3.5),
    ("hoist", "prismatic", "carriage", "hook", "0 0 0", "0 0 -1", 0.3, 2.0),
    ("pan", "revolute", "bridge", "wire_pan", "0.5 0 0", "0 0 1", -3.0, 3.0),
    ("tilt", "revolute", "wire_pan", "wire_tilt", "0 0 0", "0 1 0", -1.5, 1.5),
    ("wire", "prismatic", "wire_tilt", "wire_end", "0 0 0", "1 0 0", 0.1, 6.0),
)
GANTRY = """format: pouring_robot/robot/1
name: gantry
urdf: gantry.urdf
base_frame: bridge
end_frame: hook
loops: [{name: wire, frame_a: wire_end, frame_b: hook, type: 3d}]
travel: [rails]
drives: [{joint: trolley}, {joint: hoist}]
home: {trolley: 2.0, hoist: 1.2, pan: 1.8, tilt: 0.5, wire: 2.4}
"""


@pytest.fixture
def gantry(tmp_path):
    links = "".join(f'<link name="{name}"/>' for name in ("hall", *(child for _, _, _, child, *_ in GANTRY_JOINTS)))
    joints = "".join(
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><origin xyz="{place}"/>'
        f'<axis xyz="{axis}"/><limit lower="{lower}" upper="{upper}" effort="1" velocity="1"/></joint>'
        for name, kind, parent, child, place, axis, lower, upper in GANTRY_JOINTS
    )
    (tmp_path / "gantry.urdf").write_text(f'<robot name="gantry">{links}{joints}</robot>', encoding="utf-8")
    path = tmp_path / "robot.yaml"
    path.write_text(GANTRY, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("mm_per_turn: 10.0", "mm_per_turn: 10.0, zero: 50", "write 50 mm as 0.05"),
        ("ratio: 0.5", "ratio: 0.5, zero: -90", "write -90 deg as -1.5708"),
        ("base_frame: base", "base_frame: arm", "base_frame 'arm' is carried by the drive 'shoulder'"),
    ],
)
def test_values_that_no_joint_can_have_are_refused_with_the_correction(arm, old, new, says):
    text = arm.read_text()
    arm.write_text(text.replace(old, new))
    with pytest.raises(DescriptionError, match=re.escape(says)):
        RobotDefinition.load(arm)
    arm.write_text(text.replace("ratio: 0.5", "ratio: 0.5, zero: 3.1").replace("10.0", "10.0, zero: -0.9"))
    assert [drive.zero for drive in RobotDefinition.load(arm).drives] == [3.1, -0.9]


@pytest.fixture
def arm(tmp_path):
    (tmp_path / "arm.urdf").write_text(ARM, encoding="utf-8")
    path = tmp_path / "robot.yaml"
    path.write_text(FILE, encoding="utf-8")
    return path


def test_drives_have_columns_units_and_gears(arm):
    turn, reach = RobotDefinition.load(arm).drives
    assert (turn.column, turn.unit, turn.command, turn.factor) == ("turn", "rad", "angle", 0.5)
    assert (reach.column, reach.unit, reach.command) == ("reach", "m", "angle")
    assert reach.per_turn == pytest.approx(0.010, rel=1e-15) and turn.per_turn == pytest.approx(2.0 * math.pi)


def test_a_robot_without_loops_is_near_no_parallel_singularity(arm):
    """Stretched out, its tip moves far for a small rotation; it can only lose a freedom, none can appear."""
    robot = Robot.load(arm)
    found = robot.dexterity(robot.location_at([0.2, 0.4]))
    assert (found.singularity, found.distance) == ("serial", pytest.approx(1.0))


def test_a_camera_whose_axes_meet_in_it_only_rotates(tmp_path):
    """No length relates angles to lengths there; its drives turn about two perpendicular axes."""
    turns = "".join(
        f'<joint name="{name}" type="continuous"><parent link="{parent}"/><child link="{child}"/><axis xyz="{axis}"/>'
        "</joint>"
        for name, parent, child, axis in (("pan", "foot", "yoke", "0 0 1"), ("tilt", "yoke", "lens", "0 1 0"))
    )
    links = "".join(f'<link name="{name}"/>' for name in ("foot", "yoke", "lens"))
    (tmp_path / "camera.urdf").write_text(f'<robot name="camera">{links}{turns}</robot>', encoding="utf-8")
    path = tmp_path / "robot.yaml"
    path.write_text(
        "format: pouring_robot/robot/1\nname: camera\nurdf: camera.urdf\nbase_frame: foot\nend_frame: lens\n"
        "drives: [{joint: pan}, {joint: tilt}]\n",
        encoding="utf-8",
    )
    robot = Robot.load(path)
    found = robot.dexterity(robot.location_at([0.2, 0.4]))
    assert (found.condition, found.distance) == (pytest.approx(1.0), pytest.approx(1.0))


@pytest.mark.parametrize(("home", "rails"), [("", 0.0), ("rails: 2.5, ", 2.5)])
def test_a_travel_carries_the_base_and_belongs_to_no_loop(gantry, home, rails):
    """The hook has the freedoms of its drives, wherever the bridge is; the wire's length follows from Pythagoras."""
    gantry.write_text(GANTRY.replace("home: {", f"home: {{{home}"), encoding="utf-8")
    robot = Robot.load(gantry)
    location = robot.location_at([1.5, 1.0])
    assert location.nominal.freedoms == 2 and location.nominal.idle_joints == ()
    assert location.nominal.joint_values["wire"] == pytest.approx(np.sqrt(0.5**2 + 1.5**2 + 1.0**2), abs=1e-12)
    assert location.nominal.joint_values["rails"] == rails
    assert {reach.joint for reach in location.reach} == {"trolley", "hoist", "pan", "tilt", "wire"}
    assert len(robot.model.definition.workspace(robot.drawing)[0]) > 100  # though the rails do not extend to zero
    again = gantry.with_name("again.yaml")
    again.write_bytes(robot.model.definition.files_beside()["robot.yaml"])
    assert RobotDefinition.load(again).loops == robot.model.definition.loops


@pytest.mark.parametrize(
    ("base", "travel", "frame"),
    [
        ("hall", "rails", "hall"),  # between base and hook
        ("bridge", "pan", "bridge"),  # between base and the end of a loop
        ("bridge", "lamp", "bridge"),  # in neither path
        ("hung", "lamp", "hook"),  # carries the base only
    ],
)
def test_a_travel_that_does_not_carry_base_and_robot_is_refused(gantry, base, travel, frame):
    urdf, lamp = gantry.with_name("gantry.urdf"), '<joint name="lamp" type="prismatic"><parent link="bridge"/>'
    lamp += '<child link="hung"/><axis xyz="0 0 1"/><limit lower="0" upper="1" effort="1" velocity="1"/></joint>'
    urdf.write_text(urdf.read_text(encoding="utf-8").replace("</robot>", f'<link name="hung"/>{lamp}</robot>'), "utf-8")
    text = GANTRY.replace("base_frame: bridge", f"base_frame: {base}").replace("[rails]", f"[{travel}]")
    gantry.write_text(text, encoding="utf-8")
    says = f"travel '{travel}' would be held at its home, but it does not carry '{frame}'; make it a drive"
    with pytest.raises(DescriptionError, match=re.escape(says)):
        RobotDefinition.load(gantry)


def test_a_measuring_wire_on_a_robot_with_travel_is_redundant(gantry):
    measured = GANTRY.replace("{joint: hoist}]", "{joint: hoist}, {joint: wire}]\nredundant_drives: true")
    gantry.write_text(measured, encoding="utf-8")
    assert redundant_drives(RobotDefinition.load(gantry).mechanism()) == 1


def test_a_travel_that_the_urdf_fixes_is_a_column_only(arm):
    arm.write_text(FILE + "travel: [carriage]\n", encoding="utf-8")
    definition = RobotDefinition.load(arm)
    assert definition.travels == ("carriage",) and definition.mechanism().loops.locked_joints == ()


def test_drives_are_grouped_by_kind_unless_the_file_says_otherwise(arm):
    assert {k: [d.joint for d in v] for k, v in RobotDefinition.load(arm).groups.items()} == {
        "rotations": ["shoulder"],
        "slides": ["reach"],
    }


@pytest.mark.parametrize(
    ("groups", "found"),
    [
        ("{both: [shoulder, reach]}", {"both": ["shoulder"], "slides": ["reach"]}),
        ("{both: [reach, shoulder]}", {"both": ["reach"], "rotations": ["shoulder"]}),
        ("{tilt: [shoulder]}", {"tilt": ["shoulder"], "slides": ["reach"]}),
        ("{slides: [shoulder], rotations: [shoulder, reach]}", {"slides": ["reach"], "rotations": ["shoulder"]}),
    ],
)
def test_a_group_has_one_unit_and_every_drive_has_a_group(arm, groups, found):
    """Causes depend on the unit of a group: a slide among rotations, or a drive in no group, would have had none."""
    arm.write_text(FILE + f"groups: {groups}\n", encoding="utf-8")
    definition = RobotDefinition.load(arm)
    assert {name: [drive.joint for drive in drives] for name, drives in definition.groups.items()} == found
    assert {"tip", *found} < set(definition.thermometers)
    scales = [e for e in causes_of(definition).entries if e.id.partition(".")[0] == "drive_scale"]
    assert sorted(joint for entry in scales for joint in entry.options["drives"]) == ["reach", "shoulder"]
    effects, columns = all_effects(definition), {"shoulder": "approach_turn", "reach": "approach_reach"}
    for name, drives in found.items():  # it needs the columns of its own drives
        missing = effects[f"drive_backlash.{name}"].missing(bare_conditions(definition))
        assert sources(missing, definition) == tuple(columns[drive] for drive in drives)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("urdf: arm.urdf", "urdf: absent.urdf", "absent.urdf.*cannot be read"),
        ("urdf: arm.urdf", "xacro: absent.xacro", "absent.xacro: cannot be read: No such file or directory$"),
        ("urdf: arm.urdf\n", "", "either urdf or xacro"),
        ("end_frame: tip", "end_frame: tpi\npayload_frame: tip", "end_frame 'tpi' is not a link of the robot; did you"),
        ("base_frame: base\n", "", "base_frame and end_frame are needed"),
        ("joint: reach", "joint: raech", "'raech' is not a joint of the robot; did you mean 'reach'"),
        ("joint: reach", "joint: mount", "'mount' is fixed; a drive slides or turns"),
        ("joint: shoulder, column: turn, ratio: 0.5", "joint: shoulder, mm_per_turn: 5", "turns, so it has no mm_per"),
        ("ratio: 0.5", "ratio: 0", "a ratio of 0 moves nothing"),
        ("column: turn", "column: reach", "two drives have the column 'reach'; .*mimic"),
        ("name: two_joints", "name: two joints", "line 2"),
        ("drives:", "groups: {g: [elbow]}\ndrives:", "group 'g' names 'elbow', which is not a drive"),
        ("drives:", "groups: {g: []}\ndrives:", "group 'g' names no drive"),
        ("drives:", "groups: {g: [reach, reach]}\ndrives:", "group 'g' names a drive twice"),
        ("drives:", "travel: [rail]\ndrives:", "'rail' is not a joint of the robot"),
        ("drives:", "places: [raech]\ndrives:", "'raech' is not a joint of the robot; did you mean 'reach'"),
        ("drives:", "places: [reach.rx]\ndrives:", "'reach.rx' is not a joint of the robot"),
        ("drives:", "axes: [reach.rx]\ndrives:", "'reach.rx' is not a joint of the robot"),
        ("drives:", "drvies: 1\ndrives:", "unknown key 'drvies'; did you mean 'drives'"),
        ("format: pouring_robot/robot/1", "format: pouring_robot/robot/9", "line 1"),
    ],
)
def test_mistakes_are_reported_in_one_line(arm, old, new, says):
    arm.write_text(FILE.replace(old, new), encoding="utf-8")
    with pytest.raises(DescriptionError, match=says) as problem:
        RobotDefinition.load(arm)
    assert "\n" not in str(problem.value)


def test_a_joint_of_no_chain_is_not_displaced(arm):
    """The parameters must not include it either: ``calibrate`` said that there was no 'joint_places'."""
    arm.write_text(FILE + "places: [carriage]\n", encoding="utf-8")
    for asked in (ParameterCatalogue, causes_of):
        with pytest.raises(DescriptionError, match="'carriage' is not a joint of the chains"):
            asked(RobotDefinition.load(arm))


def test_a_place_may_be_listed_twice(arm):
    arm.write_text(FILE + "places: [reach.tx, reach.ty, reach.tx, shoulder.tz, shoulder]\naxes: []\n", encoding="utf-8")
    definition = RobotDefinition.load(arm)
    assert causes_of(definition).placements.along == {"reach": "xy", "shoulder": "xyz"}
    names = {parameter.name for parameter in ParameterCatalogue(definition).match("geometry")}
    assert names == {"drive.shoulder", "drive.reach", "reach.tx", "reach.ty", *(f"shoulder.t{axis}" for axis in "xyz")}


def test_an_invalid_urdf_is_refused(arm):
    (arm.parent / "arm.urdf").write_text("<robot", encoding="utf-8")
    with pytest.raises(DescriptionError, match=r"arm\.urdf"):
        RobotDefinition.load(arm)


def test_the_pouring_robot_is_a_robot_file_too():
    plain = RobotDefinition.load(description_folder() / "robot.yaml")
    own = PouringDefinition()
    assert plain.loops == own.loops == load_loops(description_folder() / "config" / "loops.yaml")
    assert [d.joint for d in plain.drives] == [d.joint for d in own.drives]
    assert [d.unit for d in own.drives] == ["m", "m", "m", "rad"]
    first, second = plain.mechanism().shared_model, own.mechanism().shared_model
    assert list(first.names) == list(second.names)
    for one, other in zip(first.jointPlacements, second.jointPlacements, strict=True):
        np.testing.assert_allclose(one.homogeneous, other.homogeneous, rtol=0, atol=1e-15)


def test_a_loops_file_need_not_repeat_the_robot_file(tmp_path):
    """Above all not its drives, which every robot file lists."""
    shipped = ROBOTS / "delta" / "robot.yaml"
    said = {key: value for key, value in read_yaml(shipped).items() if key not in ("loops", "xacro")}
    loops = {"loops": read_yaml(shipped)["loops"], "base_frame": "nowhere"}
    (tmp_path / "loops.yaml").write_text(yaml_text(loops), encoding="utf-8")
    (tmp_path / "delta.urdf").write_text(RobotDefinition.load(shipped).urdf(), encoding="utf-8")
    text = yaml_text(said | {"urdf": "delta.urdf", "loops": "loops.yaml"})
    (tmp_path / "robot.yaml").write_text(text, encoding="utf-8")
    apart = RobotDefinition.load(tmp_path / "robot.yaml")
    whole = RobotDefinition.load(shipped)
    assert apart.loops.model_copy(update={"mechanism": whole.name}) == whole.loops


def test_a_model_names_its_robot_relative_to_itself(arm):
    model = RobotModel.for_robot(arm)
    model = model.model_copy(update={"joint_placements": {"reach": JointPlacement(translation_mm=(0.0, 1.0, 0.0))}})
    (arm.parent / "models").mkdir()
    path = model.save(arm.parent / "models" / "built.yaml")
    assert "robot: ../robot.yaml" in path.read_text(encoding="utf-8")
    again = RobotModel.load(path)
    assert again == model
    assert again.definition.name == "two_joints"
    shift = again.mechanism().shared_model.jointPlacements[2].translation
    np.testing.assert_allclose(shift, [0.0, 1e-3, 0.0], atol=1e-15)


@pytest.mark.parametrize("more", ["layout: wide\n", "heat: {melt_degC: 1600}\n"])
def test_sections_of_the_pouring_robot_are_refused_for_another_robot(arm, more):
    path = arm.parent / "model.yaml"
    path.write_text(f"format: pouring_robot/model/1\nrobot: robot.yaml\n{more}", encoding="utf-8")
    with pytest.raises(DescriptionError, match="is for the pouring robot only"):
        RobotModel.load(path)


def test_offsets_of_another_robots_drives_are_in_their_unit(arm):
    path = arm.parent / "model.yaml"
    path.write_text(
        "format: pouring_robot/model/1\nrobot: robot.yaml\ndrive_offsets: {reach: {offset_mrad: 1}}\n", encoding="utf-8"
    )
    with pytest.raises(PouringRobotError, match="'reach' needs offset_mm"):
        RobotModel.load(path)


@pytest.mark.parametrize("name", ["arm", "delta", "five_bar", "hexapod"])
def test_an_exported_robot_can_be_loaded_again(name, tmp_path):
    """The exported folder is self-contained: URDF as built, robot file, no reference to the first folder."""
    from pouring_robot.robot.description.urdf import write_urdf
    from pouring_robot.robot.export.tree_at_closed_pose import ClosedRobot

    model = RobotModel.for_robot(ROBOTS / name / "robot.yaml")
    write_urdf(ClosedRobot.of(model).urdf, tmp_path / "out", model.definition.files_beside())
    shutil.move(tmp_path / "out", tmp_path / "elsewhere")
    again = RobotDefinition.load(tmp_path / "elsewhere" / "robot.yaml")
    assert again.loops.loops == model.definition.loops.loops
    assert again.drives == model.definition.drives
    assert again.mechanism().shared_model.nq == model.mechanism().shared_model.nq


def test_an_exported_robot_has_its_own_tolerances(arm):
    (arm.parent / "shop").mkdir()
    shutil.copy(ROOT / "examples" / "machines" / "hangprinter" / "tolerances.yaml", arm.parent / "shop" / "own.yaml")
    arm.write_text(FILE + "tolerances: shop/own.yaml\n", encoding="utf-8")
    beside = RobotDefinition.load(arm).files_beside()
    for name, content in beside.items():
        (arm.parent / "shop" / name).write_bytes(content)
    (arm.parent / "shop" / "own.yaml").unlink()
    shutil.copy(arm.parent / "arm.urdf", arm.parent / "shop" / "two_joints.urdf")
    again = RobotDefinition.load(arm.parent / "shop" / "robot.yaml")
    assert Tolerances.of(again).kinds.joint_centre.std == 50.0  # mm; the shipped file has 1


def test_load_robot_says_how_another_robot_is_loaded():
    from pouring_robot import load_robot

    with pytest.raises(BadInputError, match=r"load it with Robot\.load"):
        load_robot(ROBOTS / "delta" / "robot.yaml")


def test_joints_may_be_of_another_kind_than_in_the_urdf(arm):
    arm.write_text(FILE + "joint_types: {mount: universal_xz}\nlocked_joints: [mount_X]\n", encoding="utf-8")
    definition = RobotDefinition.load(arm)
    assert {"mount_X", "mount_Z"} <= set(definition.mechanism().joint_columns)
    assert definition.mechanism().passive_columns.size == 1
    errors = {name: displacement(rotation_rad=(0.01, 0.0, 0.0)) for name in ("mount_X", "mount_Z")}
    assert perturb_urdf(definition.urdf(), errors) != definition.urdf()  # they can be displaced like others
    assert b"joint_types" not in definition.files_beside()["robot.yaml"]  # the exported URDF has them
    for kinds, says in (("{mount: ball}", "universal_xy"), ("{mounts: fixed}", "did you mean 'mount'")):
        arm.write_text(FILE + f"joint_types: {kinds}\n", encoding="utf-8")
        with pytest.raises(DescriptionError, match=says):
            RobotDefinition.load(arm)


def test_ball_joints_stay_in_the_robot_file(arm):
    arm.write_text(FILE + "joint_types: {mount: spherical}\n", encoding="utf-8")
    definition = RobotDefinition.load(arm)
    assert len(definition.mechanism().joint_columns["mount"]) == 3
    assert b"mount: spherical" in definition.files_beside()["robot.yaml"]


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("joint: reach, mm_per_turn: 10.0", "joint: shoulder", "the same joint"),
        ("column: turn", "column: rx", "cannot be 'rx'.*such as column: rx_drive"),
        ("drives:", "locked_joints: [reach]\ndrives:", "'reach' is a drive"),
        ("drives:", "travel: [reach]\ndrives:", "'reach' is a drive"),
    ],
)
def test_impossible_drives_are_refused(arm, old, new, says):
    arm.write_text(FILE.replace(old, new), encoding="utf-8")
    with pytest.raises(DescriptionError, match=says):
        RobotDefinition.load(arm)


@pytest.mark.parametrize(
    ("home", "says"),
    [("", "its home (all joints at zero, as the file gives none): "), ("home: {shoulder: 1.0}", "its home: ")],
)
def test_a_home_outside_the_robots_reach_is_named(arm, home, says):
    (arm.parent / "arm.urdf").write_text(ARM.replace('lower="0"', 'lower="0.2"'), encoding="utf-8")
    arm.write_text(FILE + home, encoding="utf-8")
    with pytest.raises(NoSolutionError) as error:
        Robot.load(arm).location_in_the_middle()
    why = "the pose is out of reach: joint 'reach' would stand at 0.00 mm, 200.00 mm beyond its limits"
    assert f"robot.yaml: the robot cannot stand at {says}{why}" in str(error.value)
    assert "; write under home: the values" in str(error.value)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('lower="0" upper="1"', 'lower="1" upper="0"', "joint 'reach': limits 1 to 0 (m, rad); exchange them"),
        (
            'lower="0"',
            'lower="o"',
            "joint 'reach': could not convert string to float: 'o'; axes, limits and masses are",
        ),
        ('<link name="tip"/>', TIP.format("nan"), "link 'tip': a mass of nan kg"),
        ('<axis xyz="0 0 1"/>', '<axis xyz="0 0 0"/>', "has no direction"),
        ('"carriage" type="fixed">', '"carriage" type="planar"><axis xyz="1 0 0"/>', "its plane must be normal to z"),
        ('<link name="tip"/>', TIP.format("-2"), "link 'tip': a mass of -2 kg"),
        ('<link name="tip"/>', TIP.format("two"), "axes, limits and masses are numbers"),
        ('<link name="tip"/>', FAR.format("0 -64.5 0"), "link 'tip': a centre of mass 64.5 m from its frame"),
        ('<link name="tip"/>', FAR.format("0 x 0"), "link tip: origin xyz='0 x 0' is not three numbers"),
        ('<link name="tip"/>', FAR.format("nan 0 0"), "link 'tip': a centre of mass nan m from its frame"),
    ],
)
def test_errors_that_urdf_readers_accept_silently_are_refused(arm, old, new, says):
    assert old in ARM
    arm.with_name("arm.urdf").write_text(ARM.replace(old, new), encoding="utf-8")
    with pytest.raises(DescriptionError, match=re.escape(says)):
        RobotDefinition.load(arm)


def test_a_centre_of_mass_may_be_as_far_as_thirty_lengths_of_the_robot(arm):
    """A metre, the slide's travel and a tenth for the tip."""
    arm.with_name("arm.urdf").write_text(ARM.replace('<link name="tip"/>', FAR.format("0 62.5 0")), encoding="utf-8")
    assert RobotDefinition.load(arm).name == "two_joints"


@pytest.mark.parametrize("before", ["\n ", "\ufeff", "\ufeff\r\n"])
def test_blank_lines_may_stand_before_a_urdf(arm, before):
    text = '<?xml version="1.0"?>\n' + ARM
    arm.with_name("arm.urdf").write_text(before + text, encoding="utf-8")
    assert RobotDefinition.load(arm).urdf() == text
    assert "urdf: arm.urdf" in first_robot_file(arm.with_name("arm.urdf"), arm.parent)


def test_missing_limits_of_a_urdf_do_not_restrict(arm):
    arm.with_name("arm.urdf").write_text(ARM.replace('lower="0" upper="1" ', ""), encoding="utf-8")
    definition = RobotDefinition.load(arm)
    assert "reach" not in definition.mechanism().joint_limits()
    drives, _ = definition.workspace(definition.drawing())
    turned, slid = np.ptp(drives, axis=0)
    assert turned > 1.0
    assert slid == 0.0  # its range is unknown
    start = definition.drawing().starts(np.vstack([drives[0], [np.nan, 0.0]]))
    assert definition.drawing().in_reach(start).tolist() == [True, False]  # without limits, and without a pose


@pytest.mark.parametrize(
    ("said", "words"),
    [
        ("payload_frame: tipp", "payload_frame 'tipp' is not a link of the robot; did you mean 'tip'"),
        (
            "payload_frame: arm",
            "payload_frame 'arm' moves relative to end_frame 'tip'; name a link that is fixed to it",
        ),
        ("home: {reach: 9.0}", "home: 'reach' at 9 is beyond its limits"),
    ],
)
def test_entries_that_the_urdf_contradicts_are_refused(tmp_path, said, words):
    (tmp_path / "r.urdf").write_text(ARM, encoding="utf-8")
    text = f"format: pouring_robot/robot/1\nname: r\nurdf: r.urdf\nbase_frame: base\nend_frame: tip\n{said}\n"
    (tmp_path / "robot.yaml").write_text(text + "drives: [{joint: shoulder}, {joint: reach}]\n", encoding="utf-8")
    with pytest.raises(DescriptionError, match=re.escape(words)):
        RobotDefinition.load(tmp_path / "robot.yaml")


def test_redundant_drives_agree_all_over_the_workspace():
    """Four lines hold a point: where they agree the loops close, and elsewhere they are open by metres."""
    robot = RobotDefinition.load("examples/machines/hangprinter/robot.yaml")
    drawing = robot.drawing()
    drives, start = robot.workspace(drawing, 24)
    assert len(drives) > 12
    assert np.abs(engine_for(drawing.mechanism).close(drives, start).residual).max() < 1e-9
    lower, upper = np.transpose([(axis.lower, axis.upper) for axis in robot.command_axes(drawing.mechanism)])
    assert ((lower <= drives) & (drives <= upper)).all()


def test_lines_that_agree_have_the_distance_to_their_anchors():
    """Along an axis of its anchor a line cannot turn further: there lines agree although loops stay open."""
    robot = RobotDefinition.load("examples/machines/hangprinter/robot.yaml")
    drives, start = robot.workspace(robot.drawing(), 90)
    anchors = np.array([[0, -1.5939, -0.1], [1.5521, 0.8961, -0.1], [-1.3677, 0.7897, -0.1], [0, 0, 2.355]])
    assert len(drives) > 60
    np.testing.assert_allclose(np.linalg.norm(start.position[:, None] - anchors, axis=2), drives, atol=1e-9)
