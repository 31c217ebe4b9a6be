"""``pouring-robot robot init`` and ``robots --robot``: from a user's URDF to a robot file that loads."""

import io
import itertools
import json
import shutil
from pathlib import Path

import pandas
import pytest

from pouring_robot.robot.description.definition import RobotDefinition
from pouring_robot.robot.description.robot_file import RobotFile
from tests.effects.plugins import installed
from tests.effects.test_bearings import URDF as MAST
from tests.robot.test_definition import ARM, FILE, ROBOTS
from tests.support import ROOT


@pytest.fixture
def urdf(tmp_path):
    path = tmp_path / "my robot.urdf"
    path.write_text(ARM, encoding="utf-8")
    return path


def test_a_first_file_loads_and_says_what_it_took(run, urdf):
    code, out, err = run("robot", "init", urdf)
    assert (code, err) == (0, "")
    path = urdf.parent / "robot.yaml"
    definition = RobotDefinition.load(path)
    assert (definition.loops.base_frame, definition.loops.end_frame) == ("base", "tip")
    assert [drive.joint for drive in definition.drives] == ["shoulder", "reach"]
    assert "shoulder (angle), reach (length)" in out
    assert definition.loops.locked_joints == ()
    code, out, _ = run("robots", "--robot", path, "--json")
    (figures,) = json.loads(out)
    assert (code, figures["freedoms"], figures["loops"]) == (0, 2, [])


@pytest.mark.parametrize(("kg", "told"), [(None, "no masses"), (0.6, "1 bodies, 0.60 kg"), (28.6, "1 bodies, 29 kg")])
def test_a_urdf_without_masses_is_told_from_a_light_robot(run, tmp_path, kg, told):
    inertia = '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
    link = f'<link name="l"><inertial><mass value="{kg}"/>{inertia}</inertial></link>' if kg else '<link name="l"/>'
    joint = '<joint name="j" type="continuous"><parent link="b"/><child link="l"/><axis xyz="0 0 1"/></joint>'
    (tmp_path / "r.urdf").write_text(f'<robot name="r"><link name="b"/>{joint}{link}</robot>', encoding="utf-8")
    assert run("robot", "init", tmp_path / "r.urdf")[0] == 0
    assert run("robots", "--robot", tmp_path / "robot.yaml")[1].startswith(f"r: r, {told}\n")


def test_nothing_is_overwritten_unless_asked(run, urdf):
    assert run("robot", "init", urdf)[0] == 0
    path = urdf.parent / "robot.yaml"
    path.write_text("mine", encoding="utf-8")
    code, _, err = run("robot", "init", urdf)
    assert code == 2
    assert "--overwrite" in err
    assert path.read_text(encoding="utf-8") == "mine"
    assert run("robot", "init", urdf, "--overwrite")[0] == 0


def test_what_a_xacro_asks_for_is_given_and_stays_in_the_file(run, tmp_path):
    asks = '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="arm$(arg size)">'
    path = tmp_path / "arm.xacro"
    path.write_text(ARM.replace('<robot name="two_joints">', asks), encoding="utf-8")
    code, out, err = run("robot", "init", path)
    assert (code, out) == (2, "")
    assert err.count("\n") == 1 and "mappings: {size: …}" in err and "--mapping size=…" in err
    assert run("robot", "init", path, "--mapping", "size=6", "--mapping", "on=true")[0] == 0
    definition = RobotDefinition.load(tmp_path / "robot.yaml")
    assert (definition.name, definition.file.mappings) == ("arm6", {"size": "6", "on": "true"})


@pytest.mark.parametrize(("given", "says"), [("size", "write NAME=VALUE"), ("size=6", "leave out the mappings")])
def test_mappings_that_are_none_or_of_no_xacro_are_refused(run, urdf, given, says):
    code, _, err = run("robot", "init", urdf, "--mapping", given)
    assert code == 2 and err.count("\n") == 1 and says in err
    assert not (urdf.parent / "robot.yaml").exists()


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("<robot name='r'><link name='a'/></robot>", "not a URDF with joints"),
        ("<robot", "line 1"),
        (ARM.replace('type="continuous"', 'type="fixed"').replace('type="prismatic"', 'type="fixed"'), "no joint"),
    ],
)
def test_what_is_no_robot_is_refused_on_one_line(run, tmp_path, content, says):
    path = tmp_path / "r.urdf"
    path.write_text(content, encoding="utf-8")
    code, _, err = run("robot", "init", path)
    assert code == 2
    assert says in err
    assert err.count("\n") == 1
    assert not (tmp_path / "robot.yaml").exists()


