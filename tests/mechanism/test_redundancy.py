"""The disagreement of redundant drives, against an independent least-squares fit of line lengths."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import least_squares

from pouring_robot.batch import engine_for
from pouring_robot.exceptions import BadInputError, DescriptionError
from pouring_robot.mechanism.closure.redundancy import disagreement, redundant_drives
from pouring_robot.mechanism.closure.solver import ClosureSolver
from pouring_robot.mechanism.local_parameters import drive_parameters
from pouring_robot.robot.description.definition import RobotDefinition
from pouring_robot.robot.description.robot_file import RobotFile
from pouring_robot.robot.robot import Robot

MACHINE = Path(__file__).parents[2] / "examples/machines/hangprinter/robot.yaml"
ANCHORS = np.array([[0.0, -1.5939, -0.1], [1.5521, 0.8961, -0.1], [-1.3677, 0.7897, -0.1], [0.0, 0.0, 2.355]])
LENGTHS = np.array([1.597, 1.795, 1.5825, 2.355])
JOINTS = ("anchor_a_X", "anchor_b_X", "anchor_c_X", "anchor_d_X")
STEP = 1e-5


def least(lengths, anchors):
    """Return the root of the least sum of squared length errors, with the sign of their sum, and the position."""

    def off(place):
        return np.linalg.norm(place - anchors, axis=1) - lengths

    found = least_squares(off, np.array([0.0, 0.0, 0.3]), xtol=1e-15, ftol=1e-15, gtol=1e-15)
    return np.sign(found.fun.sum()) * np.linalg.norm(found.fun), found.x


@pytest.fixture(scope="module")
def robot():
    return RobotDefinition.load(MACHINE)


@pytest.fixture(scope="module")
def closed(robot):
    rng = np.random.default_rng(3)
    places = rng.uniform([-0.5, -0.5, 0.0], [0.5, 0.5, 1.2], (12, 3))
    lengths = np.linalg.norm(places[:, None] - ANCHORS, axis=2) + rng.normal(0.0, 0.02, (12, 4))
    engine = engine_for(robot.mechanism())
    return engine, lengths, engine.close(lengths, robot.drawing().starts(lengths))


def test_disagreement_is_the_least_correction_of_the_lines(closed):
    _, lengths, found = closed
    for row, (own, place) in enumerate(zip(lengths, found.position, strict=True)):
        expected, at = least(own, ANCHORS)
        assert abs(found.disagreement[row, 0]) == pytest.approx(abs(expected), abs=1e-9)
        np.testing.assert_allclose(place, at, atol=1e-7)


def test_its_derivative_is_that_of_the_least_squares(closed):
    engine, lengths, found = closed
    places = [p for p in engine.parameters if p.joint in JOINTS and p.unit == "m"]
    drives = drive_parameters(engine.structure.mechanism)
    matrix = engine.transfer(found, (*drives, *places)).disagreement
    for row in range(4):
        sign = np.sign(found.disagreement[row, 0]) * np.sign(least(lengths[row], ANCHORS)[0])
        for k in range(16):
            moved = []
            for step in (STEP, -STEP):
                own, anchors = lengths[row].copy(), ANCHORS.copy()
                if k < 4:
                    own[k] += step
                else:
                    anchors[(k - 4) // 3, (k - 4) % 3] += step
                moved.append(least(own, anchors)[0])
            slope = sign * (moved[0] - moved[1]) / (2.0 * STEP)
            assert matrix[row, 0, k] == pytest.approx(slope, abs=2e-6)


def test_a_rotation_of_a_line_about_its_anchor_changes_nothing(closed):
    engine, _, found = closed
    turns = [p for p in engine.parameters if p.joint in JOINTS and p.unit == "rad"]
    assert np.abs(engine.transfer(found, turns).disagreement).max() < 1e-12


@pytest.mark.parametrize("ways", [2, 99])
def test_too_few_ways_of_disagreement_are_reported(robot, ways):
    """Four lines for three coordinates disagree in one way; no drive opens the equations of platform rotations."""
    solver = ClosureSolver(robot.mechanism())
    result = solver.result_at(robot.drawing().configuration_at(LENGTHS))
    assert disagreement(solver, result, 1)[0].shape == (1,)
    with pytest.raises(BadInputError, match=f"do not disagree in {ways} ways here"):
        disagreement(solver, result, ways)


def test_the_condition_is_that_of_the_directions_of_the_lines():
    """Lengths follow positions by the unit vectors along the lines, and positions follow lengths by least squares."""
    robot = Robot.load(MACHINE)
    place = np.array([0.2, -0.1, 0.4])
    lines = place - ANCHORS
    lengths = np.linalg.norm(lines, axis=1)
    found = robot.dexterity(robot.location_at(lengths))
    sizes = np.linalg.svd(lines / lengths[:, None], compute_uv=False)
    assert found.condition == pytest.approx(sizes[0] / sizes[-1], rel=1e-5)
    assert found.distance > 0.5


def test_a_robot_without_redundant_drives_may_not_declare_them(robot):
    arm = RobotDefinition.load(MACHINE.parents[1] / "ur10/robot.yaml")
    assert redundant_drives(arm.mechanism()) == 0
    said = RobotFile.load(arm.path).model_copy(update={"redundant_drives": True})
    with pytest.raises((BadInputError, DescriptionError), match="redundant"):
        redundant_drives(RobotDefinition(said, arm.path).mechanism())


CORNERS = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 2.0], [0.0, 2.0]])


@pytest.fixture(scope="module")
def plane(tmp_path_factory):
    """Four belts from the corners of a frame to one point in its plane: no loop constrains motion across the plane."""
    folder = tmp_path_factory.mktemp("plane")
    parts = ['<robot name="belts"><link name="frame"/>']
    for name, (x, y) in zip("abcd", CORNERS, strict=True):
        along = np.array([1.5 - x, 1.0 - y]) / np.hypot(1.5, 1.0)
        parts.append(
            f'<joint name="anchor_{name}" type="continuous"><origin xyz="{x} {y} 0"/><axis xyz="0 0 1"/>'
            f'<parent link="frame"/><child link="eye_{name}"/></joint><link name="eye_{name}"/>'
            f'<joint name="belt_{name}" type="prismatic"><axis xyz="{along[0]} {along[1]} 0"/>'
            f'<limit lower="0" upper="4" effort="1" velocity="1"/><parent link="eye_{name}"/>'
            f'<child link="end_{name}"/></joint><link name="end_{name}"/>'
        )
    for link, before, axis in (("carriage", "frame", "1 0 0"), ("sled", "carriage", "0 1 0")):
        parts.append(
            f'<joint name="to_{link}" type="prismatic"><axis xyz="{axis}"/><limit lower="-4" upper="4" effort="1" '
            f'velocity="1"/><parent link="{before}"/><child link="{link}"/></joint><link name="{link}"/>'
        )
    (folder / "belts.urdf").write_text("".join(parts) + "</robot>")
    loops = ", ".join(f"{{name: {n}, frame_a: end_{n}, frame_b: sled, type: 3d}}" for n in "abcd")
    (folder / "robot.yaml").write_text(
        "format: pouring_robot/robot/1\nname: belts\nurdf: belts.urdf\nbase_frame: frame\nend_frame: sled\n"
        f"loops: [{loops}]\ndrives: [{', '.join(f'{{joint: belt_{n}}}' for n in 'abcd')}]\nredundant_drives: true\n"
        f"home: {{to_carriage: 1.5, to_sled: 1.0, {', '.join(f'belt_{n}: {np.hypot(1.5, 1.0)}' for n in 'abcd')}}}\n"
    )
    return RobotDefinition.load(folder / "robot.yaml")


def test_in_a_plane_the_ways_of_disagreement_are_the_surplus_drives(plane):
    rng = np.random.default_rng(4)
    places = rng.uniform([0.5, 0.5], [2.5, 1.5], (6, 2))
    lengths = np.linalg.norm(places[:, None] - CORNERS, axis=2) + rng.normal(0.0, 0.01, (6, 4))
    found = engine_for(plane.mechanism()).close(lengths, plane.drawing().starts(lengths))
    assert found.disagreement.shape == (6, 2)
    for row, own in enumerate(lengths):
        least = least_squares(lambda p, own=own: np.linalg.norm(p - CORNERS, axis=1) - own, places[row], xtol=1e-15)
        assert np.linalg.norm(found.disagreement[row]) == pytest.approx(np.linalg.norm(least.fun), abs=1e-9)


def test_a_frame_slightly_out_of_plane_does_not_change_the_number_of_surplus_drives(plane):
    tilted = {"anchor_b": pin.SE3(pin.exp3(np.array([2e-3, 0.0, 0.0])), np.array([0.0, 0.0, 1e-3]))}
    assert redundant_drives(plane.mechanism().displaced(tilted)) == 2
