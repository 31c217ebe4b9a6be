"""A description from somebody else runs no code and reads no files outside its folders."""

import re

import pytest

from pouring_robot.exceptions import DescriptionError
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.loops_file import LoopsFile
from pouring_robot.mechanism.poses import bodies_at
from pouring_robot.robot.description.first_file import first_robot_file
from pouring_robot.robot.description.untrusted import FOLDERS_VARIABLE
from pouring_robot.robot.description.urdf import meshes_from, urdf_files
from pouring_robot.robot.description.xacro_to_urdf import run_xacro
from pouring_robot.robot.view.nominal_and_actual import drawn_robot

HEAD = '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">'
CODE = (
    "$(eval exec(&quot;open('MARK','w')&quot;))",
    "${().__class__}",
    "${[x.__class__.__base__.__subclasses__() for x in [1]]}",
    "${(lambda: ().__class__)()}",
    "${[g.gi_frame.f_back for g in [(i for i in [1])]]}",
    "${python.vars(python.type)['_' + '_subclasses_' + '_'](int)}",
    "${'%s'.format(1)}",
    "${__builtins__}",
    "$(env HOME)",
    "$(optenv HOME x)",
)
READS = (
    "<xacro:include filename='SECRET'/>",
    "<xacro:include filename='../../secret.xml'/>",
    "<xacro:include filename='../../secret.x?l'/>",
    "<xacro:include filename='SECRET' optional='true'/>",
    "<xacro:include filename='link.xml'/>",
    "<xacro:property name='a' value=\"${xacro.load_yaml('SECRET')}\"/><link name='${a}'/>",
)
SHAPES = ("visual", "collision")
ENDLESS = (
    "<xacro:include filename='r.xacro'/>",
    "<xacro:macro name='m'><xacro:m/><xacro:m/></xacro:macro><xacro:m/>",
    "<xacro:property name='a' value='${b}'/><xacro:property name='b' value='${a}'/><link name='${a}'/>",
)


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "secret.xml").write_text("<robot><link name='treasure'/></robot>", encoding="utf-8")
    inner = tmp_path / "shared" / "robot"
    inner.mkdir(parents=True)
    (inner / "link.xml").symlink_to(tmp_path / "secret.xml")
    return inner


def refused(folder, body):
    secret = folder.parents[1] / "secret.xml"
    path = folder / "r.xacro"
    text = body.replace("SECRET", str(secret)).replace("MARK", str(folder / "mark"))
    path.write_text(f"{HEAD}{text}</robot>", encoding="utf-8")
    with pytest.raises(DescriptionError) as error:
        run_xacro(path, {})
    assert "\n" not in str(error.value)
    assert "treasure" not in str(error.value)
    return str(error.value)


@pytest.mark.parametrize("expression", CODE)
def test_no_code_runs(folder, expression):
    assert "may not use" in refused(folder, f'<link name="{expression}"/>')
    assert not (folder / "mark").exists()


@pytest.mark.parametrize("body", READS)
def test_nothing_is_read_outside(folder, body):
    assert FOLDERS_VARIABLE in refused(folder, body)


@pytest.mark.parametrize("body", ENDLESS)
def test_endless_expressions_are_refused(folder, body):
    refused(folder, body)


def test_a_named_folder_and_a_sister_folder_are_read(folder, monkeypatch):
    sister = folder.parent / "sister"
    sister.mkdir()
    (sister / "part.xacro").write_text("<robot><link name='part'/></robot>", encoding="utf-8")
    secret = folder.parents[1] / "secret.xml"
    body = f"<xacro:include filename='{secret}'/><xacro:include filename='../sister/part.xacro'/>"
    body += "<xacro:property name='f_max' value='${[i * 2 for i in python.range(3)][-1]}'/><link name='l${f_max}'/>"
    (folder / "r.xacro").write_text(f"{HEAD}{body}</robot>", encoding="utf-8")
    monkeypatch.setenv(FOLDERS_VARIABLE, f":{folder.parents[1]}")
    text = run_xacro(folder / "r.xacro", {})
    assert all(name in text for name in ("treasure", "part", '"l4"'))


@pytest.mark.parametrize("place", ["above", "beside", "named", "holder"])
def test_packages_are_found_where_they_may_be_read(folder, monkeypatch, place):
    """As the package that holds the description, next to its folder, in the variable, or in a folder named there."""
    home = {"above": folder.parent, "beside": folder.parent / "parts"}.get(place, folder.parents[1] / "parts")
    if place in ("named", "holder"):
        monkeypatch.setenv(FOLDERS_VARIABLE, str(home if place == "named" else home.parent))
    (home / "urdf").mkdir(parents=True, exist_ok=True)
    (home / "urdf" / "part.xacro").write_text("<robot><link name='part'/></robot>", encoding="utf-8")
    (home / "part.stl").write_bytes(b"")
    body = f"<xacro:include filename='$(find {home.name})/urdf/part.xacro'/>"
    (folder / "r.xacro").write_text(f"{HEAD}{body}</robot>", encoding="utf-8")
    assert '"part"' in run_xacro(folder / "r.xacro", {})
    for file, address in (("part.stl", (home / "part.stl").resolve()), ("not.stl", f"package://{home.name}/not.stl")):
        urdf = f"<robot><link name='a'><mesh filename='package://{home.name}/{file}'/></link></robot>"
        assert f'"{address}"' in meshes_from(urdf, folder)


