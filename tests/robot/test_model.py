"""The model file: it survives a round trip, and mistakes in it are reported."""

import json
import shutil
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from ruamel.yaml import YAML

from pouring_robot.exceptions import (
    BadInputError,
    DescriptionError,
    OutputError,
    UnknownJointError,
    UnknownLayoutError,
)
from pouring_robot.robot.description.urdf import perturb_urdf
from pouring_robot.robot.model import DriveOffset, JointPlacement, RobotModel
from pouring_robot.robot.pouring.layout import load_layout, render_urdf, shipped_layouts_file
from pouring_robot.robot.pouring_robot import load_robot
from tests.support import ACTUAL, ROOT, crooked_model

LEARNED = ROOT / "examples" / "learned.yaml"
HEAD = "format: pouring_robot/model/1\nlayout: paper\n"
WRITTEN = "model.yaml"


def test_load_save_load_changes_nothing(tmp_path):
    first = RobotModel.load(ACTUAL)
    once = first.save(tmp_path / "once.yaml")
    with pytest.raises(OutputError, match="exists already"):
        first.save(once)
    assert first.save(once, overwrite=True) == once
    second = RobotModel.load(once)
    twice = second.save(tmp_path / "twice.yaml")
    assert second == first
    assert once.read_text() == twice.read_text() == ACTUAL.read_text()


def test_every_digit_survives(tmp_path):
    model = RobotModel(
        layout="wide",
        description="a: 'quoted' – and long, " + "long " * 40,
        joint_placements={"leg1_s1": JointPlacement(translation_mm=(0.1 + 0.2, -1e-9, 1 / 3))},
    )
    again = RobotModel.load(model.save(tmp_path / "model.yaml"))
    assert again == model
    assert again.joint_placements["leg1_s1"].translation_mm == (0.1 + 0.2, -1e-9, 1 / 3)


def test_mm_and_mrad_become_m_and_rad_in_the_joints_own_frame():
    placement = JointPlacement(translation_mm=(1.0, 2.0, -3.0), rotation_mrad=(0.5, -4.0, 2.0))
    model = RobotModel(joint_placements={"leg3_s2": placement})
    nominal, actual = (
        pin.buildModelFromXML(urdf).jointPlacements[1:] for urdf in (model.definition.urdf(), model.urdf())
    )
    changed = [k for k, (a, b) in enumerate(zip(nominal, actual, strict=True)) if not a.isApprox(b, 1e-12)]
    names = list(pin.buildModelFromXML(model.urdf()).names)[1:]
    assert [names[k] for k in changed] == ["leg3_s2"]
    error = nominal[changed[0]].actInv(actual[changed[0]])
    assert error.translation == pytest.approx([1e-3, 2e-3, -3e-3], abs=1e-15)
    assert pin.log3(error.rotation) == pytest.approx([0.5e-3, -4e-3, 2e-3], abs=1e-15)


def test_the_example_moves_the_ladle_by_millimetres(as_built):
    assert len(as_built.model.joint_placements) == 20
    assert as_built.actual_solver.mechanism.urdf != as_built.nominal_solver.mechanism.urdf


def test_own_layouts_file_is_relative_to_the_model(tmp_path):
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    text = shipped_layouts_file().read_text(encoding="utf-8")
    assert "\n  wide:\n" in text
    (tmp_path / "a" / "mine.yaml").write_text(text.replace("\n  wide:\n", "\n  mine:\n"), encoding="utf-8")
    path = tmp_path / "a" / "model.yaml"
    path.write_text("format: pouring_robot/model/1\nlayout: mine\nlayouts_file: mine.yaml\n")
    model = RobotModel.load(path)
    assert model.layouts_path == tmp_path / "a" / "mine.yaml"
    # Saved elsewhere it still finds the file; moved together, both still work.
    moved = RobotModel.load(model.save(tmp_path / "b" / "model.yaml"))
    assert moved.layouts_path is not None
    assert moved.layouts_path.resolve() == (tmp_path / "a" / "mine.yaml").resolve()
    assert moved.urdf() == model.urdf()
    shutil.copytree(tmp_path / "a", tmp_path / "c")
    assert RobotModel.load(tmp_path / "c" / "model.yaml").urdf() == model.urdf()
    (tmp_path / "a" / "mine.yaml").unlink()
    with pytest.raises(DescriptionError, match=r"mine\.yaml"):
        RobotModel.load(path)


