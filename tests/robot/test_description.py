"""The rendered URDF: names, geometry, physics, limits, programs that load it, and what is refused."""

from __future__ import annotations

import importlib.util
import itertools
import math
import shutil
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin
import pytest
import trimesh
import yaml
import yourdfpy
from lxml import etree
from scipy.spatial.transform import Rotation

from pouring_robot.exceptions import DescriptionError, OutputError, UnknownJointError, UnknownLayoutError
from pouring_robot.io.cache import CACHE_VARIABLE, content_key
from pouring_robot.robot.description import urdf
from pouring_robot.robot.description.urdf import MESH_PACKAGE, description_folder, perturb_urdf, write_urdf
from pouring_robot.robot.pouring import layout as layouts
from pouring_robot.robot.pouring.layout import layout_names, load_layout, render_urdf
from tests.support import displacement, round_off

LAYOUTS = ("paper", "wide")
ORDERS = tuple(itertools.permutations((1, 2, 3, 4)))
# Comes with Pinocchio, in the environment's folder of programs.
CHECK_URDF = str(Path(sys.executable).with_name("check_urdf"))
CARRIERS = ((1, 2, 3, 4), (2, 4, 1, 3), (3, 1, 4, 2), (4, 3, 2, 1))
CHAINS = (1, 2, 3, 4)
MARGIN_RAD, MARGIN_M = 0.05, 0.015
SLACK_RAD, SLACK_M = 0.15, 0.04
SHIPPED = (description_folder() / "config" / "layouts.yaml").read_text(encoding="utf-8")


def inverse_kinematics(layout: str, position_m: np.ndarray, tilt_rad: float) -> dict[str, float]:
    """Closed form of the design: joint values of all four chains at a pose of the moving platform."""
    dimensions = load_layout(layout)
    rotation = Rotation.from_rotvec([0.0, tilt_rad, 0.0]).as_matrix()
    values: dict[str, float] = {}
    for i in CHAINS:
        leg = position_m + rotation @ dimensions.moving_centres.metres[i - 1] - dimensions.fixed_centres.metres[i - 1]
        length = float(np.linalg.norm(leg))
        swing, lean = math.atan2(-leg[0], -leg[2]), math.asin(leg[1] / length)
        values |= {
            f"leg{i}_s1": swing,
            f"leg{i}_s2": lean,
            f"leg{i}_s3": length,
            f"leg{i}_s4": -lean,
            f"leg{i}_s5": tilt_rad - swing,
        }
    return values


def configuration(model: pin.Model, values: dict[str, float]) -> np.ndarray:
    q: np.ndarray = pin.neutral(model)
    for name, value in values.items():
        q[model.joints[model.getJointId(name)].idx_q] = value
    return q


def frame_pose(model: pin.Model, q: np.ndarray, frame: str, base: str = "fixed_platform") -> pin.SE3:
    """Pose of a frame in the fixed platform."""
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    return data.oMf[model.getFrameId(base)].actInv(data.oMf[model.getFrameId(frame)])


def workspace_corners(layout: str) -> list[tuple[np.ndarray, float]]:
    *bounds, tilts = np.transpose(load_layout(layout).box)
    return [(np.array(corner), tilt) for corner in itertools.product(*bounds) for tilt in tilts]


def joint_origin(urdf: str, joint: str) -> pin.SE3:
    origin = etree.fromstring(urdf.encode()).find(f"joint[@name='{joint}']/origin")
    xyz, rpy = (np.array([float(v) for v in origin.get(key).split()]) for key in ("xyz", "rpy"))
    return pin.SE3(pin.rpy.rpyToMatrix(rpy), xyz)


def write(folder: Path, text: str) -> Path:
    path = folder / "layouts.yaml"
    path.write_text(text, encoding="utf-8")
    return path


# --- names and geometry ----------------------------------------------------------------------------