@pytest.mark.parametrize(("name", "freedoms"), [("arm", 6), ("delta", 3), ("five_bar", 2), ("hexapod", 6)])
def test_example_robots_are_listed(run, name, freedoms):
    code, out, _ = run("robots", "--robot", ROBOTS / name / "robot.yaml")
    assert code == 0
    assert f"{freedoms} freedoms" in out


def test_drives_that_do_not_determine_the_pose_are_told(run, tmp_path):
    """The five-bar with one of its two cranks let go of."""
    shutil.copytree(ROBOTS / "five_bar", tmp_path / "five_bar")
    shutil.copy(ROBOTS / "shapes.xacro", tmp_path)
    path = tmp_path / "five_bar" / "robot.yaml"
    text = path.read_text(encoding="utf-8")
    one = text.replace("  - {joint: right_drive, column: right}\n", "").replace(", right_drive]", "]")
    path.write_text(one, encoding="utf-8")
    code, out, _ = run("robots", "--robot", path)
    assert code == 0
    assert "  the drives do not determine the pose: list every driven joint" in out
    assert "do not determine" not in run("robots", "--robot", ROBOTS / "five_bar" / "robot.yaml")[1]


def test_one_robot_at_a_time(run, tmp_path):
    shutil.copytree(ROBOTS / "arm", tmp_path / "arm")
    code, _, err = run("robots", "--robot", ROBOTS / "arm" / "robot.yaml", "--layout", "wide")
    assert code == 2
    assert "--robot or --layout, not both" in err


def test_every_line_of_a_first_file_is_known_to_the_reader(run, urdf):
    run("robot", "init", urdf)
    assert RobotFile.load(urdf.parent / "robot.yaml").loops == ()


def test_a_joint_with_the_name_of_a_measured_column_gets_a_column_of_its_own(run, urdf):
    urdf.write_text(ARM.replace('"reach"', '"z"').replace('"shoulder"', '"z_drive"'), encoding="utf-8")
    code, out, err = run("robot", "init", urdf)
    assert (code, err) == (0, "")
    assert "z_drive (angle), z_drive_ (length)" in out


def test_a_slide_that_cannot_stand_at_zero_starts_in_the_middle_of_its_range(run, tmp_path, urdf):
    limit = '<limit lower="0" upper="1"'
    assert ARM.count(limit) == 1
    urdf.write_text(ARM.replace(limit, limit.replace('"0"', '"0.25"')), encoding="utf-8")
    run("robot", "init", urdf)
    assert RobotFile.load(tmp_path / "robot.yaml").home == {"reach": 0.625}
    assert run("robots", "--robot", tmp_path / "robot.yaml")[0] == 0


def test_a_new_robot_that_nobody_describes_says_how_to_go_on(run, monkeypatch):
    for nobody in (io.StringIO(""), None):  # closed
        monkeypatch.setattr("sys.stdin", nobody)
        code, _, err = run("robot", "new")
        assert (code, err) == (2, "pouring-robot: there is no terminal to answer questions; use --yes\n")


def test_rows_of_drives_are_located_in_their_units(run, tmp_path):
    """The arm with its wrist bent by 90 degrees: 150 + 310 + 310 mm in front, 450 + 600 + 120 - 100 mm high."""
    (tmp_path / "c.csv").write_text("q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg\n0,0,0,0,90,0\n90,0,0,0,90,0\n")
    code, out, _ = run("path", "c.csv", "--robot", ROBOTS / "arm" / "robot.yaml", "--json")
    first, second = json.loads(out)["poses"]
    assert code == 0
    assert first["frames"]["flange"]["nominal_mm"] == pytest.approx([770.0, 0.0, 1070.0], abs=1e-9)
    assert second["frames"]["flange"]["nominal_mm"] == pytest.approx([0.0, 770.0, 1070.0], abs=1e-9)
    assert first["frames"]["flange"]["error"]["distance_mm"] == 0.0


