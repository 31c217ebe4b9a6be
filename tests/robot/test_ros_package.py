"""The ROS 2 package, without ROS: its manifest, launch files with stand-ins, ros2_control tags, the closing node."""

import ast
import importlib.util
import re
import sys
import types

import pytest
import yaml
from lxml import etree

from pouring_robot.robot.description.urdf import MESH_PACKAGE, description_folder
from pouring_robot.robot.description.xacro_to_urdf import run_xacro
from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.pouring_robot import PouringRobot

PACKAGE = "pouring_robot_description"
FOLDER = description_folder()
LAUNCH_FILES = sorted((FOLDER / "launch").glob("*.launch.py"))
# Children of <package> that format 3 of REP 149 allows, and those it requires.
KNOWN = {"name", "version", "description", "maintainer", "license", "buildtool_depend", "exec_depend", "export"}


class Recorded:
    """Stands in for a class of ROS and keeps its arguments."""

    def __init__(self, *args, **kwargs):
        self.args, self.kwargs = args, kwargs


def stand_in(monkeypatch, **modules):
    """Put modules in place that hold stand-ins of the given names."""
    for dotted, names in modules.items():
        name = dotted.replace("__", ".")
        module = types.ModuleType(name)
        for one in names:
            setattr(module, one, type(one, (Recorded,), {}))
        monkeypatch.setitem(sys.modules, name, module)