def test_files_of_a_model_stay_its_own_when_the_working_directory_changes(tmp_path, monkeypatch):
    for folder, text in {"a": shipped_layouts_file().read_text(encoding="utf-8"), "b": "of another machine"}.items():
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "mine.yaml").write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path / "a")
    Path("model.yaml").write_text("layouts_file: mine.yaml\n")
    robot = load_robot("model.yaml")
    monkeypatch.chdir(tmp_path / "b")
    assert robot.layout == load_layout()
    assert load_robot(robot.model.save("model.yaml")).model == robot.model


PLACED = "joint_placements:\n  leg1_s1:\n    translation_mm: "


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("layot: paper\n", "line 1: unknown key 'layot'; did you mean 'layout'"),
        (
            HEAD + "joint_placements:\n  leg1_s1:\n    translation: [0, 0, 0]\n",
            "line 5: .*has no unit; write translation_mm",
        ),
        (HEAD + "joint_placements:\n  leg1_s9: {}\n", "no joint 'leg1_s9'; did you mean 'leg1_s"),
        (HEAD + "joint_placements:\n  moving_platform_mount: {}\n", "displace the joints that place the chains' seats"),
        (HEAD + PLACED + "[.nan, 0, 0]\n", "line 5: .*finite"),
        (HEAD + PLACED + "[.inf, 0, 0]\n", "line 5: .*finite"),
        (HEAD + PLACED + "[0, 0]\n", "line 5"),
        (HEAD + PLACED + "[0, 0, 0, 0]\n", "line 5"),
        (HEAD + PLACED + "[a, 0, 0]\n", "line 5: .*it is 'a'"),
        (HEAD + PLACED + "[0.2, -0.1, true]\n", r"line 5: .*translation_mm.2': .*valid number \(it is True\)"),
        (HEAD + PLACED + "[0.2, -0.1, '0']\n", r"line 5: .*valid number \(it is '0'\)"),
        (HEAD + PLACED + "[0, 0, 600]\n", "600 mm is too large for a placement error.*check the unit"),
        (
            HEAD + "joint_placements:\n  leg1_s1: {rotation_mrad: [0, 200, 0]}\n",
            "200 mrad is too large for a placement error",
        ),
        (
            HEAD + "drive_offsets: {leg4_s5: {offset_mrad: -629}}\n",
            "-629 mrad is too large for a drive offset.*a tenth of a turn",
        ),
        ("format: pouring_robot/model/7\n", "pouring_robot/model/1"),
        (HEAD + "joint_placements: 5\n", "joint_placements"),
        (HEAD + "joint_placements:\n", "joint_placements"),
        ("[1, 2]\n", "mapping"),
        ("layout: [paper\n", "not valid YAML"),
    ],
)
def test_mistakes(written, text, words):
    path = written(text)
    with pytest.raises(DescriptionError, match=words) as caught:
        RobotModel.load(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)
    assert caught.value.exit_code == 2


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("mean_span_m", [], "learned.campaign.mean_span_m: it needs 4 numbers, one for each of leg1_s3, .*, not 0"),
        ("mean_span_m", [0.1, 0.2], "learned.campaign.mean_span_m: it needs 4 numbers, .*, not 2"),
        ("mean_force", [1.0], "learned.campaign.mean_force: it needs 4 numbers, .*, not 1"),
        ("mean_force", [1.0, 1.0, 1.0, -1.0], "'learned.campaign.mean_force.3': .*greater than or equal to 0"),
        (
            "ranges",
            {"q1_m": [0.9, 0.1]},
            "'learned.campaign.ranges.q1_m': a range starts with its lower end, unlike 0.9 to 0.1",
        ),
        ("ranges", {"q1_m": [0.1, 0.9], "zz_m": [0, 1]}, "learned.campaign.ranges: unknown key 'zz_m'"),
        ("ranges", {"q1_mm": [0.1, 0.9]}, "unknown key 'q1_mm'; did you mean 'q1_m'"),
        ("seen_rad", {"leg1_s3": [[0, 1]]}, "learned.campaign.seen_rad: unknown key 'leg1_s3'"),
        ("mean_rise_k", {"leg_1": 3.0}, "learned.campaign.mean_rise_k: unknown key 'leg_1'; did you mean 'leg1'"),
        ("ladle_tare_kg", -180, "'learned.campaign.ladle_tare_kg': .*greater than 0"),
        ("truss_span_m", 0, "'learned.campaign.truss_span_m': .*greater than 0"),
        ("reference_temperature_degC", -300, "'learned.campaign.reference_temperature_degC': .*absolute zero"),
        ("reference_temperature_degC", 293.15, "hotter than any surroundings"),
    ],
)
def test_learned_values_must_be_possible_for_this_robot(written, key, value, words):
    """Each of these was accepted silently."""
    content = YAML(typ="safe").load(LEARNED.read_text(encoding="utf-8"))
    content["learned"]["campaign"][key] = value
    path = written(json.dumps(content))
    with pytest.raises(DescriptionError, match=words) as caught:
        RobotModel.load(path)
    assert str(caught.value).startswith(f"{path}: ") and "\n" not in str(caught.value)