def test_names_are_those_other_modules_rely_on() -> None:
    root = etree.fromstring(render_urdf().encode())
    bodies = ("upper_cross", "fixed_rod", "moving_rod", "lower_cross", "foot", "seat")
    links = {"world", "truss_bridge", "trolley", "fixed_platform", "moving_platform", "ladle", "ladle_lip"}
    joints = {"truss_travel", "trolley_travel", "fixed_platform_mount", "moving_platform_mount"}
    joints |= {"ladle_mount", "ladle_lip_mount"}
    for i in CHAINS:
        links |= {f"leg{i}_{body}" for body in bodies}
        joints |= {f"leg{i}_{joint}" for joint in ("s1", "s2", "s3", "s4", "s5", "seat_mount")}
    assert root.get("name") == "pouring_robot"
    assert {link.get("name") for link in root.iterfind("link")} == links
    assert {joint.get("name") for joint in root.iterfind("joint")} == joints


def test_loops_file_names_frames_and_joints_of_the_urdf() -> None:
    loops = yaml.safe_load((description_folder() / "config" / "loops.yaml").read_text(encoding="utf-8"))
    root = etree.fromstring(render_urdf().encode())
    links = {link.get("name") for link in root.iterfind("link")}
    joints = {joint.get("name") for joint in root.iterfind("joint")}
    frames = [loops["base_frame"], loops["end_frame"], *loops["tool_frames"]]
    frames += [loop[key] for loop in loops["loops"] for key in ("frame_a", "frame_b")]
    assert set(frames) <= links
    assert {*loops["cut_joints"], *loops["locked_joints"], *loops["drives"]} <= joints
    assert len(loops["loops"]) == len(loops["drives"]) == 4


@pytest.mark.parametrize("layout", LAYOUTS)
def test_closed_form_puts_every_foot_on_its_seat(layout: str) -> None:
    position, tilt = np.array([-0.1, 0.02, -0.6]), 0.3
    model = pin.buildModelFromXML(render_urdf(layout))
    q = configuration(model, inverse_kinematics(layout, position, tilt))
    rotation = Rotation.from_rotvec([0.0, tilt, 0.0]).as_matrix()
    for i in CHAINS:
        foot = frame_pose(model, q, f"leg{i}_foot")
        expected = position + rotation @ load_layout(layout).moving_centres.metres[i - 1]
        np.testing.assert_allclose(foot.translation, expected, rtol=0, atol=1e-12)
        np.testing.assert_allclose(foot.rotation, rotation, rtol=0, atol=1e-12)
        assert frame_pose(model, q, f"leg{i}_seat").isApprox(foot, 1e-12)
    np.testing.assert_allclose(frame_pose(model, q, "moving_platform").translation, position, atol=1e-12)


def test_leg_lengths_and_tilt_drive_are_those_of_the_design() -> None:
    values = inverse_kinematics("paper", np.array([-0.1, 0.02, -0.6]), 0.3)
    lengths_mm = [1000.0 * values[f"leg{i}_s3"] for i in CHAINS]
    np.testing.assert_allclose(lengths_mm, [550.5232, 553.7110, 706.2394, 708.727], atol=1e-3)
    assert values["leg4_s5"] == pytest.approx(-0.0858709, abs=1e-6)


@pytest.mark.parametrize("order", ORDERS, ids=lambda order: "".join(map(str, order)))
def test_every_chain_order_is_the_same_robot(order: tuple[int, ...]) -> None:
    position, tilt = np.array([-0.07, -0.03, -0.7]), 0.6
    root = etree.fromstring(render_urdf(chain_order=order).encode())
    assert root.find("joint[@name='moving_platform_mount']/parent").get("link") == f"leg{order[0]}_foot"
    listed = [joint.get("name") for joint in root.iterfind("joint") if joint.get("name").endswith("_s1")]
    assert listed == [f"leg{i}_s1" for i in order]
    model = pin.buildModelFromXML(render_urdf(chain_order=order))
    q = configuration(model, inverse_kinematics("paper", position, tilt))
    ladle_in_platform = np.array(load_layout().ladle.rim_centre.metres)
    expected = position + Rotation.from_rotvec([0.0, tilt, 0.0]).apply(ladle_in_platform)
    np.testing.assert_allclose(frame_pose(model, q, "ladle").translation, expected, rtol=0, atol=1e-12)


def test_lip_points_forward_and_sinks_with_positive_tilt() -> None:
    model = pin.buildModelFromXML(render_urdf())
    level, poured = (
        frame_pose(
            model, configuration(model, inverse_kinematics("paper", np.array([-0.1, 0, -0.6]), tilt)), "ladle_lip"
        ).translation
        for tilt in (0.0, 1.0)
    )
    assert level[0] > 0.3
    assert poured[2] < level[2] - 0.3