def test_a_pose_says_the_attitude_as_it_is_typed(run):
    """An arm that is sent to a place and an attitude stands so, in the table and in JSON."""
    at = (
        "pose",
        "--robot",
        ROBOTS / "arm" / "robot.yaml",
        "--at-mm",
        "500",
        "100",
        "700",
        "--rotation-deg",
        "0",
        "120",
        "0",
    )
    code, out, _ = run(*at)
    assert code == 0
    assert "mm, deg; errors: mm, mrad" in out
    assert next(line for line in out.splitlines() if " nominal " in line).split()[2:] == [
        *("500.000", "100.000", "700.000"),
        *("0.000", "120.000", "0.000"),
    ]
    frame = json.loads(run(*at, "--json")[1])["frames"]["flange"]
    assert frame["nominal_rotation_deg"] == pytest.approx([0.0, 120.0, 0.0], abs=1e-6)
    assert frame["actual_rotation_deg"] == pytest.approx([0.0, 120.0, 0.0], abs=1e-6)


def test_of_a_drive_with_a_gear_the_column_holds_the_motor(run, tmp_path, urdf):
    robot = tmp_path / "robot.yaml"
    robot.write_text(FILE.replace("arm.urdf", urdf.name), encoding="utf-8")
    _, out, _ = run("robots", "--robot", robot)
    assert "drive shoulder: any … any deg; turn_deg in campaigns, the angle of its motor" in out
    assert "drive reach: 0 … 1000 mm; reach_deg in campaigns, the angle of its motor" in out
    from_elsewhere = FILE.replace("arm.urdf", urdf.name).replace("mm_per_turn: 10.0", "zero: 0.2")
    robot.write_text(from_elsewhere, encoding="utf-8")
    _, shifted, _ = run("robots", "--robot", robot)
    assert "drive reach: 0 … 1000 mm; reach_mm in campaigns, its command" in shifted
    robot.write_text(FILE.replace("arm.urdf", urdf.name), encoding="utf-8")
    (tmp_path / "series.csv").write_text("turn_deg,reach_mm,x_mm,y_mm,z_mm\n1,2,3,4,5\n", encoding="utf-8")
    code, _, err = run("campaign", "check", "series.csv", "--robot", robot)
    assert code == 2
    assert "'mm' is not a unit of the angle of the motor, which this column holds for the slide; write reach_rad" in err


def test_drives_that_move_nothing_between_base_and_end_body_are_said_to(run, tmp_path):
    """A nut leads a quill, a wrist turns beyond what is measured, and a table is moved under all of it."""
    joint = """<joint name="{}" type="{}"><parent link="{}"/><child link="{}"/><axis xyz="0 0 1"/>
        <limit lower="-1" upper="1" effort="1" velocity="1"/>{}</joint>"""
    joints = [
        joint.format("table", "prismatic", "bed", "bench", ""),
        joint.format("nut", "revolute", "bed", "ring", ""),
        joint.format("quill", "prismatic", "bed", "tip", '<mimic joint="nut" multiplier="0.01"/>'),
        joint.format("wrist", "revolute", "tip", "hand", ""),
    ]
    links = "".join(f'<link name="{name}"/>' for name in ("bed", "bench", "ring", "tip", "hand"))
    (tmp_path / "mill.urdf").write_text(f'<robot name="mill">{links}{"".join(joints)}</robot>', encoding="utf-8")
    drives = "drives: [{joint: table}, {joint: nut}, {joint: wrist}]"
    file = f"format: pouring_robot/robot/1\nname: mill\nurdf: mill.urdf\nbase_frame: bench\nend_frame: tip\n{drives}\n"
    (tmp_path / "robot.yaml").write_text(file, encoding="utf-8")
    model = "format: pouring_robot/model/1\nrobot: robot.yaml\njoint_placements: {table: {rotation_mrad: [1, 0, 0]}}\n"
    (tmp_path / "model.yaml").write_text(model, encoding="utf-8")
    _, out, _ = run("robots", "--model", tmp_path / "model.yaml")
    assert [line for line in out.splitlines() if "moves nothing" in line] == [
        "  drive wrist: -57.2958 … 57.2958 deg; moves nothing between base and end body"
    ]
    assert "1.000 mrad off" in run("pose", "--model", tmp_path / "model.yaml", "--drives", "0 0 0")[1]


def test_a_missing_drive_value_is_named(run, tmp_path):
    (tmp_path / "c.csv").write_text("q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg\n0,0,0,,90,0\n")
    code, _, err = run("path", "c.csv", "--robot", ROBOTS / "arm" / "robot.yaml")
    assert code == 2
    assert "line 2, column q4_deg: the value is missing" in err


