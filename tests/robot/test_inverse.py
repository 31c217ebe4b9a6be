"""Drive values for a target: random targets are met to 1e-9; a target that leaves freedoms open is refused."""

import numpy as np
import pinocchio as pin
import pytest

import pouring_robot
from pouring_robot.exceptions import BadInputError, ClosureError, NoSolutionError, UnreachableTargetError
from pouring_robot.robot.inverse import REACHED, InverseSolution, Target
from pouring_robot.robot.robot import Robot
from tests.robot.test_robot import NAMES, ROBOTS
from tests.support import ROOT, gantry_file

PLACED_ONLY = ("delta", "five_bar")
HANGPRINTER = Robot.load(ROOT / "examples" / "machines" / "hangprinter" / "robot.yaml")


def test_only_the_librarys_targets_are_accepted():
    assert pouring_robot.Target is Target
    for given in (None, [0.0, 0.0, -0.6]):
        with pytest.raises(BadInputError, match="a target is a Target: a place, in m, and a rotation matrix if"):
            HANGPRINTER.location_to(given)


@pytest.mark.parametrize("name", NAMES)
def test_reachable_targets_are_met(name):
    robot = Robot.load(ROBOTS / name / "robot.yaml")
    drives, _ = robot.model.definition.workspace(robot.drawing)
    random = np.random.default_rng(5)
    for _ in range(10):
        # Between two poses of the workspace, so that the search starts at none of the targets.
        k, other = random.choice(len(drives), 2, replace=False)
        between = 0.7 * drives[k] + 0.3 * drives[other]
        pose = robot.nominal_solver.solve(
            dict(zip(robot.model.definition.loops.drives, between.tolist(), strict=True)),
            robot.drawing.configuration_at(between),
        ).pose_base_to_end
        target = Target(pose.translation, None if name in PLACED_ONLY else pose.rotation)
        found = robot.location_to(target)
        assert np.abs(target.left(found.nominal.pose_base_to_end)).max() < REACHED


@pytest.mark.parametrize(("each", "met"), [(0.5e-9, True), (0.6e-9, False)])
@pytest.mark.parametrize("part", [slice(0, 3), slice(3, 6)])
def test_met_refers_to_a_distance_and_an_angle(part, each, met):
    """As in a compensation's status, and not to the largest component."""
    robot = Robot.load(ROBOTS / "arm" / "robot.yaml")
    result, left = robot.location_in_the_middle().nominal, np.zeros(6)
    left[part] = each
    assert InverseSolution(np.zeros(6), result, left, (3, 3), True).met == met


def test_a_position_alone_does_not_determine_an_arm():
    arm = Robot.load(ROBOTS / "arm" / "robot.yaml")
    with pytest.raises(BadInputError, match="determines 3 of 6 freedoms; give its attitude too"):
        arm.location_to(Target(np.array([0.5, 0.1, 0.7])))


def test_freedoms_that_the_drives_do_not_command_are_out_of_reach():
    bar = Robot.load(ROBOTS / "five_bar" / "robot.yaml")
    with pytest.raises(UnreachableTargetError, match="50 mm and 0 mrad away; the robot commands 2 of the 3 freedoms"):
        bar.location_to(Target(np.array([0.02, 0.56, 0.05])))
    delta = Robot.load(ROBOTS / "delta" / "robot.yaml")
    with pytest.raises(UnreachableTargetError, match="200 mrad away; the robot commands 3 of the 6 freedoms"):
        delta.location_to(Target(np.array([0.0, 0.0, -0.6]), pin.exp3(np.array([0.0, 0.0, 0.2]))))