def test_units_of_the_layouts_file_are_converted(tmp_path: Path) -> None:
    in_mm = "[[-340, 374, 0], [-340, -374, 0], [340, 374, 0], [340, -374, 0]]\n      unit: mm"
    in_m = "[[-0.340, 0.374, 0], [-0.340, -0.374, 0], [0.340, 0.374, 0], [0.340, -0.374, 0]]\n      unit: m"
    assert in_mm in SHIPPED
    path = write(tmp_path, SHIPPED.replace(in_mm, in_m))
    assert render_urdf(layouts_file=path) == render_urdf()
    np.testing.assert_array_equal(load_layout("paper", path).fixed_centres.metres, load_layout().fixed_centres.metres)


def test_users_own_layout_is_used(tmp_path: Path) -> None:
    path = write(tmp_path, SHIPPED.replace("[[-187, 340, 0]", "[[-190, 345, 7]").replace("  wide:", "  mine:"))
    assert layout_names(path) == ("paper", "mine")
    np.testing.assert_allclose(
        joint_origin(render_urdf("mine", layouts_file=path), "leg1_s1").translation, [-0.190, 0.345, 0.007]
    )


# --- physics ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("layout", LAYOUTS)
def test_inertias_are_physical(layout: str) -> None:
    root = etree.fromstring(render_urdf(layout).encode())
    massless = set()
    for link in root.iterfind("link"):
        inertial = link.find("inertial")
        if inertial is None:
            massless.add(link.get("name"))
            continue
        entry = {key: float(value) for key, value in inertial.find("inertia").attrib.items()}
        matrix = np.array(
            [
                [entry["ixx"], entry["ixy"], entry["ixz"]],
                [entry["ixy"], entry["iyy"], entry["iyz"]],
                [entry["ixz"], entry["iyz"], entry["izz"]],
            ]
        )
        moments = np.linalg.eigvalsh(matrix)
        assert float(inertial.find("mass").get("value")) > 0.5, link.get("name")
        assert moments[0] > 0.0, link.get("name")
        assert moments[0] + moments[1] > moments[2], link.get("name")
    assert massless == {"world", "ladle_lip", *(f"leg{i}_seat" for i in CHAINS)}


@pytest.mark.parametrize("link", ["fixed_platform", "moving_platform", "leg2_foot"])
def test_composite_inertia_agrees_with_that_of_the_solids(link: str) -> None:
    element = etree.fromstring(render_urdf().encode()).find(f"link[@name='{link}']")
    solids = []
    for collision in element.iterfind("collision"):
        size = [float(v) for v in collision.find("geometry/box").get("size").split()]
        solid = trimesh.creation.box(size)
        solid.apply_translation([float(v) for v in collision.find("origin").get("xyz").split()])
        solids.append(solid)
    body: Any = trimesh.util.concatenate(solids)
    body.density = 7850.0
    entry = element.find("inertial/inertia")
    np.testing.assert_allclose(float(element.find("inertial/mass").get("value")), body.mass, rtol=1e-9)
    centre = [float(v) for v in element.find("inertial/origin").get("xyz").split()]
    np.testing.assert_allclose(centre, body.center_mass, atol=1e-9)
    for key, (row, column) in {"ixx": (0, 0), "iyy": (1, 1), "izz": (2, 2), "ixz": (0, 2)}.items():
        np.testing.assert_allclose(float(entry.get(key)), body.moment_inertia[row, column], atol=1e-8)


def test_ladle_has_its_tare_at_its_centre_of_mass() -> None:
    ladle = load_layout().ladle
    inertial = etree.fromstring(render_urdf().encode()).find("link[@name='ladle']/inertial")
    origin = np.array([float(v) for v in inertial.find("origin").get("xyz").split()])
    assert float(inertial.find("mass").get("value")) == ladle.tare.value == 180.0
    np.testing.assert_allclose(origin + ladle.rim_centre.metres, [0.05, 0.0, -0.28], atol=1e-15)