def test_a_robot_of_its_own_is_exported_and_loads_again(run, tmp_path):
    assert run("export", "--robot", ROBOTS / "delta" / "robot.yaml", "--out", "out")[0] == 0
    code, out, _ = run("robots", "--robot", tmp_path / "out" / "robot.yaml")
    assert code == 0
    assert "3 freedoms" in out


def test_forms_that_are_values_of_one_constant_stand_on_one_line(run):
    _, out, _ = run("effects")
    printed = " ".join(out.split())
    assert printed.count("pressed_from") == 2
    assert "form pressed_from_0.316 to pressed_from_3.16 (41 values of one friction): l1_play [mm]" in printed


def test_effects_are_those_of_the_robot(run):
    code, out, _ = run("effects", "--robot", ROBOTS / "arm" / "robot.yaml")
    assert code == 0
    assert "joint_periodic" in out
    assert "truss_deflection" not in out
    needs = {line.partition(":")[0]: after for line, after in itertools.pairwise(out.splitlines())}
    assert needs["link_thermal_expansion"] == "  needs: ambient_degC, or <link>_degC of any link"
    assert needs["session_offset"] == "  needs: session"
    yielding = {line for effect, line in needs.items() if effect in ("drive_compliance", "joint_compliance")}
    assert yielding == {"  needs: inertias of the links in the URDF"}


WARM = """
from pouring_robot.effects import Effect, EffectParameter, Form


class Lean(Effect):
    id = "lean"
    story = "the turret leans as it warms"
    needs = ("turret_rise_k",)

    def forms(self, conditions):
        change = {"joint2.rx": 1e-3 * conditions.value("turret_rise_k")}
        return (Form("only", (EffectParameter("lean", "mrad/K", 0.02, change),)),)
"""


def test_effects_of_packages_may_need_any_thermometer(run, tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(installed(tmp_path / "leaning", "leaning", WARM, {"lean": "leaning:Lean"})))
    code, out, err = run("effects", "--robot", ROBOTS / "arm" / "robot.yaml")
    assert (code, err) == (0, "")
    assert "lean: the turret leans as it warms\n  needs: turret_degC\n  form only: lean [mrad/K]" in out


@pytest.mark.parametrize("name", ["turn: left #2", "007", "No", "null", "a/b, c", 'say "x"', "[1]", "1e3"])
def test_names_that_yaml_takes_for_something_else_stay_names(run, tmp_path, name):
    path = tmp_path / "r.urdf"
    quoted = name.replace('"', "&quot;")
    path.write_text(ARM.replace('"shoulder"', f'"{quoted}"').replace('"tip"', f'"{quoted}"'), encoding="utf-8")
    code, _, err = run("robot", "init", path)
    assert (code, err) == (0, "")
    file = RobotFile.load(tmp_path / "robot.yaml")
    assert (file.drives[0].joint, file.end_frame, file.payload_frame) == (name, name, name)


def test_what_pinocchio_cannot_build_leaves_no_file(run, tmp_path):
    path = tmp_path / "r.urdf"
    path.write_text(ARM.replace('parent link="slide"', 'parent link="gone"'), encoding="utf-8")
    code, _, err = run("robot", "init", path)
    assert code == 2
    assert "r.urdf: Pinocchio cannot build it" in err
    assert err.count("\n") == 1
    assert not (tmp_path / "robot.yaml").exists()


def test_a_mesh_that_may_not_be_read_leaves_no_file(run, tmp_path):
    path = tmp_path / "r.urdf"
    visual = f'<visual><geometry><mesh filename="{__file__}"/></geometry></visual>'  # it is there, and not a mesh
    path.write_text(ARM.replace('<link name="base"/>', f'<link name="base">{visual}</link>'), encoding="utf-8")
    code, _, err = run("robot", "init", path)
    assert code == 2
    assert f"{Path(__file__).name}: lies outside the folder" in err
    assert err.count("\n") == 1
    assert not (tmp_path / "robot.yaml").exists()