def test_unknown_layout(written):
    path = written("layout: papre\n")
    with pytest.raises(BadInputError, match=r"unknown layout 'papre'.*known: paper, wide") as caught:
        RobotModel.load(path)
    assert str(path) in str(caught.value)
    with pytest.raises(UnknownLayoutError):
        RobotModel(layout="papre").urdf()


@pytest.mark.parametrize(
    ("model", "is_drawing"),
    [
        (RobotModel(), True),
        (RobotModel(layout="wide", description="nothing is wrong with it"), True),
        (RobotModel(joint_placements={"leg1_s1": JointPlacement()}), True),
        (RobotModel(joint_placements={"leg1_s1": JointPlacement(translation_mm=(0.0, 0.0, 1e-6))}), False),
        (RobotModel(drive_offsets={"leg1_s3": DriveOffset(offset_mm=1.0)}), False),
    ],
)
def test_a_model_without_errors_is_the_drawing(model, is_drawing):
    assert model.is_drawing == is_drawing


def test_wrong_without_a_file_is_refused_too():
    with pytest.raises(UnknownJointError):
        RobotModel(joint_placements={"leg5_s1": JointPlacement()}).urdf()
    with pytest.raises(BadInputError, match="leg1_seat_mount"):
        RobotModel(joint_placements={"moving_platform_mount": JointPlacement()}).urdf()


def test_saving_where_nothing_can_be_written(tmp_path):
    with pytest.raises(OutputError, match="does not exist"):
        RobotModel().save(tmp_path / "absent" / "model.yaml")
    assert list(tmp_path.iterdir()) == []


def test_models_are_frozen_and_equal_by_content():
    assert crooked_model(1, 1.0) == crooked_model(1, 1.0)
    assert crooked_model(1, 1.0) != crooked_model(2, 1.0)
    with pytest.raises(ValueError, match="frozen"):
        RobotModel().layout = "wide"