@pytest.mark.parametrize(
    ("name", "place", "why"),
    [("delta", (0.5, 0.5, 0.0), "would stand at"), ("hexapod", (0.0, 0.0, -3.0), "on the way to it the loops do not")],
)
def test_a_distant_target_is_out_of_reach_and_no_misfit_of_parts(name, place, why):
    """Whatever error the single searches end with."""
    robot = Robot.load(ROBOTS / name / "robot.yaml")
    with pytest.raises(NoSolutionError, match=r"^the pose is out of reach: ") as refused:
        robot.drives_to(Target(np.array(place), np.eye(3) if name == "hexapod" else None))
    assert why in str(refused.value)
    assert "check the drive values" not in str(refused.value)


def test_redundant_lines_have_the_distances_to_their_anchors():
    """Three freedoms, four lines: each has the distance from its anchor."""
    there = np.array([0.1, 0.2, 0.3])
    anchors = np.array([[0.0, -1.5939, -0.1], [1.5521, 0.8961, -0.1], [-1.3677, 0.7897, -0.1], [0.0, 0.0, 2.355]])
    found = HANGPRINTER.location_to(Target(there))
    assert list(found.drives.values()) == pytest.approx(np.linalg.norm(anchors - there, axis=1), abs=1e-9)
    assert found.nominal.gap_m < 1e-9


def test_impossible_line_lengths_are_refused_and_measured_ones_are_not():
    with pytest.raises(ClosureError, match=r"the drives disagree .* is left open by 1[0-9]{3} mm"):
        HANGPRINTER.location_at([0.005] * 4)
    slack = np.array([0.1, 0.0, 0.0, 0.0]) + HANGPRINTER.model.definition.home_drives
    assert 0.02 < HANGPRINTER.location_at(slack).nominal.gap_m < 0.05
    status = HANGPRINTER.locate_drives([[0.005] * 4, slack]).status
    assert status.values.tolist() == ["left open too far", "closed"]


def test_the_pouring_robot_is_one_of_them(drawing):
    """Its closed form and the search agree."""
    target = Target(np.array([-0.1, 0.02, -0.6]), pin.exp3(np.array([0.0, 0.3, 0.0])))
    found = drawing.location_to(target)
    wanted = drawing.kinematics.inverse(found.commanded)
    assert list(found.drives.values()) == pytest.approx(list(wanted.values()), abs=1e-12)
    assert found.commanded.position_m == pytest.approx(target.position_m, abs=REACHED)
    assert found.commanded.tilt_rad == pytest.approx(0.3, abs=REACHED)


def test_a_real_arm_returns_to_its_pose():
    arm = Robot.load(ROOT / "examples" / "machines" / "ur10" / "robot.yaml")
    there = arm.location_at([0.3, -1.4, 1.1, 0.2, 0.6, 0.1]).nominal.pose_base_to_end
    found = arm.location_to(Target(there.translation, there.rotation)).nominal.pose_base_to_end
    assert np.abs(pin.log6(there.actInv(found)).vector).max() < REACHED


def test_nuts_turn_as_often_as_needed(tmp_path):
    """The step limit of a nut is that of what it moves, not a turn of it."""
    robot = Robot.load(gantry_file(tmp_path, lead=0.005))
    found = robot.location_to(Target(np.array([1.9, 0.1, 0.7])))
    np.testing.assert_allclose(list(found.drives.values()), 2.0 * np.pi / 0.005 * np.array([1.9, 0.1, 0.7]))


@pytest.mark.parametrize(
    ("place", "turned", "says"),
    [
        ([0.5, 0.1], None, "the place of a target"),
        (np.array([0.5, 0.1, 0.7j]), None, "the place of a target"),
        ([0.5, 0.1, 0.7], np.eye(3) * 1j, "the attitude of a target"),
        ([0.5, 0.1, 0.7], [0.0, 0.0, 0.2], "the attitude of a target"),
        ([0.5, 0.1, 0.7], np.diag([1.0, 1.0, -1.0]), "a rotation matrix, 3 × 3"),
    ],
)
def test_a_target_is_a_position_and_a_rotation(place, turned, says):
    with pytest.raises(BadInputError, match=says):
        Target(place, turned)