def test_every_body_can_be_seen_and_touched() -> None:
    for link in etree.fromstring(render_urdf().encode()).iterfind("link"):
        if link.get("name") == "ladle_lip" or link.get("name").endswith("_seat"):
            continue
        assert link.find("visual") is not None, link.get("name")
        assert link.find("collision") is not None, link.get("name")


@pytest.mark.parametrize("layout", LAYOUTS)
def test_limits_hold_the_workspace_with_a_margin_and_little_more(layout: str) -> None:
    *axes, tilts = (
        np.linspace(*ends, n) for ends, n in zip(np.transpose(load_layout(layout).box), (3, 3, 5, 21), strict=True)
    )
    samples = [inverse_kinematics(layout, np.array(p), r) for p in itertools.product(*axes) for r in tilts]
    model = pin.buildModelFromXML(render_urdf(layout))
    for joint in ("s1", "s2", "s3", "s4", "s5"):
        # All four legs are the same part, so the needs of each count for all.
        needed = [sample[f"leg{i}_{joint}"] for sample in samples for i in CHAINS]
        margin, slack = (MARGIN_M, SLACK_M) if joint == "s3" else (MARGIN_RAD, SLACK_RAD)
        for i in CHAINS:
            index = model.joints[model.getJointId(f"leg{i}_{joint}")].idx_q
            lower, upper = model.lowerPositionLimit[index], model.upperPositionLimit[index]
            assert min(needed) - slack < lower < min(needed) - margin, joint
            assert max(needed) + margin < upper < max(needed) + slack, joint


@pytest.mark.parametrize("layout", LAYOUTS)
def test_bodies_keep_clear_of_each_other_at_the_corners_of_the_workspace(layout: str) -> None:
    urdf = render_urdf(layout)
    model = pin.buildModelFromXML(urdf)
    data, solids = model.createData(), pin.buildGeomFromUrdfString(model, urdf, pin.GeometryType.COLLISION)
    joined = {
        frozenset((joint.find("parent").get("link"), joint.find("child").get("link")))
        for joint in etree.fromstring(urdf.encode()).iterfind("joint")
    }
    joined |= {frozenset((f"leg{i}_foot", "moving_platform")) for i in CHAINS}
    links = [model.frames[solid.parentFrame].name for solid in solids.geometryObjects]
    for first, second in itertools.combinations(range(solids.ngeoms), 2):
        pair = frozenset((links[first], links[second]))
        if len(pair) == 2 and pair not in joined:
            solids.addCollisionPair(pin.CollisionPair(first, second))
    solid_data = solids.createData()
    for position, tilt in workspace_corners(layout):
        values = inverse_kinematics(layout, position, tilt) | {"truss_travel": 3.0}
        q = configuration(model, values)
        touching = pin.computeCollisions(model, data, solids, solid_data, q, True)
        assert not touching, (position, tilt)


# --- who can load it -------------------------------------------------------------------------------


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("order", CARRIERS, ids=lambda order: "".join(map(str, order)))
def test_pinocchio_and_mujoco_agree_on_the_robot(layout: str, order: tuple[int, ...], tmp_path: Path) -> None:
    path = tmp_path / "pouring_robot.urdf"
    path.write_text(render_urdf(layout, chain_order=order), encoding="utf-8")
    model = pin.buildModelFromUrdf(str(path))
    other = mujoco.MjModel.from_xml_path(str(path))
    assert model.nq == other.nq == 22
    assert np.sum(other.body_mass) == pytest.approx(sum(inertia.mass for inertia in model.inertias), rel=1e-12)
    values = inverse_kinematics(layout, np.array([-0.1, 0.02, -0.6]), 0.3) | {"truss_travel": 3.0}
    q = configuration(model, values)
    state = mujoco.MjData(other)
    for name, value in values.items():
        state.qpos[other.joint(name).qposadr[0]] = value
    mujoco.mj_kinematics(other, state)
    for i in CHAINS[1:]:
        foot = frame_pose(model, q, f"leg{order[i - 1]}_foot", base="universe")
        np.testing.assert_allclose(state.body(f"leg{order[i - 1]}_foot").xpos, foot.translation, rtol=0, atol=1e-9)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_yourdfpy_loads_it_with_its_mesh(layout: str, tmp_path: Path) -> None:
    robot = yourdfpy.URDF.load(str(write_urdf(render_urdf(layout), tmp_path / "robot")))
    values = inverse_kinematics(layout, np.array([-0.1, 0.02, -0.6]), 0.3)
    robot.update_cfg(values)
    model = pin.buildModelFromXML(render_urdf(layout))
    lip = frame_pose(model, configuration(model, values), "ladle_lip")
    np.testing.assert_allclose(robot.get_transform("ladle_lip", "fixed_platform"), lip.homogeneous, rtol=0, atol=1e-9)
    assert any(len(shape.faces) > 2000 for shape in robot.scene.geometry.values()), "the ladle's mesh is not there"


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("order", CARRIERS, ids=lambda order: "".join(map(str, order)))
def test_check_urdf_finds_no_fault(layout: str, order: tuple[int, ...], tmp_path: Path) -> None:
    path = tmp_path / "pouring_robot.urdf"
    path.write_text(render_urdf(layout, chain_order=order), encoding="utf-8")
    report = subprocess.run([CHECK_URDF, str(path)], capture_output=True, text=True, check=False)
    assert report.returncode == 0, report.stdout + report.stderr
    assert "Successfully Parsed XML" in report.stdout