@pytest.mark.parametrize("declaration", ["", '<?xml version="1.0"?>\n'])
def test_a_urdf_in_place_of_a_robot_file_says_how_to_make_one(run, tmp_path, declaration):
    path = tmp_path / "arm.urdf"
    path.write_text(declaration + ARM, encoding="utf-8")
    mend = f"{path}: is a URDF, not YAML; 'pouring-robot robot init {path}' makes a robot file of it"
    for option in ("--robot", "--model"):
        assert run("pose", option, path, "--drives", "1") == (2, "", f"pouring-robot: {mend}\n")


def test_what_file_is_wanted_is_said_of_any_other(run, tmp_path):
    (tmp_path / "m.csv").write_text("x_mm,y_mm\n1,2\n", encoding="utf-8")
    (tmp_path / "m.yaml").write_text("robot: robot.yaml\ndrive_offsets: {}\n", encoding="utf-8")
    (tmp_path / "c.yaml").write_text("robot: robot.yaml\nmetrology: {sigma_position_mm: 0.03}\n", encoding="utf-8")
    for arguments, says in (
        (("pose", "--model", "c.yaml"), "unknown key 'metrology'; the file must be of format: pouring_robot/model/1"),
        (("pose", "--robot", "m.csv"), "at its top level; give a robot file, robot.yaml"),
        (("pose", "--model", "m.csv"), "at its top level; give a model file, YAML"),
        (("pose", "--robot", "m.yaml"), " more); the file must be of format: pouring_robot/robot/1"),
        (("robot", "init", "m.csv"), "not found, line 1, column 1; give a URDF or a xacro"),
    ):
        code, out, err = run(*arguments, *(["--at-mm", "0", "0", "0"] if arguments[0] == "pose" else []))
        assert (code, out) == (2, "") and err.endswith(f"{says}\n")


def test_a_campaign_of_another_robot_says_whose_it_is(run, tmp_path):
    series = ROOT / "examples" / "machines" / "ur10" / "series_c.csv"
    code, _, err = run("campaign", "check", series)
    assert code == 2
    assert "is a campaign of the robot 'ur10', but was read as one of 'pouring_robot'; give its robot file" in err
    assert "(--robot; in Python the argument robot, its path)" in err
    assert err.count("\n") == 1


def test_of_positions_alone_it_is_not_told_three_times_how_the_target_is_turned(run, tmp_path):
    robot = ROBOTS / "arm" / "robot.yaml"
    at = ("--random", "25", "--seed", "1", "--robot", robot, "--position-only", "--out", "places.csv")
    assert run("campaign", "simulate", *at)[0] == 0
    lines = run("campaign", "check", "places.csv", "--robot", robot)[1].splitlines()
    (told,) = (line for line in lines if " determine " in line)
    assert told == "positions alone do not determine the orientation of the target on the tool, and need not"


def test_what_is_not_told_of_the_frames_is_said_in_one_sentence(run):
    delta = ROBOTS / "delta" / "robot.yaml"
    assert run("campaign", "simulate", "--random", "20", "--seed", "1", "--robot", delta, "--out", "poses.csv")[0] == 0
    said = " ".join(run("campaign", "check", "poses.csv", "--robot", delta)[1].split())
    told = (
        "not determined by these poses, and not needed for them: 1 tool.tx -1 base.tx; 1 tool.ty -1 base.ty; 1 tool.tz"
    )
    assert told in said


def test_a_table_of_drives_and_places_is_no_table_of_commands(run):
    """Measured places are a tracker's; they were commanded where they could be reached, and the drives left out."""
    delta = ROBOTS / "delta" / "robot.yaml"
    assert run("campaign", "simulate", "--random", "20", "--seed", "1", "--robot", delta, "--out", "poses.csv")[0] == 0
    code, out, err = run("path", "poses.csv", "--robot", delta)
    assert (code, out) == (2, "") and "keep the columns of one kind" in err