@pytest.mark.parametrize("place", ["above", "beside", "named", "holder"])
def test_a_package_in_a_folder_of_another_name_is_found_by_its_manifest(folder, monkeypatch, place):
    """As a clone that has the name of its repository, whatever its package.xml says."""
    home = {"above": folder.parent, "beside": folder.parent / "Clone"}.get(place, folder.parents[1] / "Clone")
    if place in ("named", "holder"):
        monkeypatch.setenv(FOLDERS_VARIABLE, str(home if place == "named" else home.parent))
    home.mkdir(exist_ok=True)
    (home / "package.xml").write_text("<package format='3'>\n  <name> arm_description </name></package>", "utf-8")
    (home / "part.stl").write_bytes(b"")
    urdf = "<robot><link name='a'><mesh filename='package://arm_description/part.stl'/></link></robot>"
    assert f'"{(home / "part.stl").resolve()}"' in meshes_from(urdf, folder)
    assert "package://arm/" in meshes_from(urdf.replace("arm_description", "arm"), folder)


def test_an_absent_package_is_asked_for_in_one_line(folder):
    said = refused(folder, "<xacro:include filename='$(find absent)/a.xacro'/>")
    assert said.endswith(f"the package 'absent' is not found; name the folder that holds it in {FOLDERS_VARIABLE}")
    urdf = "<robot><link name='a'><mesh filename='package://absent/a.stl'/></link></robot>"
    assert '"package://absent/a.stl"' in meshes_from(urdf, folder)
    (folder / "r.xacro").write_text(f"{HEAD}<gazebo>$(find absent)/a.yaml</gazebo></robot>", encoding="utf-8")
    assert "package://absent/a.yaml" in run_xacro(folder / "r.xacro", {})  # no file of it is read


def test_pictures_need_only_the_meshes_that_they_draw(folder):
    """Collision shapes are not drawn, and other texts name packages, too."""
    visual, collision = (
        f"<{kind}><geometry><mesh filename='package://absent/a.stl'/></geometry></{kind}>" for kind in SHAPES
    )
    for body, shown in ((collision + "<!-- package://absent/b.stl -->", True), (visual, False)):
        turn = "<joint name='turn' type='continuous'><parent link='a'/><child link='b'/><axis xyz='0 0 1'/></joint>"
        urdf = f"<robot name='r'><link name='a'>{body}</link><link name='b'/>{turn}</robot>"
        mechanism = ClosedChainMechanism(urdf, LoopsFile(end_frame="b", drives=("turn",)))
        bodies = bodies_at(mechanism.shared_model, [mechanism.neutral_configuration()])
        why = "its URDF has no visuals" if shown else "a.stl is missing or broken"
        assert drawn_robot(mechanism, bodies, "r", "").label == f"lines between its joints, as {why}"


def test_meshes_of_another_machine_are_needed_for_pictures_alone(folder, tmp_path):
    """Their absolute addresses are kept; a file that is there, but where descriptions may not read, is refused."""
    there = tmp_path / "there.stl"
    there.write_bytes(b"")
    shape = f"<visual><geometry><mesh filename='{there}'/></geometry></visual>"
    urdf = f"<robot name='r'><link name='a'>{shape}</link></robot>"
    with pytest.raises(DescriptionError, match="descriptions may not read"):
        meshes_from(urdf, folder / "deep" / "er")
    gone = meshes_from(urdf.replace(str(there), "/home/nobody/there.stl"), folder)
    assert "'file:///home/nobody/there.stl'".replace("'", '"') in gone
    (written,) = urdf_files(gone, folder).values()  # no mesh beside it, and the address as before
    assert b'"file:///home/nobody/there.stl"' in written


@pytest.mark.parametrize("name", ["..", "../..", "."])
def test_a_package_is_never_a_parent_folder(folder, name):
    assert FOLDERS_VARIABLE in refused(folder, f"<xacro:include filename='$(find {name})/secret.xml'/>")


def test_meshes_of_one_name_from_several_folders_stay_apart(folder):
    meshes = [folder / kind / "link.stl" for kind in ("visual", "collision", "other")]
    for path in meshes:
        path.parent.mkdir()
        path.write_text(path.parent.name, encoding="utf-8")
    body = "".join(f"<{path.parent.name}><mesh filename='{path}'/></{path.parent.name}>" for path in meshes)
    files = urdf_files(f"<robot name='r'><link name='a'>{body}</link></robot>", folder / "out")
    assert all(file.is_relative_to(folder / "out") for file in files)
    for path in meshes:
        address = re.search(f"<{path.parent.name}><mesh filename=.([^'\"]+)", files[folder / "out" / "r.urdf"].decode())
        assert files[folder / "out" / address[1]] == path.parent.name.encode()