def test_written_folder_is_complete_and_can_be_moved(tmp_path: Path) -> None:
    first = write_urdf(render_urdf(), tmp_path / "here")
    assert first == tmp_path / "here" / "pouring_robot.urdf"
    moved = shutil.move(tmp_path / "here", tmp_path / "there")
    files = {path.relative_to(moved).as_posix() for path in Path(moved).rglob("*") if path.is_file()}
    assert files == {"pouring_robot.urdf", "meshes/ladle.stl"}
    assert str(tmp_path) not in (Path(moved) / "pouring_robot.urdf").read_text(encoding="utf-8")
    model = pin.buildModelFromUrdf(str(Path(moved) / "pouring_robot.urdf"))
    assert model.nq == 22


def test_written_folder_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("a file", encoding="utf-8")
    with pytest.raises(OutputError, match="cannot write"):
        write_urdf(render_urdf(), tmp_path / "taken")


def test_a_folder_that_cannot_be_filled_is_left_as_it_was(tmp_path: Path) -> None:
    (tmp_path / "here" / "pouring_robot.urdf").mkdir(parents=True)
    with pytest.raises(OutputError, match="it is a folder"):
        write_urdf(render_urdf(), tmp_path / "here", {"beside.txt": b"new"})
    left = [path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*")]
    assert sorted(left) == ["here", "here/pouring_robot.urdf"]


def test_a_mesh_that_is_missing_is_named(tmp_path: Path) -> None:
    mesh = etree.fromstring(render_urdf().encode()).find(".//mesh")
    assert mesh.get("filename") == f"{MESH_PACKAGE}/ladle.stl"
    with pytest.raises(DescriptionError, match=r"ladle\.stl: this mesh is missing"):
        write_urdf(render_urdf().replace(MESH_PACKAGE, tmp_path.as_posix()), tmp_path / "robot")


def test_mesh_agrees_with_the_dimensions() -> None:
    ladle = load_layout().ladle
    path = description_folder() / "meshes" / ladle.mesh.value
    mesh = trimesh.load_mesh(path)
    flange_m = ladle.outer_radius_top.metres + ladle.rim_flange.metres
    lip_m = joint_origin(render_urdf(), "ladle_lip_mount").translation[0]
    assert mesh.is_watertight
    np.testing.assert_allclose(mesh.bounds[:, 2], [-ladle.height.metres, 0.0], atol=1e-6)
    np.testing.assert_allclose(mesh.bounds[1], [lip_m, flange_m, 0.0], rtol=3e-3, atol=1e-6)
    # An open vessel: on its axis is the inner bottom, one wall thickness above the outer one.
    depth = trimesh.proximity.closest_point(mesh, [[0.0, 0.0, -ladle.height.metres + ladle.wall.metres]])[1][0]
    assert depth == pytest.approx(0.0, abs=1e-6)
    assert not mesh.contains([[0.0, 0.0, -0.5 * ladle.height.metres]])[0]


def test_mesh_is_the_one_the_generator_makes(tmp_path: Path) -> None:
    script = Path(__file__).parents[2] / "scripts" / "make_meshes.py"
    spec = importlib.util.spec_from_file_location("make_meshes", script)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    module.main(["--out", str(tmp_path)])
    made, shipped = (trimesh.load_mesh(folder / "ladle.stl") for folder in (tmp_path, description_folder() / "meshes"))
    np.testing.assert_allclose(made.triangles, shipped.triangles, atol=1e-6)


# --- rendering -------------------------------------------------------------------------------------


def test_text_is_the_same_on_every_machine_and_cached() -> None:
    urdf = render_urdf()
    assert str(description_folder()) not in urdf
    assert "autogenerated" not in urdf
    assert render_urdf() is urdf


def test_changed_layouts_file_is_rendered_again(tmp_path: Path) -> None:
    path = write(tmp_path, SHIPPED)
    before = joint_origin(render_urdf(layouts_file=path), "leg3_s1").translation[0]
    write(tmp_path, SHIPPED.replace("[340, 374, 0]", "[341, 374, 0]"))
    after = joint_origin(render_urdf(layouts_file=path), "leg3_s1").translation[0]
    assert after - before == pytest.approx(0.001, abs=1e-12)


def test_a_rendering_is_made_once_per_machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "not" / "yet" / "there"))
    layouts._rendered.cache_clear()
    urdf = render_urdf()
    (kept,) = (tmp_path / "not").rglob("urdf/*.kept")
    assert kept.read_text(encoding="utf-8") == f"{content_key([urdf])}\n{urdf}"
    kept.write_text(f"{content_key(['<robot/>'])}\n<robot/>", encoding="utf-8")  # shows that it is read
    layouts._rendered.cache_clear()
    assert render_urdf() == "<robot/>"
    assert render_urdf("wide") != render_urdf(chain_order=(2, 1, 3, 4)) != "<robot/>"
    layouts._rendered.cache_clear()