def test_any_robot_is_posed_and_compensated(run, tmp_path):
    """A delta whose first arm is off by 1 mrad: sent to a place, drawn, and corrected there."""
    robot = ROBOTS / "delta" / "robot.yaml"
    (tmp_path / "built.yaml").write_text(
        f"format: pouring_robot/model/1\nrobot: {robot}\ndrive_offsets: {{arm1_drive: {{offset_mrad: 1.0}}}}\n"
    )
    at = ("--at-mm", "50", "20", "-600")
    code, out, err = run("pose", "--model", "built.yaml", *at, "--json", "--png", "delta.png")
    figures = json.loads(out)
    assert (code, err) == (0, "")
    frames = figures["frames"]
    end, *_, tip = frames
    assert frames[end]["nominal_mm"] == pytest.approx([50.0, 20.0, -600.0], abs=1e-6)
    assert 0.05 < frames[tip]["error"]["distance_mm"] < 1.0
    assert (tmp_path / "delta.png").stat().st_size > 10_000
    code, out, _ = run("compensate", "--model", "built.yaml", *at, "--json")
    (row,) = json.loads(out)["poses"]
    assert row["drives"]["arm1_drive_deg"] == pytest.approx(row["wanted"]["arm1_drive_deg"] - 0.0572958, abs=1e-6)
    assert row["left"]["distance_mm"] < 1e-6
    (tmp_path / "poses.csv").write_text("x_mm,y_mm,z_mm\n50,20,-600\n0,0,-700\n")
    code, out, _ = run("compensate", "poses.csv", "--model", "built.yaml", "--out", "commands.csv")
    before = pandas.read_csv(tmp_path / "commands.csv").error_before_mm.max()
    assert code == 0 and out.startswith(f"largest: 'grip' {before:.3f} mm and 0.000 mrad off without")


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("pose", "--drives", "1 2"), "give one number for each of q1 (deg)".replace("q1", "joint1")),
        (("pose", "--at-mm", "500", "0", "700"), "determines 3 of 6 freedoms"),
        (("pose", "--drives", "0 0 0 0 0 0", "--tilt-deg", "3"), "belong to --at-mm"),
        (("pose",), "--at-mm or drive values by --drives"),
        (("pose", "--drives", "0 0 0 0 60 0", "--steady"), "pouring robot's melt"),
        (("thermal", "--at-mm", "0", "0", "0"), "pouring robot's melt"),
    ],
)
def test_what_an_arm_cannot_be_asked_is_refused_on_one_line(run, arguments, says):
    code, _, err = run(*arguments, "--robot", ROBOTS / "arm" / "robot.yaml")
    assert code == 2
    assert says in err
    assert err.count("\n") == 1


# Two fingers whose tips stand together in the zero pose, their axes a quarter turn apart.
FINGERS = """<robot name="fingers"><link name="base"/><link name="left"/><link name="right"/><link name="left_tip"/>
  <link name="right_tip"/>
  <joint name="a" type="continuous">
    <parent link="base"/><child link="left"/><origin xyz="-1 0 0"/><axis xyz="0 0 1"/></joint>
  <joint name="b" type="continuous">
    <parent link="base"/><child link="right"/><origin xyz="1 0 0"/><axis xyz="0 0 1"/></joint>
  <joint name="at" type="fixed"><parent link="left"/><child link="left_tip"/><origin xyz="1 0 0"/></joint>
  <joint name="bt" type="fixed">
    <parent link="right"/><child link="right_tip"/><origin xyz="-1 0 0" rpy="0 0 1.5"/></joint>
</robot>"""


def test_loops_are_proposed_where_branches_meet(run, tmp_path):
    (tmp_path / "f.urdf").write_text(FINGERS, encoding="utf-8")
    assert run("robot", "init", "f.urdf")[0] == 0
    text = (tmp_path / "robot.yaml").read_text(encoding="utf-8")
    assert "#     - {name: loop_1, frame_a: left_tip, frame_b: right_tip, type: 3d}" in text


def posed_mast(run, tmp_path, more, locked):
    """Return what is printed of a pose of the mast with more links, of which a first file locks a joint."""
    (tmp_path / "mast.urdf").write_text(MAST.replace("</robot>", f"{more}</robot>"), encoding="utf-8")
    code, out, err = run("robot", "init", "mast.urdf")
    assert (code, err) == (0, "")
    assert "ground to tool0, 2 drives: lift (length), pan (angle)" in " ".join(out.split())
    assert f"locked_joints: [{locked}]" in (tmp_path / "robot.yaml").read_text(encoding="utf-8")
    code, out, err = run("pose", "--robot", "robot.yaml", "--drives", "1000 90")
    assert (code, err) == (0, "")
    return out


