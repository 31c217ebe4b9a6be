"""Other commands apply the saved model of a diagnosis: they predict the measured rows and can compensate its errors."""

import csv
import json

import numpy as np
import pinocchio as pin
import pytest

from pouring_robot import Campaign, diagnose, random_plan, robots_under
from pouring_robot.campaign.nominal import PoseStack
from pouring_robot.cli.app import main
from pouring_robot.diagnosis.amend import amended
from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.pouring_robot import robot_of
from tests.diagnosis.hidden import DRIFT, HOT
from tests.rig import Wanted

PLAY = (Wanted("drive_backlash", 6.0, "a"),)
BEAM = (Wanted("truss_deflection", 6.0, "a"),)
CASES = {"drift": DRIFT, "hot": HOT, "play": PLAY, "beam": BEAM}
CONDITIONS = ("time_s", *(f"leg{k}_degC" for k in range(1, 5)), "platform_degC", "payload_kg", "truss_travel_m")
SIDES = tuple(f"approach_q{k}" for k in range(1, 5))


@pytest.fixture(scope="module", params=CASES)
def case(request, diagnosed, tmp_path_factory):
    """A campaign of the independent machine, the diagnosis of it, its model file, and its poses as a table."""
    folder = tmp_path_factory.mktemp(request.param)
    found = diagnosed(CASES[request.param])
    assert {named.cause.effect for named in found.effects} == {CASES[request.param][0].effect}
    file = amended(found).save(folder / "model.yaml")
    data = found.rows.campaign
    conditions = [data.conditions[name.rpartition("_")[0]] for name in CONDITIONS]
    table = np.column_stack([_poses(data), *conditions, data.approach])
    head = ",".join(("x_m", "y_m", "z_m", "tilt_rad", *CONDITIONS, *SIDES))
    np.savetxt(folder / "poses.csv", table, delimiter=",", header=head, comments="", fmt="%.15g")
    return found, file, folder / "poses.csv"


def _poses(data):
    """Return the poses a user would have commanded, (n, 4): those of the drawing at the drive positions."""
    drawing = data.robot.drawing()
    found = [drawing.forward(data.drive_values(row)) for row in range(len(data))]
    return np.array([pose.values for pose in found])


def _seen(found, poses):
    """Return the target's positions seen by the tracker, (n, 3) in m, from platform poses, with the frames found."""
    shift, turn = (np.array([one[key] for one in poses]) for key in ("translation", "rotation"))
    return found.final.state.frames.seen(PoseStack(shift, turn)).position_m


def _poses_of(printed):
    """Return the poses of the moving platform from the JSON of ``path``."""
    found = []
    for one in json.loads(printed)["poses"]:
        frame = one["frames"]["moving_platform"]
        tilted = pin.exp3(np.array([0.0, np.radians(one["commanded"]["tilt_deg"]), 0.0]))
        turned = pin.exp3(1e-3 * np.array(frame["error"]["rotation_mrad"])) @ tilted
        found.append({"translation": 1e-3 * np.array(frame["actual_mm"]), "rotation": turned})
    return found


def test_a_path_predicts_what_was_measured_as_well_as_the_diagnosis(case, capsys):
    """Its residuals are those of the diagnosis to 1e-6 m, a fiftieth of the noise: placements are composed exactly."""
    found, file, poses = case
    assert main(["path", str(poses), "--model", str(file), "--json"]) == 0
    seen = _seen(found, _poses_of(capsys.readouterr().out))
    left = found.rows.campaign.position_m - seen
    rows = found.final.state.every_row
    own = np.full((len(left), 6), np.nan)
    own[rows.row, rows.component] = rows.residual * rows.sigma
    np.testing.assert_allclose(left, own[:, :3], atol=1e-6)
    floor = found.held_out.position("floor")
    assert np.sqrt(np.mean(left**2)) < 1.2 * floor < found.held_out.position("before") / 2.0


def test_compensated_commands_reach_the_wanted_poses(case, tmp_path, capsys):
    """Ten poses; commanded with the pose that a controller with the drawing understands, ``path`` finds it there."""
    _, file, poses = case
    head, *lines = poses.read_text().splitlines()
    some = [line.split(",") for line in lines[5:15]]
    few = tmp_path / "few.csv"
    few.write_text("\n".join([head, *map(",".join, some)]) + "\n")
    assert main(["compensate", str(few), "--model", str(file), "--out", str(tmp_path / "commands.csv")]) == 0
    with (tmp_path / "commands.csv").open() as stream:
        commands = list(csv.DictReader(stream))
    for row, command in zip(some, commands, strict=True):
        row[:3] = [str(1e-3 * float(command[f"command_{name}_mm"])) for name in "xyz"]
        row[3] = str(np.radians(float(command["command_tilt_deg"])))
    few.write_text("\n".join([head, *map(",".join, some)]) + "\n")
    capsys.readouterr()
    assert main(["path", str(few), "--model", str(file), "--json"]) == 0
    reached = np.array([one["translation"] for one in _poses_of(capsys.readouterr().out)])
    wanted = np.array([[float(cell) for cell in line.split(",")[:3]] for line in lines[5:15]])
    assert np.abs(reached - wanted).max() < 1e-9
    assert max(float(command["before_mm"]) for command in commands) > 0.1