def test_threads_do_not_mix_their_robots(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    expected = {order: render_urdf("wide", chain_order=order) for order in CARRIERS}
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path))
    layouts._rendered.cache_clear()
    results = {}

    def work(order: tuple[int, ...]) -> None:
        results[order] = render_urdf("wide", chain_order=order)

    threads = [threading.Thread(target=work, args=(order,)) for order in CARRIERS]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert results == expected


@pytest.mark.parametrize("order", [(1, 2, 3), (1, 2, 3, 3), (0, 1, 2, 3), ()])
def test_wrong_chain_order_is_refused(order: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="once each"):
        render_urdf(chain_order=order)


# --- perturbed joints ------------------------------------------------------------------------------


def test_perturbation_moves_that_joint_by_exactly_that() -> None:
    urdf = render_urdf()
    shift, turn = (1e-9, -2e-4, 3e-3), (1e-3, -4e-7, 0.2)
    perturbed = perturb_urdf(urdf, {"leg2_s1": displacement(shift, turn)})
    nominal, actual = joint_origin(urdf, "leg2_s1"), joint_origin(perturbed, "leg2_s1")
    expected = nominal.rotation @ Rotation.from_rotvec(turn).as_matrix()
    np.testing.assert_allclose(actual.rotation, expected, rtol=0, atol=round_off(terms=9))  # three products of length 3
    moved, size = actual.translation - nominal.translation, np.abs(nominal.translation).max()
    np.testing.assert_allclose(moved, shift, rtol=0, atol=round_off(scale=size, terms=2))
    joints = {joint.get("name") for joint in etree.fromstring(urdf.encode()).iterfind("joint")}
    for name in joints - {"leg2_s1"}:
        assert joint_origin(urdf, name) == joint_origin(perturbed, name), name


def test_perturbations_compose_in_the_joints_frame() -> None:
    first = displacement((1e-3, 2e-3, -1e-3), (0.3, -0.2, 0.9))
    second = displacement((-4e-3, 1e-3, 5e-4), (-0.1, 0.4, 0.2))
    twice = perturb_urdf(perturb_urdf(render_urdf(), {"leg3_s4": first}), {"leg3_s4": second})
    expected = joint_origin(render_urdf(), "leg3_s4") * first * second
    assert joint_origin(twice, "leg3_s4").isApprox(expected, 1e-14)


