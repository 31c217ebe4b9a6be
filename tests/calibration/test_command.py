"""From a virtual measurement to a calibrated robot, through the command line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from pouring_robot import ClosedChainMechanism, ClosureSolver, PlatformPose, RobotModel, load_loops, load_robot
from pouring_robot.cli.app import main
from tests.campaign.simulated import write_text
from tests.robot.test_definition import ARM, FILE

ACTUAL = str(Path(__file__).resolve().parents[2] / "examples" / "actual.yaml")


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory):
    folder = tmp_path_factory.mktemp("calibrated")
    campaign = folder / "measured.csv"
    assert (
        main(["campaign", "simulate", "--out", str(campaign), "--random", "80", "--model", ACTUAL, "--seed", "5"]) == 0
    )
    assert main(["calibrate", str(campaign), "--out", str(folder / "out")]) == 0
    return folder / "out"


def test_held_out_errors_are_as_small_as_the_noise(calibrated):
    held_out = json.loads((calibrated / "calibration.json").read_text())["gap"]["held_out"]
    assert held_out["before"]["rms_mm"] > 5.0 * held_out["floor"]["rms_mm"]
    # Ten rows of six coordinates: the standard deviation of their RMS is about ten per cent.
    assert held_out["after"]["rms_mm"] < 1.3 * held_out["floor"]["rms_mm"]
    assert held_out["after"]["rms_mrad"] < 1.4 * held_out["floor"]["rms_mrad"]


def test_the_calibrated_urdf_predicts_what_the_model_file_predicts(calibrated):
    robot = load_robot(calibrated / "calibrated.yaml")
    urdf = (calibrated / "pouring_robot.urdf").read_text()
    solver = ClosureSolver(ClosedChainMechanism(urdf, load_loops(calibrated / "loops.yaml")))
    for pose in (PlatformPose.from_mm_deg(-100, 20, -600, 17), PlatformPose.from_mm_deg(-140, -40, -780, -20)):
        location = robot.locate(pose)
        # The URDF has the drives' offsets in its joints, so that a joint's value is the command.
        found = solver.solve(location.drives, robot.kinematics.configuration(pose)).pose_base_to_end
        expected = location.actual.pose_base_to_end
        np.testing.assert_allclose(found.translation, expected.translation, atol=1e-9)
        np.testing.assert_allclose(pin.log3(found.rotation @ expected.rotation.T), 0.0, atol=1e-9)


def test_the_suggested_plan_command_runs_as_printed(calibrated, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (line,) = [x for x in json.loads((calibrated / "calibration.json").read_text())["next"] if "campaign plan" in x]
    arguments = line.partition("pouring-robot ")[2].split()
    assert main([*arguments, "--candidates", "200", "--starts", "1"]) == 0
    assert (tmp_path / "next.csv").exists()


def test_a_sound_robot_is_left_unchanged(tmp_path):
    campaign = tmp_path / "measured.csv"
    assert main(["campaign", "simulate", "--out", str(campaign), "--random", "60", "--seed", "3"]) == 0
    assert main(["calibrate", str(campaign), "--out", str(tmp_path / "out")]) == 0
    model = RobotModel.load(tmp_path / "out" / "calibrated.yaml")
    assert not model.joint_placements
    assert not model.drive_offsets


def test_damaged_input_writes_nothing(tmp_path, capsys):
    (tmp_path / "bad.csv").write_text("q1_mm,q2_mm\n1,x\n")
    assert main(["calibrate", str(tmp_path / "bad.csv"), "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_a_wrong_choice_is_refused_in_the_users_terms(tmp_path, capsys):
    assert main(["calibrate", "c.csv", "--out", str(tmp_path / "out"), "--loss", "cauchy"]) == 2
    assert capsys.readouterr().err.rstrip() == (
        "pouring-robot: Invalid value for '--loss': 'cauchy' is not one of 'huber', 'soft_l1', 'linear'; "
        "see pouring-robot calibrate --help"
    )


def test_an_output_that_could_not_be_written_is_refused_before_the_fit(tmp_path, capsys, monkeypatch):
    """The URDF is at the home, where a slide that begins at 0.2 m cannot be at zero."""
    (tmp_path / "arm.urdf").write_text(ARM.replace('lower="0"', 'lower="0.2"'), encoding="utf-8")
    (tmp_path / "robot.yaml").write_text(FILE, encoding="utf-8")
    table = write_text(tmp_path, "turn_rad,reach_rad,x_m,y_m,z_m", ["0.1,300,1,2,3"])
    monkeypatch.setattr("pouring_robot.calibration.calibrate.calibrate", lambda *_: pytest.fail("it was fitted"))
    words = ["calibrate", str(table), "--robot", str(tmp_path / "robot.yaml"), "--out", str(tmp_path / "out")]
    assert main(words) == 3
    assert "cannot stand at its home" in capsys.readouterr().err
    shape = '<link name="base"><visual><geometry><mesh filename="base.stl"/></geometry></visual></link>'
    (tmp_path / "arm.urdf").write_text(ARM.replace('<link name="base"/>', shape), encoding="utf-8")
    assert main(words) == 2
    assert "base.stl: this mesh is missing; put it there, or" in capsys.readouterr().err