def test_what_follows_a_joint_is_driven_by_that_one(run, tmp_path):
    """A mast whose slides follow a joint of a branch of its own; and fingers, locked, that cannot close wholly."""
    finger = '<link name="{n}"/><joint name="{n}_slide" type="prismatic"><parent link="arm"/><child link="{n}"/>{says}'
    limits = '<axis xyz="0 1 0"/><limit lower="0.002" upper="0.05" effort="1" velocity="1"/></joint>'
    follows = '<mimic joint="left_slide"/>'
    fingers = finger.format(n="left", says="") + limits + finger.format(n="right", says=follows) + limits
    out = posed_mast(run, tmp_path, fingers, locked="left_slide")
    height = next(line for line in out.splitlines() if "nominal" in line)
    assert "800.000" in height  # half of the lift and 0.2 m, 0.1 m up to the tool
    moved = (
        "format: pouring_robot/model/1\nrobot: robot.yaml\njoint_placements: {left_slide: {rotation_mrad: [1, 0, 0]}}\n"
    )
    (tmp_path / "model.yaml").write_text(moved, encoding="utf-8")
    code, out, err = run("pose", "--model", "model.yaml", "--drives", "1000 90")
    assert (code, err) == (0, "")
    assert "displacing 'left_slide' moves nothing between base and end body" in " ".join(out.split())


# A telescope: each stage follows the one below it, and no joint but the first leads.
TELESCOPE = """<robot name="telescope"><link name="foot"/><link name="a"/><link name="b"/><link name="tool0"/>
  <joint name="j1" type="prismatic"><parent link="foot"/><child link="a"/><axis xyz="0 0 1"/>
    <limit lower="0" upper="1" effort="1" velocity="1"/></joint>
  <joint name="j2" type="prismatic"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>
    <limit lower="0" upper="1" effort="1" velocity="1"/><mimic joint="j1" multiplier="0.5"/></joint>
  <joint name="j3" type="prismatic"><parent link="b"/><child link="tool0"/><axis xyz="0 0 1"/>
    <limit lower="0" upper="1" effort="1" velocity="1"/><mimic joint="j2" multiplier="0.5" offset="0.1"/></joint>
</robot>"""


def test_what_follows_a_follower_is_driven_by_the_one_that_leads(run, tmp_path):
    (tmp_path / "telescope.urdf").write_text(TELESCOPE, encoding="utf-8")
    code, out, err = run("robot", "init", "telescope.urdf")
    assert (code, err) == (0, "")
    assert "1 drives: j1 (length)" in out
    code, out, err = run("pose", "--robot", "robot.yaml", "--drives", "400")
    assert (code, err) == (0, "")
    assert "800.000" in next(line for line in out.splitlines() if "nominal" in line)  # 0.4, 0.2 and 0.1 + 0.1 m


@pytest.mark.parametrize(
    ("right", "wrong", "says"),
    [
        ('multiplier="0.5" offset', 'multiplier="much" offset', "joint 'j3': multiplier and offset of mimic must be"),
        ('<mimic joint="j1"', '<mimic joint="j3"', "joint 'j2' mimics itself by way of others"),
    ],
)
def test_a_first_file_of_mimics_that_make_no_sense_is_refused_with_the_urdf(run, tmp_path, right, wrong, says):
    (tmp_path / "telescope.urdf").write_text(TELESCOPE.replace(right, wrong), encoding="utf-8")
    code, _, err = run("robot", "init", "telescope.urdf")
    assert code == 2 and f"telescope.urdf: {says}" in err


@pytest.mark.parametrize("kind", ["floating", "planar"])
def test_poses_of_an_arm_that_floats_or_rolls_are_seen_from_what_carries_it(run, tmp_path, kind):
    under = f'<link name="hall"/><joint name="root" type="{kind}"><parent link="hall"/><child link="ground"/></joint>'
    posed_mast(run, tmp_path, under, locked="root")


def test_a_xacro_is_taken_as_one(run, tmp_path):
    shutil.copytree(ROBOTS / "arm", tmp_path / "arm")
    shutil.copy(ROBOTS / "shapes.xacro", tmp_path)
    code, _, err = run("robot", "init", tmp_path / "arm" / "arm.urdf.xacro", "--out", tmp_path / "arm" / "first.yaml")
    assert (code, err) == (0, "")
    found = RobotDefinition.load(tmp_path / "arm" / "first.yaml")
    assert found.file.xacro == "arm.urdf.xacro"
    assert len(found.drives) == 6