def loaded(path):
    """Import a file."""
    spec = importlib.util.spec_from_file_location(re.sub(r"\W", "_", path.name), path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_manifest_conforms_to_format_3():
    root = etree.parse(FOLDER / "package.xml").getroot()
    assert root.get("format") == "3" and {child.tag for child in root} == KNOWN
    assert root.findtext("name") == PACKAGE and re.fullmatch(r"\d+\.\d+\.\d+", root.findtext("version"))
    assert MESH_PACKAGE.startswith(f"package://{PACKAGE}/") and "@" in root.find("maintainer").get("email")
    assert (FOLDER / root.find("license").get("file")).read_text(encoding="utf-8").lstrip().startswith("Apache License")


def test_cmake_installs_what_exists():
    text = (FOLDER / "CMakeLists.txt").read_text(encoding="utf-8")
    assert f"project({PACKAGE})" in text
    (folders,) = re.findall(r"install\(DIRECTORY ([\w ]+) DESTINATION", text)
    assert all((FOLDER / name).is_dir() for name in folders.split())
    (program,) = re.findall(r"install\(PROGRAMS (\S+) ", text)
    assert (FOLDER / program).stat().st_mode & 0o111


@pytest.mark.parametrize("path", LAUNCH_FILES, ids=lambda path: path.name)
def test_a_launch_file_starts_what_the_manifest_depends_on(path, monkeypatch):
    stand_in(
        monkeypatch,
        launch=["LaunchDescription"],
        launch__actions=["DeclareLaunchArgument", "IncludeLaunchDescription"],
        launch__substitutions=["Command", "LaunchConfiguration", "PathJoinSubstitution"],
        launch_ros=[],
        launch_ros__actions=["Node"],
        launch_ros__parameter_descriptions=["ParameterValue"],
        launch_ros__substitutions=["FindPackageShare"],
    )
    (entries,) = loaded(path).generate_launch_description().args  # the shared one, or what includes it
    nodes = [entry.kwargs for entry in entries if type(entry).__name__ == "Node"]
    depends = {tag.text for tag in etree.parse(FOLDER / "package.xml").iterfind(".//exec_depend")} | {PACKAGE}
    assert {node["package"] for node in nodes} <= depends
    included = any(type(entry).__name__ == "IncludeLaunchDescription" for entry in entries)
    assert included != ({"robot_state_publisher", "closed_joint_states.py"} <= {node["executable"] for node in nodes})
    parts_of = re.findall(
        r"PathJoinSubstitution\(\[(?:here|FindPackageShare\(PACKAGE\)), (.*?)\]\)", path.read_text("utf-8")
    )
    assert parts_of
    for parts in parts_of:
        assert FOLDER.joinpath(*ast.literal_eval(f"({parts},)")).is_file()


@pytest.mark.parametrize("layout", ["paper", "wide"])
def test_ros2_control_commands_the_drives_from_a_closed_start(layout):
    urdf = run_xacro(FOLDER / "urdf" / "pouring_robot.urdf.xacro", {"layout": layout, "ros2_control": "true"})
    tags = etree.fromstring(urdf.encode()).find("ros2_control")
    starts = {
        joint.get("name"): float(joint.find("state_interface[@name='position']/param").text)
        for joint in tags.iterfind("joint")
    }
    robot = PouringRobot(RobotModel(layout=layout))
    middle = robot.location_in_the_middle().drives
    assert {name: starts[name] for name in middle} == pytest.approx(middle, abs=1e-12)
    controllers = yaml.safe_load((FOLDER / "config" / "controllers.yaml").read_text(encoding="utf-8"))
    assert controllers["drives_controller"]["ros__parameters"]["joints"] == list(starts)
    model = robot.nominal_solver.mechanism.joint_limits()
    for joint in tags.iterfind("joint"):
        limits = [float(param.text) for param in joint.iterfind("command_interface/param")]
        assert limits == pytest.approx(model[joint.get("name")], abs=1e-12)


def test_sliders_start_closed():
    zeros = yaml.safe_load((FOLDER / "config" / "sliders.yaml").read_text(encoding="utf-8"))
    found = zeros["joint_state_publisher_gui"]["ros__parameters"]["zeros"]
    assert found == pytest.approx(PouringRobot().location_in_the_middle().drives, abs=1e-12)


def test_the_rviz_file_is_yaml_and_shows_the_robot():
    content = yaml.safe_load((FOLDER / "rviz" / "display.rviz").read_text(encoding="utf-8"))
    assert "rviz_default_plugins/RobotModel" in {d["Class"] for d in content["Visualization Manager"]["Displays"]}


def test_the_node_publishes_all_joints_of_the_closed_robot(monkeypatch):
    stand_in(monkeypatch, rclpy=[], rclpy__node=["Node"], sensor_msgs=[], sensor_msgs__msg=["JointState"])
    module, sent, said = loaded(FOLDER / "scripts" / "closed_joint_states.py"), [], []

    class Message:
        def __init__(self, name=(), position=()):
            self.name, self.position, self.header = name, position, types.SimpleNamespace(stamp="now")

    module.JointState = Message
    log = types.SimpleNamespace(warning=lambda text, **_: said.append(text))
    monkeypatch.setattr(module.ClosedJointStates, "get_logger", lambda self: log, raising=False)
    node = object.__new__(module.ClosedJointStates)
    node.robot, node.publisher = PouringRobot(), types.SimpleNamespace(publish=sent.append)
    node.drives, node.travels = node.robot.nominal_solver.mechanism.loops.drives, ("truss_travel",)
    home = node.robot.location_in_the_middle().drives.values()
    node.close(Message([*node.drives, "truss_travel", "leg4_s3"], [*home, 2.5, 0.0]))
    joints = dict(zip(sent[0].name, sent[0].position, strict=True))
    expected = node.robot.location_in_the_middle().actual.joint_values
    assert joints == pytest.approx({**expected, "truss_travel": 2.5}, abs=1e-9) and sent[0].header.stamp == "now"
    node.close(Message(["leg1_s3"], [0.5]))
    assert len(sent) == 1 and "leg2_s3" in said[0]
    node.close(Message(node.drives))  # velocities alone
    node.close(Message(node.drives, [float("nan")] * 4))  # as drivers report before they have a value
    assert len(sent) == 1 and "leg1_s3" in said[1] and "one finite value for each drive" in said[2]