def test_perturbed_joint_is_felt_by_pinocchio() -> None:
    tilted = perturb_urdf(render_urdf(), {"leg1_s1": displacement(rotation_rad=(0.001, 0.0, 0.0))})
    nominal_model, model = pin.buildModelFromXML(render_urdf()), pin.buildModelFromXML(tilted)
    q = configuration(model, inverse_kinematics("paper", np.array([-0.1, 0.02, -0.6]), 0.3))
    arm = frame_pose(nominal_model, q, "leg1_foot").translation - load_layout().fixed_centres.metres[0]
    moved = frame_pose(model, q, "leg1_foot").translation - frame_pose(nominal_model, q, "leg1_foot").translation
    np.testing.assert_allclose(moved, np.cross([0.001, 0.0, 0.0], arm), rtol=0, atol=1e-6)
    assert np.linalg.norm(moved) > 4e-4


def test_no_perturbation_changes_nothing() -> None:
    assert (
        etree.tostring(etree.fromstring(render_urdf().encode())).strip()
        == perturb_urdf(render_urdf(), {}).strip().encode()
    )


def test_unknown_joint_is_refused_with_the_nearest() -> None:
    with pytest.raises(UnknownJointError, match=r"no joint 'leg1_S1'.*did you mean 'leg1_s1'"):
        perturb_urdf(render_urdf(), {"leg1_S1": displacement()})


def test_perturbing_what_is_no_urdf_is_refused() -> None:
    with pytest.raises(DescriptionError, match="line 1"):
        perturb_urdf("<robot", {})
    with pytest.raises(DescriptionError, match="joint j: origin xyz='1 2' is not three numbers"):
        perturb_urdf("<robot><joint name='j'><origin xyz='1 2'/></joint></robot>", {"j": displacement()})


@pytest.mark.parametrize("part", [(math.nan, 0.0, 0.0), (0.0, math.inf, 0.0)])
def test_a_displacement_of_no_finite_numbers_is_refused(part: tuple[float, ...]) -> None:
    for moved in (displacement(part), displacement(rotation_rad=part)):
        with pytest.raises(ValueError, match="displacement of 'leg2_s1' must be finite numbers"):
            perturb_urdf(render_urdf(), {"leg2_s1": moved})


# --- what is refused -------------------------------------------------------------------------------


def test_unknown_layout_lists_the_known() -> None:
    with pytest.raises(UnknownLayoutError, match=r"'papr' in layouts\.yaml; known: paper, wide"):
        render_urdf("papr")
    with pytest.raises(UnknownLayoutError):
        load_layout("papr")


