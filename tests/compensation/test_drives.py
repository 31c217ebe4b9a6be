"""Compensation of any robot: what its drives command is cancelled, what remains is stationary."""

import numpy as np
import pinocchio as pin
import pytest

from pouring_robot.compensation.pose import compensate_drives, drive_notes, drives_csv
from pouring_robot.exceptions import BadInputError
from pouring_robot.robot.model import JointPlacement, RobotModel
from pouring_robot.robot.pouring_robot import PouringRobot
from pouring_robot.robot.robot import Robot
from tests.robot.test_robot import ROBOTS, commands, crooked
from tests.support import gantry_file

__all__ = ["crooked"]


def test_the_tool_reaches_its_place_in_the_drawing(crooked):
    """An arm and a hexapod in all freedoms; a delta in position; a five-bar in its plane, where its drives move it."""
    wanted = crooked.location_at(commands(crooked, 1, seed=4)[0])
    found = compensate_drives(crooked, wanted)
    again = crooked.location_at(list(found.drives.values()))
    frame = crooked.model.definition.loops.working_frame
    left = again.poses(frame)[1].translation - wanted.poses(frame)[0].translation
    plane = 2 if crooked.model.definition.name == "five_bar" else 3
    assert np.abs(left[:plane]).max() < 1e-9
    assert found.before.distance_m > 1e-5 > found.left.distance_m or plane == 2
    if len(found.drives) == 6:
        assert np.abs(found.left.rotation_rad).max() < 1e-9


@pytest.mark.parametrize(("seed", "worse"), [(4, True), (5, False)])
def test_an_attitude_that_compensation_makes_worse_is_reported(seed, worse):
    """A delta positions only: whether its platform then rotates more or less depends on its errors, drawn here."""
    model, random = RobotModel.for_robot(ROBOTS / "delta" / "robot.yaml"), np.random.default_rng(seed)
    placements = {
        joint: JointPlacement(
            translation_mm=tuple(random.uniform(-0.5, 0.5, 3).tolist()),
            rotation_mrad=tuple(random.uniform(-0.5, 0.5, 3).tolist()),
        )
        for joint in dict.fromkeys(p.local.joint for p in Robot(model).parameters.parameters.values())
    }
    robot = Robot(model.model_copy(update={"joint_placements": placements}))
    frame, found = robot.model.definition.loops.working_frame, []
    for drives in commands(robot, 4, seed=5):
        one = compensate_drives(robot, robot.location_at(drives))
        nominal, before = one.wanted.poses(frame)
        after = robot.location_at(list(one.drives.values())).poses(frame)[1]
        sizes = [np.linalg.norm(pin.log3(pose.rotation @ nominal.rotation.T)) for pose in (before, after)]
        assert (sizes[1] > sizes[0]) == worse
        assert one.status == ("nearest + attitude worse" if worse else "nearest")
        assert f" and {1e3 * sizes[1]:.3g} mrad with it" in one.headline  # 1.51, not 1.5e+00
        found.append(one)
    told = ["attitude further off with compensation than without: 4 of 4 poses, by up to "] if worse else []
    assert [note[: len(told[0])] for note in drive_notes(found)] == told


@pytest.mark.parametrize(("off_mm", "far"), [(0.5, False), (9.9, False), (10.1, True), (30.0, True)])
def test_a_nut_is_reported_as_going_far_where_its_slide_does(tmp_path, off_mm, far):
    model = RobotModel.for_robot(gantry_file(tmp_path, lead=0.005))
    robot = Robot(
        model.model_copy(update={"joint_placements": {"x_slide": JointPlacement(translation_mm=(off_mm, 0, 0))}})
    )
    found = compensate_drives(robot, wanted := robot.location_at([200.0, 20.0, 30.0]))
    assert found.status == "reached"
    assert wanted.drives["x_turn"] - found.drives["x_turn"] == pytest.approx(2.0 * np.pi * off_mm / 5.0)
    assert [note.startswith("compensated drives are far") for note in drive_notes([found])] == [True] * far


def test_commands_are_written_as_they_are_read(crooked, tmp_path):
    wanted = crooked.location_at(commands(crooked, 1, seed=4)[0])
    found = compensate_drives(crooked, wanted)
    path = tmp_path / "c.csv"
    path.write_text(drives_csv([found]), encoding="utf-8")
    (drives,) = crooked.read_commands(path).values()
    assert drives == pytest.approx(list(found.drives.values()), rel=1e-10, abs=1e-12)


def test_the_drawing_needs_none():
    robot = Robot.load("examples/robots/delta/robot.yaml")
    wanted = robot.location_at([0.2, 0.1, 0.0])
    found = compensate_drives(robot, wanted)
    assert found.drives == pytest.approx(wanted.drives, abs=1e-10)
    assert "without compensation" in found.headline


def test_a_location_of_the_drawing_serves_as_well_as_the_robots_own(crooked):
    """The error without compensation is that of the robot; a location of the drawing has an error of 0 mm."""
    drives = commands(crooked, 1, seed=4)[0]
    drawing = Robot.load(RobotModel.for_robot(crooked.model.definition))
    own, found = (compensate_drives(crooked, robot.location_at(drives)) for robot in (crooked, drawing))
    assert found.before.distance_m == pytest.approx(own.before.distance_m, rel=1e-9)
    assert (found.drives, found.status) == (pytest.approx(own.drives, abs=1e-9), own.status)


def test_only_a_location_of_the_robots_drawing_is_accepted():
    robot = Robot.load("examples/robots/delta/robot.yaml")
    with pytest.raises(BadInputError, match="belongs to another drawing"):
        compensate_drives(robot, PouringRobot().location_in_the_middle())
    with pytest.raises(BadInputError, match=r"a Location, as robot.location_at\(drives\) returns, not a list"):
        compensate_drives(robot, [0.2, 0.1, 0.0])