def test_chain_order_changes_the_tree_only():
    errors = crooked_model(3, 1.0).displacements()
    orders = (1, 2, 3, 4), (3, 1, 4, 2)
    first, second = (pin.buildModelFromXML(perturb_urdf(render_urdf(chain_order=o), errors)) for o in orders)
    assert sorted(first.names) == sorted(second.names)
    masses = [sum(inertia.mass for inertia in robot.inertias) for robot in (first, second)]
    assert masses[0] == pytest.approx(masses[1], rel=1e-12)
    for name in list(first.names)[1:]:
        placements = [robot.jointPlacements[robot.getJointId(name)] for robot in (first, second)]
        assert np.abs(placements[0].homogeneous - placements[1].homogeneous).max() < 1e-14


# --- for any file content the answer is a robot or one clear line -------------------------------------

SCALARS = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-(10**6), 10**6),
    st.floats(),
    st.text(max_size=8),
    st.sampled_from(["paper", "wide", "leg1_s1", ".nan", "1e999", "~", "0x10", "2024-01-01", "pouring_robot/model/1"]),
)
KEYS = st.one_of(
    st.sampled_from(
        [
            "format",
            "layout",
            "layouts_file",
            "joint_placements",
            "translation_mm",
            "rotation_mrad",
            "leg1_s1",
            "description",
        ]
    ),
    st.text(max_size=6),
    st.integers(0, 3),
)
TREES = st.recursive(
    SCALARS,
    lambda inner: st.one_of(st.lists(inner, max_size=4), st.dictionaries(KEYS, inner, max_size=4)),
    max_leaves=12,
)


def dumped(tree):
    """Return YAML text of a tree without quoting anything, so that it may also be broken."""
    if isinstance(tree, dict):
        return "{" + ", ".join(f"{key}: {dumped(value)}" for key, value in tree.items()) + "}"
    if isinstance(tree, list):
        return "[" + ", ".join(map(dumped, tree)) + "]"
    return str(tree)


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(tree=st.dictionaries(KEYS, TREES, max_size=4))
def test_any_tree_loads_or_is_refused(tmp_path, tree):
    path = tmp_path / "model.yaml"
    path.write_text(dumped(tree), encoding="utf-8", errors="replace")
    try:
        RobotModel.load(path)
    except BadInputError as error:
        assert "\n" not in str(error)


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(place=st.floats(0.0, 1.0), change=st.binary(max_size=6), length=st.integers(0, 30))
def test_any_damage_to_the_example_is_refused_or_harmless(tmp_path, place, change, length):
    content = ACTUAL.read_bytes()
    at = int(place * len(content))
    path = tmp_path / "model.yaml"
    path.write_bytes(content[:at] + change + content[at + length :])
    try:
        RobotModel.load(path)
    except BadInputError as error:
        assert "\n" not in str(error)


@pytest.mark.parametrize("text", ["{format: []}: 1\n", "? {a: [1]}\n: 2\n"])
def test_a_key_that_is_no_text_is_refused(tmp_path, text):
    path = tmp_path / "model.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(DescriptionError, match="a key is a list or a mapping"):
        RobotModel.load(path)


@pytest.mark.parametrize(("robot", "reach_mm"), [("five_bar", 840.0), ("delta", 1360.0)])
def test_the_largest_allowed_error_is_proportional_to_the_robot(robot, reach_mm):
    """A tenth of its reach: 150 + 250 + 390 + 50 mm to the pen; 200 + 300 + 750 + 50 + 60 mm to the grip."""
    model = RobotModel.for_robot(ROOT / "examples" / "robots" / robot / "robot.yaml")
    joint = model.definition.drives[0].joint
    for size, accepted in ((0.0999, True), (0.1001, False)):
        placed = {joint: JointPlacement(translation_mm=(0.0, size * reach_mm, 0.0))}
        moved = model.model_copy(update={"joint_placements": placed})
        with nullcontext() if accepted else pytest.raises(BadInputError, match=f"limit {reach_mm / 10:.0f} mm"):
            moved.check_errors()