def test_a_missing_condition_is_reported_in_one_line(case, capsys):
    _, file, poses = case
    bare = poses.with_name("bare.csv")
    bare.write_text("\n".join(",".join(line.split(",")[:4]) for line in poses.read_text().splitlines()) + "\n")
    for command in (["path", str(bare)], ["compensate", str(bare)], ["pose", "--at-mm", "-100", "0", "-600"]):
        assert main([*command, "--model", str(file)]) == 2
        said = capsys.readouterr().err
        assert said.count("\n") == 1
        assert "give a column of that name beside the poses, or one value for all of them by --condition" in said


def test_an_option_that_takes_one_robot_for_all_poses_is_refused(case, capsys):
    _, file, poses = case
    for command in ("path", "compensate"):
        assert main([command, str(poses), "--model", str(file), "--at-once"]) == 2
        assert "--at-once uses the same robot at every pose" in capsys.readouterr().err


def test_a_condition_must_be_given_in_one_place_only(case, capsys):
    _, file, poses = case
    assert main(["path", str(poses), "--model", str(file), "--condition", "time_s=3"]) == 2
    assert "'time_s' is given by --condition and by a column; keep one" in capsys.readouterr().err
    assert main(["path", str(poses), "--model", str(file), "--condition", "time_s"]) == 2
    assert "--condition 'time_s': write NAME=VALUE" in capsys.readouterr().err
    assert main(["pose", "--at-mm", "-100", "0", "-600", "--condition", "time_s=3"]) == 2
    assert "nothing in the model depends on conditions: leave out --condition" in capsys.readouterr().err


def test_a_virtual_tracker_measures_it_under_the_conditions_of_its_plan(case, tmp_path):
    """Measured on the same robot without noise, in the same frames: the result is what ``path`` predicts."""
    _, file, _ = case
    robot = robot_of(RobotModel.load(file))
    plan = random_plan(robot, 8, 1)
    given = plan.given(robot.model.definition)
    standing = robots_under(robot, plan.poses, given)
    out = tmp_path / "measured.csv"
    table = tmp_path / "plan.csv"
    head = ["x_m", "y_m", "z_m", "tilt_rad", *given]
    rows = np.column_stack([plan.rows, *given.values()])
    np.savetxt(table, rows, delimiter=",", header=",".join(head), comments="", fmt="%.15g")
    frame = ["--tracker-frame", *"000000", "--target-frame", *"000000"]
    wanted = ["campaign", "simulate", "--plan", str(table), "--model", str(file), "--noise-mm", "0", "--out", str(out)]
    assert main([*wanted, *frame]) == 0
    measured = Campaign.read(out).position_m
    expected = [r.locate(p).actual.pose_base_to_end.translation for r, p in zip(standing, plan.poses, strict=True)]
    np.testing.assert_allclose(measured, expected, atol=1e-9)


SCALED = """format: pouring_robot/model/1
layout: paper
effects:
  - {{effect: metrology_scale, form: {0}, learned: by_hand, parameters: {{{1}}}}}
learned: {{by_hand: {{sessions: {{"1": 1}}, mean_span_m: [0, 0, 0, 0], reference_temperature_degC: 20}}}}
"""
SCALE = 'scale: {value: 300.0, unit: "1e-6"}'
BY_AIR = f"{SCALE}, scale_by_air: {{value: 20.0, unit: 1e-6/K}}"


@pytest.mark.parametrize(("form", "parameters", "by_air"), [("constant", SCALE, 0.0), ("air", BY_AIR, 20.0)])
def test_a_virtual_tracker_has_the_scale_of_its_model(tmp_path, capsys, form, parameters, by_air):
    """It acts from the tracker's own origin, here that of the fixed platform: in proportion to the position itself."""
    (tmp_path / "scaled.yaml").write_text(SCALED.format(form, parameters), encoding="utf-8")
    (tmp_path / "true.yaml").write_text("format: pouring_robot/model/1\nlayout: paper\n", encoding="utf-8")
    exact = ["--noise-mm", "0", "--noise-mrad", "0", "--tracker-frame", *"000000", "--target-frame", *"000000"]
    measured = []
    for name in ("scaled", "true"):
        out, model = tmp_path / f"by_{name}.csv", tmp_path / f"{name}.yaml"
        wanted = ["campaign", "simulate", "--random", "8", "--model", str(model), "--out", str(out)]
        assert main([*wanted, *exact]) == 0
        assert "does not move the robot" not in capsys.readouterr().out
        measured.append(Campaign.read(out))
    scaled, true = measured
    scale = 1e-6 * (300.0 + by_air * (true.conditions["ambient"] - 20.0))
    np.testing.assert_allclose(scaled.position_m, true.position_m * (1.0 + scale[:, None]), rtol=0.0, atol=2e-9)
    assert np.abs(scaled.position_m - true.position_m).max() > 1e-4
    np.testing.assert_allclose(scaled.rotation_vector_rad, true.rotation_vector_rad, atol=1e-9)


def test_a_diagnosis_finds_the_scale_of_a_virtual_tracker(tmp_path, capsys):
    (tmp_path / "scaled.yaml").write_text(SCALED.format("constant", SCALE), encoding="utf-8")
    out = tmp_path / "measured.csv"
    noise = ["--noise-mm", "0.01", "--noise-mrad", "0.01", "--seed", "2", "--out", str(out)]
    assert main(["campaign", "simulate", "--random", "80", "--model", str(tmp_path / "scaled.yaml"), *noise]) == 0
    (entry,) = amended(diagnose(out, RobotModel())).effects
    assert entry.effect == "metrology_scale"
    found = entry.parameters["scale"]
    assert abs(found.value - 300.0) < 3.0 * found.std < 60.0