@pytest.mark.parametrize(
    ("shipped", "broken", "complaint"),
    [
        pytest.param("    gauge:", "    gague:", r"line \d+: .*truss\.ga", id="misspelt key"),
        pytest.param("value: 6.0,", "value: .nan,", r"line 42: .*truss\.span\.value.*finite", id="NaN"),
        pytest.param("value: 6.0,", "value: .inf,", r"line 42: .*truss\.span\.value.*finite", id="infinite"),
        pytest.param("value: 6.0,", "value: -6.0,", r"line 42: .*truss\.span\.value.*greater", id="negative"),
        pytest.param("value: 6.0,", "value: 0,", r"line 42: .*truss\.span\.value.*greater", id="zero"),
        pytest.param("value: 6.0,", 'value: "6"', r"not valid YAML|span\.value", id="text"),
        pytest.param("value: 6.0,", "value: true,", r"line 42: .*truss\.span\.value", id="switch"),
        pytest.param("value: 6.0,", "value: 6e0,", r"truss\.span\.value.*disagree", id="text to xacro"),
        pytest.param("value: 6.0,", "value: 010,", r"truss\.span\.value.*disagree", id="octal to xacro"),
        pytest.param("    span:", "    12:30:45:", r"truss'.* name '12:30:45'; put it in quotes$", id="time to xacro"),
        pytest.param("unit: kg,", "unit: g,", r"line \d+: .*ladle\.payload\.unit", id="unknown unit"),
        pytest.param("source: paper", "source: rumour", r"workspace\.x\.source", id="unknown source"),
        pytest.param("[-150, -50]", "[-50, -150]", r"line \d+: .*workspace\.x\.value.*below", id="bounds swapped"),
        pytest.param("[-340, 374, 0], ", "", r"fixed_centres\.value", id="three chains"),
        pytest.param("ladle.stl", "../ladle.stl", r"line \d+: .*ladle\.mesh\.value", id="mesh elsewhere"),
        pytest.param("layouts:\n", "layouts: {}\nrest:\n", r"line \d+: .*(rest|layouts)", id="no layouts"),
        pytest.param("value: 6.0,", "value: [6.0", r"line \d+: not valid YAML", id="not YAML"),
        pytest.param("&common\n", "&common\n  <<: {odd: 1}\n", r"line \d+: .*common\.odd", id="merged odd key"),
    ],
)
def test_broken_layouts_file_is_refused_on_one_line(shipped: str, broken: str, complaint: str, tmp_path: Path) -> None:
    assert shipped in SHIPPED
    path = write(tmp_path, SHIPPED.replace(shipped, broken, 1))
    for use in (lambda: render_urdf(layouts_file=path), lambda: load_layout("wide", path)):
        with pytest.raises(DescriptionError, match=complaint) as caught:
            use()
        assert str(caught.value).startswith(f"{path}: ")
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("content", ["", "- 1\n", "just text\n"])
def test_layouts_file_that_is_no_mapping_is_refused(content: str, tmp_path: Path) -> None:
    with pytest.raises(DescriptionError, match="mapping"):
        layout_names(write(tmp_path, content))


def test_missing_layouts_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(DescriptionError, match=r"none\.yaml: cannot be read: No such file"):
        render_urdf(layouts_file=tmp_path / "none.yaml")


@pytest.mark.parametrize(
    ("name", "shipped", "broken", "complaint"),
    [
        ("ladle.urdf.xacro", "</robot>", "", "not valid XML"),
        ("ladle.urdf.xacro", "${-height / 2}", "${-hight / 2}", "hight"),
        ("upu_chain.urdf.xacro", "<xacro:body name=", "<xacro:boddy name=", "boddy"),
        ("pouring_robot.urdf.xacro", "truss.urdf.xacro", "trus.urdf.xacro", "No such file"),
        # Evaluated inside a macro of common.urdf.xacro, but written by its caller; a property is evaluated where it is
        # used; and a macro has no control over its call.
        ("upu_chain.urdf.xacro", "${si_list(limits.s1)}", "${si_list(limit.s1)}", "limit.s1"),
        ("truss.urdf.xacro", "${si(t.rail_width)}", "${si(t.rial_width)}", "rial_width"),
        ("pouring_robot.urdf.xacro", "carrier=", "carier=", "carier"),
    ],
)
def test_broken_xacro_is_refused_on_one_line(
    name: str, shipped: str, broken: str, complaint: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "robot_description"
    shutil.copytree(description_folder(), folder)
    path = folder / "urdf" / name
    text = path.read_text(encoding="utf-8")
    assert shipped in text
    path.write_text(text.replace(shipped, broken), encoding="utf-8")
    monkeypatch.setattr(layouts, "description_folder", lambda: folder)
    with pytest.raises(DescriptionError, match=complaint) as caught:
        render_urdf()
    assert caught.value.path == path
    assert "\n" not in str(caught.value)
    # The next rendering is not affected by what xacro left behind.
    path.write_text(text, encoding="utf-8")
    assert "ladle_lip" in render_urdf()


def test_missing_description_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(urdf, "__file__", str(tmp_path / "pouring_robot" / "robot" / "description" / "urdf.py"))
    with pytest.raises(DescriptionError, match="missing; reinstall"):
        urdf.description_folder()


def test_folder_is_a_ros_package() -> None:
    package = etree.parse(str(description_folder() / "package.xml")).getroot()
    assert package.findtext("name") == "pouring_robot_description"  # the folder keeps the short name
    assert package.findtext("license") == "Apache-2.0"
    installed = (description_folder() / "CMakeLists.txt").read_text(encoding="utf-8")
    assert "install(DIRECTORY config launch meshes rviz urdf DESTINATION share/${PROJECT_NAME})" in installed