@pytest.mark.parametrize("address", ["/etc/hostname", "file:///etc/hostname", "../../secret.xml", "link.xml"])
def test_meshes_from_outside_are_refused(folder, address):
    with pytest.raises(DescriptionError, match="outside"):
        meshes_from(f"<robot><link name='a'><mesh filename='{address}'/></link></robot>", folder)


def test_a_package_address_cannot_climb_out(folder):
    address = "package://pouring_robot_description/meshes/../../../../etc/hostname"
    with pytest.raises(DescriptionError, match="outside"):
        urdf_files(f"<robot><link name='a'><mesh filename='{address}'/></link></robot>", folder)


def test_entities_neither_multiply_nor_read_files(folder):
    ten = "".join(f'<!ENTITY {b} "{f"&{a};" * 10}">' for a, b in zip("abcdefghi", "bcdefghij", strict=True))
    body = "<robot name='r'><link name='&j;'/><joint name='j' type='fixed'/>&f;</robot>"
    for entities in (
        f'<!ENTITY a "aaaaaaaaaa">{ten}<!ENTITY f "">',
        '<!ENTITY j ""><!ENTITY f SYSTEM "../../secret.xml">',
    ):
        path = folder / "r.urdf"
        path.write_text(f"<!DOCTYPE r [{entities}]>{body}", encoding="utf-8")
        with pytest.raises(DescriptionError) as error:
            first_robot_file(path, folder)
        assert "treasure" not in str(error.value)


@pytest.mark.parametrize(
    ("joints", "said"),
    [
        ([("a", "b"), ("b", "c"), ("c", "b")], "'b' has several parent joints"),
        ([("b", "c"), ("c", "b")], "is carried by itself"),
        ([("a", "b"), ("b", "")], "joint 'j1' does not say which two links it joins"),
    ],
)
def test_a_urdf_that_is_no_tree_is_refused(folder, joints, said):
    links = "".join(f"<link name='{name}'/>" for name in "abc")
    for k, (parent, child) in enumerate(joints):
        ends = f"<parent link='{parent}'/>" + (f"<child link='{child}'/>" if child else "")
        ends += "<limit lower='-1' upper='1' effort='1' velocity='1'/>"
        links += f"<joint name='j{k}' type='revolute'>{ends}</joint>"
    path = folder / "r.urdf"
    path.write_text(f"<robot name='r'>{links}</robot>", encoding="utf-8")
    with pytest.raises(DescriptionError, match=said):
        first_robot_file(path, folder)


def test_two_joints_of_one_name_are_refused(folder):
    turns = "".join(
        f"<joint name='j' type='continuous'><parent link='{parent}'/><child link='{child}'/></joint>"
        for parent, child in ("ab", "bc")
    )
    path = folder / "r.urdf"
    path.write_text(
        f"<robot name='r'><link name='a'/><link name='b'/><link name='c'/>{turns}</robot>", encoding="utf-8"
    )
    with pytest.raises(DescriptionError, match="2 joints are called 'j'"):
        first_robot_file(path, folder)


def test_limits_that_may_be_in_degrees_are_asked_about(folder):
    """A URDF is in rad, so an arm's ±170 are 27 turns to each side. A winch may turn that often, hence a question."""
    path = folder / "r.urdf"
    turns = "".join(
        f"<joint name='{name}' type='revolute'><parent link='{parent}'/><child link='{child}'/>"
        f"<limit lower='{-limit}' upper='{limit}' effort='1' velocity='1'/></joint>"
        for name, parent, child, limit in (("arm", "a", "b", 170.0), ("wrist", "b", "c", 6.28))
    )
    path.write_text(f"<robot name='r'><link name='a'/><link name='b'/><link name='c'/>{turns}</robot>", "utf-8")
    asked = [line for line in first_robot_file(path, folder).splitlines() if "degrees" in line]
    assert asked == ["# The URDF's limits of arm are -170 to 170 rad: are they degrees? A URDF uses rad."]


def test_a_tool_is_preferred_to_fingers_as_end_frame_and_limits_are_asked_for(folder):
    """Of leaves with usual names the likeliest is the end frame; a name that only contains the letters is none."""
    path = folder / "r.urdf"
    joints = (
        ("arm", "revolute", "base", "wrist"),
        ("mount", "fixed", "wrist", "tool0"),
        ("grip", "prismatic", "wrist", "finger"),
        ("roll", "revolute", "finger", "wheel"),
    )
    made = "".join(
        f"<joint name='{name}' type='{kind}'><parent link='{parent}'/><child link='{child}'/>"
        f"<limit lower='0' upper='1' effort='1' velocity='1'/></joint>"
        for name, kind, parent, child in joints
    )
    links = "".join(f"<link name='{name}'/>" for name in ("base", "wrist", "tool0", "finger", "wheel"))
    path.write_text(f"<robot name='r'>{links}{made}</robot>", "utf-8")
    assert "\nend_frame: tool0" in first_robot_file(path, folder)
    path.write_text(
        path.read_text("utf-8").replace("<limit lower='0' upper='1' effort='1' velocity='1'/>", "", 1), "utf-8"
    )
    with pytest.raises(DescriptionError, match="joint 'arm': it has no limits; give it some, or the type 'continuous'"):
        first_robot_file(path, folder)