def test_what_a_gepetto_file_closes_is_taken_over(run, tmp_path):
    (tmp_path / "f.urdf").write_text(FINGERS, encoding="utf-8")
    said = "closed_loop: [[left_tip, right_tip]]\ntype: [3d]\nname_mot: [a]\n"
    (tmp_path / "robot.yaml").write_text(said, encoding="utf-8")
    code, out, err = run("robot", "init", "f.urdf")
    assert (code, err) == (0, "")
    assert "1 drives: a (angle)" in out
    found = RobotDefinition.load(tmp_path / "robot_file.yaml")
    assert [loop.type for loop in found.loops.loops] == ["3d"]
    assert (tmp_path / "robot.yaml").read_text(encoding="utf-8") == said


def test_joints_that_stay_locked_in_a_closed_robot_are_asked_about(run, tmp_path):
    shutil.copytree(ROBOTS, tmp_path / "robots")
    path = tmp_path / "robots" / "delta" / "robot.yaml"
    assert "strike" not in run("robots", "--robot", path)[1]
    path.write_text(path.read_text(encoding="utf-8") + "locked_joints: [arm2_elbow1]\n", encoding="utf-8")
    assert "more drives than freedoms: remove from locked_joints" in run("robots", "--robot", path)[1]


def test_of_a_gepetto_file_that_drives_what_follows_another_the_leader_is_driven(run, tmp_path):
    follows = FINGERS.replace(
        '<joint name="b" type="continuous">', '<joint name="b" type="continuous"><mimic joint="a"/>'
    )
    (tmp_path / "f.urdf").write_text(follows, encoding="utf-8")
    (tmp_path / "robot.yaml").write_text("closed_loop: [[left_tip, right_tip]]\ntype: [3d]\nname_mot: [b]\n")
    code, out, err = run("robot", "init", "f.urdf")
    assert (code, err) == (0, "")
    assert "1 drives: a (angle)" in out


def test_a_joint_that_follows_one_that_is_not_there_is_refused_with_the_nearest(run, tmp_path):
    follows = FINGERS.replace(
        '<joint name="b" type="continuous">', '<joint name="b" type="continuous"><mimic joint="at_"/>'
    )
    (tmp_path / "f.urdf").write_text(follows, encoding="utf-8")
    (tmp_path / "robot.yaml").write_text("closed_loop: [[left_tip, right_tip]]\ntype: [3d]\nname_mot: [a]\n")
    code, _, err = run("robot", "init", "f.urdf")
    assert code == 2 and "and there is no 'at_'; did you mean 'at'?" in err


def test_a_machine_of_ones_own_is_asked_for_checked_and_drawn(run, tmp_path, monkeypatch):
    """Answers from a keyboard; what cannot be is asked again at once; an empty line takes the default."""
    monkeypatch.setattr("sys.stdin", io.StringIO("my own\nown\n1000\n-5 900\n1000 900\n" + "\n" * 6))
    code, out, err = run("robot", "new", "--z-mm", -1200, -700, "--out", "mine")
    assert code == 0 and all(why in out + err for why in ("must be one word", "two numbers", "above zero"))
    assert "2401 of 2401 poses" in out
    assert (tmp_path / "mine" / "robot.html").stat().st_size > 1e6
    code, out, _ = run("robots", "--model", "mine/model.yaml", "--json")
    (figures,) = json.loads(out)
    assert (code, figures["layout"], figures["freedoms"]) == (0, "own", 4)
    assert figures["workspace"]["position_lower_mm"] == [-150.0, -50.0, -1200.0]
    code, _, err = run("robot", "new", "--yes", "--out", "mine")
    assert (code, "--overwrite" in err) == (2, True)


def test_a_machine_that_does_not_reach_its_middle_is_told_what_falls_short_and_leaves_nothing(run, tmp_path):
    code, out, err = run("robot", "new", "--out", "mine", "--yes", "--stroke-mm", 400, 500)
    assert (code, "in the middle of the workspace" in err) == (3, True)
    assert "leg3_s3 is beyond its limits in" in out and not (tmp_path / "mine").exists()


def test_drives_that_disagree_are_no_load(run):
    """Of belts that were 7 mm apart 700 kN were told, by a stiffness of joints that belts do not have."""
    lines = ROBOTS.parent / "machines" / "hangprinter" / "robot.yaml"
    code, out, _ = run("pose", "--robot", lines, "--drives", "1600 1795 1582.5 2355")
    assert code == 0
    assert "the open gap is the disagreement of redundant drives, not a load" in out
    assert " N and " not in out
