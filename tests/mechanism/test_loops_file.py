"""Loops files of both dialects."""

import pytest

from pouring_robot.exceptions import BadInputError, DescriptionError
from pouring_robot.mechanism.loops_file import LoopsFile, load_loops
from pouring_robot.robot.description.urdf import description_folder

OWN = """
mechanism: five-bar
drives: [left, right]
loops:
  - {name: tips, frame_a: a_tip, frame_b: b_tip, type: 3d}
"""
WRITTEN = "loops.yaml"


def test_the_shipped_file_declares_the_four_chains():
    loops = load_loops(description_folder() / "config" / "loops.yaml")
    assert loops.names == ("chain_1", "chain_2", "chain_3", "chain_4")
    pairs = [(loop.frame_a, loop.frame_b, loop.type) for loop in loops.loops]
    assert pairs == [(f"leg{i}_foot", f"leg{i}_seat", "6d") for i in (1, 2, 3, 4)]
    assert loops.drives == ("leg1_s3", "leg2_s3", "leg3_s3", "leg4_s5")
    assert loops.cut_joints == ("moving_platform_mount",)
    translation, rotation = loops.stiffness_si
    assert (rotation / translation) ** 0.5 <= 0.1  # rotation is compliant against translation


def test_own_dialect(written):
    loops = load_loops(written(OWN))
    assert loops.drives == ("left", "right")
    assert loops.loops[0].type == "3d"
    assert loops.base_frame == "universe"
    assert loops.end_frame is None


def test_gepetto_dialect(written):
    loops = load_loops(
        written(
            "closed_loop: [[a_tip, b_tip], [c_tip, d_tip]]\n"
            "type: [3D, 6d]\n"
            "name_mot: [left, right]\n"
            "joint_name: []\njoint_type: []\n"
        )
    )
    assert [(loop.frame_a, loop.frame_b, loop.type) for loop in loops.loops] == [
        ("a_tip", "b_tip", "3d"),
        ("c_tip", "d_tip", "6d"),
    ]
    assert loops.names == ("loop_1", "loop_2")
    assert loops.drives == ("left", "right")


def test_gepetto_dialect_without_types_means_6d_and_takes_one_motor_name(written):
    loops = load_loops(written("closed_loop: [[a, b]]\nname_mot: left\n"))
    assert loops.loops[0].type == "6d"
    assert loops.drives == ("left",)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("closed_loop: [[a, b]]\nname_mot: [m]\ntypes: [6d]\n", "unknown key 'types'"),
        ("closed_loop: [[a, b]]\nname_mot: [m]\ntype: [6d, 6d]\n", "'type' must be a list of 1"),
        ("closed_loop: [[a, b, c]]\nname_mot: [m]\n", "pairs of frame names"),
        ("closed_loop: [a, b]\nname_mot: [m]\n", "pairs of frame names"),
        ("closed_loop: [[a, b]]\nname_mot: [m]\njoint_name: [j]\njoint_type: [screw]\n", "'universal_xy'"),
        ("closed_loop: [[a, b]]\nname_mot: [m]\njoint_name: [j]\njoint_type: []\n", "lists of one length"),
        ("closed_loop: [[a, b]]\nname_mot: [m]\njoint_name: [m]\njoint_type: [FIXED]\n", "'m' is driven or cut"),
        ("closed_loop: [[a, b]]\n", "drives"),
        ("closed_loop: [[a, b]]\nname_mot: [m]\ntype: [5d]\n", "'6d' or '3d'"),
        ("closed_loop:\nname_mot: [m]\n", "closed_loop"),
        ("closed_loop: 3\nname_mot: [m]\n", "closed_loop"),
        ("closed_loop: [[a, b]]\nname_mot: [m]\ntype: 6d\n", "'type' must be a list"),
        ("closed_loop: [[a, b]]\nname_mot: 7\n", "drives|name_mot"),
        ("closed_loop: [[a, b]]\nname_mot: [m]\n7: 8\njoints: 3\n", "unknown key"),
        ("closed_loop: [[a, b]]\nname_mot: [m]\njoint_name: 5\n", "joint_name"),
    ],
)
def test_gepetto_dialect_mistakes(written, text, words):
    with pytest.raises(DescriptionError, match=words) as caught:
        load_loops(written(text))
    assert "loops.yaml" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("drives: [left, right]", "drives: []"), "drives"),
        (("drives: [left, right]", "drives: [left, left]"), "drive 'left' occurs twice"),
        (("drives: [left, right]\n", ""), "key 'drives' is missing"),
        (("frame_b: b_tip", "frame_c: b_tip"), "frame_b"),
        (("type: 3d", "type: 2d"), "loops.0.type"),
        (("mechanism: five-bar", "mechanisms: five-bar"), "did you mean 'mechanism'"),
        (("mechanism: five-bar", "cut_joints: [a, a]"), "cut joint 'a' occurs twice"),
        (
            (
                "mechanism: five-bar",
                "stiffness: {translation: {value: 1.0, unit: N/mm, source: assumed}, "
                "rotation: {value: 1.0, unit: Nm/rad, source: assumed}}",
            ),
            "N/m",
        ),
        (
            (
                "mechanism: five-bar",
                "stiffness: {translation: {value: 0.0, unit: N/m, source: assumed}, "
                "rotation: {value: 1.0, unit: Nm/rad, source: assumed}}",
            ),
            "greater than 0, in N/m",
        ),
        (
            (
                "mechanism: five-bar",
                "stiffness: {translation: {value: .nan, unit: N/m, source: assumed}, "
                "rotation: {value: 1.0, unit: Nm/rad, source: assumed}}",
            ),
            "finite",
        ),
    ],
)
def test_own_dialect_mistakes(written, change, words):
    assert change[0] in OWN
    with pytest.raises(DescriptionError, match=words) as caught:
        load_loops(written(OWN.replace(*change)))
    assert "loops.yaml" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_reported_frames_are_those_of_the_file(drawing):
    loops = drawing.model.definition.loops
    assert loops.reported_frames == ("moving_platform", "ladle", "ladle_lip")
    assert loops.working_frame == "ladle_lip"
    bare = loops.model_copy(update={"end_frame": None, "tool_frames": ()})
    with pytest.raises(BadInputError, match="names no end_frame and no tool_frames"):
        _ = bare.working_frame


def test_a_loop_name_occurs_once():
    twice = {"frame_a": "a", "frame_b": "b", "name": "tips"}
    with pytest.raises(BadInputError, match="loop 'tips' occurs twice"):
        LoopsFile(drives=("m",), loops=(twice, twice))


def test_a_serial_arm_has_no_loops(written):
    loops = load_loops(written("drives: [waist, elbow]\nend_frame: flange\n"))
    assert loops.loops == ()
    assert loops.names == ()
    assert loops.working_frame == "flange"


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("drives: [waist]\n", "end_frame"),
        ("drives: [waist]\nend_frame: flange\ncut_joints: [mount]\n", "joint 'mount' is cut, but no loop"),
    ],
)
def test_without_loops_the_file_names_an_end_frame_and_cuts_no_joint(written, text, problem):
    with pytest.raises(DescriptionError, match=problem):
        load_loops(written(text))
