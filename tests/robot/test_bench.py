"""The effect of sliders: against the robot asked directly."""

import numpy as np
import pytest

from pouring_robot.robot.model import DriveOffset, JointPlacement
from pouring_robot.robot.pouring.platform_pose import PlatformPose
from pouring_robot.robot.pouring_robot import PouringRobot
from pouring_robot.robot.robot import Robot
from pouring_robot.robot.view.bench import RobotBench
from tests.robot.benches import POSE, ask, check
from tests.robot.test_robot import ROBOTS
from tests.support import ROOT


@pytest.fixture(name="bench", scope="module")
def _bench(as_built):
    return RobotBench(as_built, as_built.location_in_the_middle())


def test_pose_and_drives_move_each_other(bench, as_built):
    location = as_built.locate(PlatformPose.from_mm_deg(*POSE.values()))
    answer = ask(bench, POSE)
    check(answer, location)
    drives = {name: answer["values"][name] for name in ("q1_mm", "q2_mm", "q3_mm", "q4_deg")}
    units = np.array([1e3, 1e3, 1e3, np.degrees(1.0)])
    np.testing.assert_allclose(list(drives.values()), units * list(location.drives.values()), rtol=1e-12)
    back = ask(bench, drives, commanded="drives")
    assert {name: back["values"][name] for name in POSE} == pytest.approx(POSE, abs=1e-9)
    check(back, location)
    ((first, figure), *_) = back["film"]["steps"][0]["caption"]
    assert first.startswith("error at the ladle lip")
    shown = [float(value) for value in figure.split()[:3]]
    assert shown == pytest.approx(1e3 * location.difference().translation_m, abs=0.006)


def test_errors_are_added_to_those_of_the_model(bench, as_built):
    answer = ask(bench, POSE, errors={"leg2_s4.ty": 0.8, "drive.leg3_s3": -0.5, "leg1_s1.rx": 2.0})
    model = as_built.model
    placements, offsets = dict(model.joint_placements), dict(model.drive_offsets)
    for joint, change in (("leg2_s4", {"translation_mm": (0, 0.8, 0)}), ("leg1_s1", {"rotation_mrad": (2.0, 0, 0)})):
        present = placements.get(joint, JointPlacement()).to_se3()
        placements[joint] = JointPlacement.from_se3(present * JointPlacement(**change).to_se3())
    before = offsets["leg3_s3"].offset_mm if "leg3_s3" in offsets else 0.0
    offsets["leg3_s3"] = DriveOffset(offset_mm=before - 0.5)
    other = PouringRobot(model.model_copy(update={"joint_placements": placements, "drive_offsets": offsets}))
    check(answer, other.locate(PlatformPose.from_mm_deg(*POSE.values())))
    check(ask(bench, POSE), as_built.locate(PlatformPose.from_mm_deg(*POSE.values())))  # and removed again


def test_every_error_is_offered_with_its_unit(bench):
    errors = bench.sliders()["errors"]
    names = [name for group in errors["names"].values() for name in group]
    assert len(names) == len(set(names)) == len(errors["units"])
    assert errors["units"]["alpha_e1_56"] == "mrad" and errors["units"]["leg1_s1.tx"] == "mm"
    assert set(errors["units"].values()) == set(errors["largest"])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"values": {"x_mm": -5000.0}}, "out of reach"),
        ({"values": {"x_mm": float("nan")}}, "finite"),
        ({"values": {"x_mm": -1e300}}, "greater than or equal to -1000000000"),
        ({"errors": {"leg1_s1.tx": 1e300}}, "less than or equal to 1000000000"),
        ({"errors": {"leg9_s1.tx": 1.0}}, "no geometric error 'leg9_s1.tx'"),
        ({"errors": {"leg1_s1.tx": 5000.0}}, "too large for a placement error"),
    ],
)
def test_invalid_requests_are_refused_in_one_line(bench, change, words):
    answer = ask(bench, **change)
    assert set(answer) == {"refused"}
    assert words in answer["refused"] and "\n" not in answer["refused"]
    assert "refused" in bench.answer({"commanded": "pose"})


def test_a_slider_of_a_motor_is_labelled_differently_from_the_joint_it_moves():
    for path, label in (("machines/hangprinter", "motor of line_a"), ("robots/arm", "joint1")):
        robot = Robot.load(ROOT / "examples" / path / "robot.yaml")
        (group,) = RobotBench(robot, robot.location_in_the_middle()).sliders()["groups"]
        assert group["sliders"][0]["label"] == label


@pytest.mark.parametrize("name", ["arm", "delta", "five_bar", "hexapod"])
def test_any_robot_has_its_drives(name):
    robot = Robot.load(ROBOTS / name / "robot.yaml")
    bench = RobotBench(robot, robot.location_in_the_middle())
    (group,) = bench.sliders()["groups"]
    first = group["sliders"][0]
    assert first["lower"] < first["value"] < first["upper"]
    step = 0.01 * (first["upper"] - first["lower"])
    answer = ask(bench, {first["id"]: first["value"] + step}, commanded="drives")
    drives = robot.model.definition.home_drives.copy()
    drives[0] += step * (1e-3 if first["unit"] == "mm" else np.radians(1.0))
    check(answer, robot.location_at(drives))
