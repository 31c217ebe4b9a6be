"""The commands that know of heat: pose and path with a melt, compensate, thermal."""

import csv
import json
import re

import numpy as np
import pinocchio as pin
import pytest
from PIL import Image

from pouring_robot import __version__, sweep
from pouring_robot.compensation import path
from pouring_robot.report.plots import new_figure
from pouring_robot.robot.export.tree_at_closed_pose import configured
from pouring_robot.robot.heat_section import HeatSection
from pouring_robot.robot.pouring.platform_pose import PlatformPose
from pouring_robot.robot.pouring.thermal_properties import load_thermal_properties
from pouring_robot.robot.pouring_robot import PouringRobot
from pouring_robot.thermal.expansion.warm_pouring_robot import HeatedRobot
from tests.support import ACTUAL, ROOT

POSES = ROOT / "examples" / "poses.csv"
AT = ["--at-mm", "-100", "20", "-600", "--tilt-deg", "17"]
POSE = PlatformPose.from_mm_deg(-100.0, 20.0, -600.0, 17.0)
HEAT = "format: pouring_robot/model/1\nheat: {melt_degC: 1650, after_min: 45, measured_degC: {leg1: 210.5}}\n"
LEARNED = """format: pouring_robot/model/1
effects:
- effect: leg_thermal_expansion
  form: own_temperature
  learned: campaign
  parameters:
    expansion: {value: 5.0, std: 0.1, unit: 1e-6/K}
learned:
  campaign:
    ranges: {leg1_degC: [20, 200], leg2_degC: [20, 200], leg3_degC: [20, 200], leg4_degC: [20, 200]}
    sessions: {'1': 60}
    mean_span_m: [0.59455, 0.59463, 0.73764, -0.10723]
    reference_temperature_degC: 20.0
"""
SHIFT = (
    "time_min,melt_degC,ambient_degC,x_mm,y_mm,z_mm,tilt_deg\n0,1650,20,-100,0,-800,-20\n20,1680,20,-100,0,-800,-20\n"
    "30,1700,22,-60,20,-500,50\n60,400,22,-60,20,-500,50\n"
)


@pytest.fixture
def shift(tmp_path):
    path = tmp_path / "shift.csv"
    path.write_text(SHIFT, encoding="utf-8")
    return path


# --- pose and path ------------------------------------------------------------------------------------


@pytest.mark.parametrize("command", ["pose", "compensate"])
def test_heat_that_the_model_has_learned_and_that_the_melt_brings_is_not_counted_twice_in_silence(
    run, tmp_path, command
):
    model = tmp_path / "learned.yaml"
    model.write_text(LEARNED, encoding="utf-8")
    warm = [text for leg in (1, 2, 3, 4) for text in ("--condition", f"leg{leg}_degC=80")]
    code, out, err = run(command, *AT, "--model", model, *warm)
    assert (code, err) == (0, "")
    assert "twice" not in out
    said = "note: --condition ambient_degC changes nothing here"
    assert run(command, *AT, "--model", model, *warm, "--condition", "ambient_degC=5")[2].startswith(said)
    code, out, err = run(command, *AT, "--model", model, *warm, "--melt-degC", "1700", "--steady")
    assert (code, err) == (0, "")
    assert "heat counts twice: by the melt, and by leg_thermal_expansion" in out


def test_joints_of_a_warm_robot_say_by_how_much_the_cold_tree_misses_it(run, tmp_path):
    """Pinocchio's forward kinematics of the exported tree, against the lip that ``pose`` prints."""
    code, _, err = run("export", "--out", "tree", "--model", ACTUAL)
    assert (code, err) == (0, "")
    code, out, _ = run("pose", *AT, "--model", ACTUAL, "--melt-degC", "1700", "--json", "--joints", "warm.json")
    figures = json.loads(out)
    tree = pin.buildModelFromUrdf(str(tmp_path / "tree" / "pouring_robot.urdf"))
    (row,) = json.loads((tmp_path / "warm.json").read_text())["poses"]
    data = tree.createData()
    pin.framesForwardKinematics(tree, data, configured(tree, row["joints"]))
    base, lip = (data.oMf[tree.getFrameId(name)] for name in ("fixed_platform", "ladle_lip"))
    there = figures["frames"]["ladle_lip"]["actual_mm"]
    missed = float(np.linalg.norm(base.actInv(lip).translation * 1e3 - there))
    assert missed > 0.5
    assert any(f"is up to {missed:.3f} mm off" in note for note in figures["notes"])
    _, out, _ = run("pose", *AT, "--model", ACTUAL, "--json", "--joints", "cold.json")
    assert not any(" mm off" in note for note in json.loads(out)["notes"])


def test_joints_of_a_robot_under_conditions_say_by_how_much_the_tree_without_misses_it(run, tmp_path):
    """A leg's growth stands in its joint's value, as the exported tree knows of none: by one pose and by a path."""
    model, table = tmp_path / "learned.yaml", tmp_path / "poses.csv"
    model.write_text(LEARNED, encoding="utf-8")
    table.write_text("x_mm,y_mm,z_mm,tilt_deg\n-100,20,-600,17\n")
    warm = [text for leg in (1, 2, 3, 4) for text in ("--condition", f"leg{leg}_degC=80")]
    assert run("export", "--out", "tree", "--model", model)[0] == 0
    code, out, err = run("pose", *AT, "--model", model, *warm, "--json", "--joints", "pose.json")
    assert (code, err) == (0, "")
    code, told, err = run("path", table, "--model", model, *warm, "--joints", "path.json")
    assert (code, err, "is the drawing" in told) == (0, "", False)
    one, other = (
        json.loads((tmp_path / name).read_text())["poses"][0]["joints"] for name in ("pose.json", "path.json")
    )
    assert one == pytest.approx(other, abs=1e-12)
    tree = pin.buildModelFromUrdf(str(tmp_path / "tree" / "pouring_robot.urdf"))
    data, figures = tree.createData(), json.loads(out)
    pin.framesForwardKinematics(tree, data, configured(tree, one))
    base, lip = (data.oMf[tree.getFrameId(name)] for name in ("fixed_platform", "ladle_lip"))
    there = figures["frames"]["ladle_lip"]["actual_mm"]
    assert figures["frames"]["ladle_lip"]["error"]["distance_mm"] > 0.1
    assert base.actInv(lip).translation * 1e3 == pytest.approx(there, abs=1e-6)
    assert any("is up to 0.000 mm off" in note for note in figures["notes"])


def test_columns_of_conditions_that_change_nothing_are_told(run, tmp_path):
    table = tmp_path / "melt.csv"
    table.write_text("x_mm,y_mm,z_mm,tilt_deg,melt_degC,payload_kg\n-100,20,-600,17,1700,400\n")
    for command in ("path", "compensate"):
        code, _, err = run(command, table, "--model", ACTUAL)
        assert (code, "nothing in the model depends on melt_degC, payload_kg" in err) == (0, True)
    assert run("path", table, "--quiet")[2] == ""


@pytest.mark.parametrize(
    ("column", "warms"), [("melt_K", True), ("ambient_degC", True), ("leg1_degC", True), ("payload_kg", False)]
)
def test_columns_of_temperatures_say_what_warms_the_robot(run, tmp_path, column, warms):
    table = tmp_path / "warm.csv"
    table.write_text(f"x_mm,y_mm,z_mm,tilt_deg,{column}\n-100,20,-600,17,300\n")
    _, _, err = run("path", table)
    assert (f"depends on {column}" in err, "--ambient-degC warm the robot" in err) == (True, warms)


def test_no_melt_is_said_to_warm_a_robot_that_has_none(run, tmp_path):
    drives = "shoulder_pan_joint,shoulder_lift_joint,elbow_joint,wrist_1_joint,wrist_2_joint,wrist_3_joint"
    table = tmp_path / "warm.csv"
    table.write_text(f"{drives.replace(',', '_deg,')}_deg,ambient_degC\n10,-40,30,20,10,0,60\n")
    code, _, err = run("path", table, "--robot", ROOT / "examples" / "machines" / "ur10" / "robot.yaml")
    assert (code, "depends on ambient_degC" in err, "--ambient-degC" in err) == (0, True, False)


@pytest.mark.parametrize("more", [[], AT, ["--under", "heat"], ["--every-min", "5"]])
def test_a_robot_without_melt_is_asked_for_no_pose(run, more):
    code, _, err = run("thermal", "--robot", ROOT / "examples" / "robots" / "arm" / "robot.yaml", *more)
    assert code == 2 and "the pouring robot's melt, which arm does not have" in err


def test_a_leg_is_said_to_grow_by_what_the_closure_adds_to_it(run):
    """The closed robot's warm joint values less the commands."""
    code, out, err = run("thermal", *AT, "--json")
    assert (code, err) == (0, "")
    location = HeatedRobot(PouringRobot(), HeatSection()).locate(POSE).location
    for k in (1, 2, 3):
        added = location.actual.joint_values[f"leg{k}_s3"] - location.drives[f"leg{k}_s3"]
        assert json.loads(out)["parts"][f"leg{k}"]["growth_mm"] == pytest.approx(1e3 * added, rel=1e-9)


def test_a_warm_pose_as_json_says_what_the_library_says(run, as_built):
    code, out, err = run("pose", *AT, "--model", ACTUAL, "--melt-degC", "1700", "--json")
    assert (code, err) == (0, "")
    figures = json.loads(out)
    heated = HeatedRobot(as_built, HeatSection(melt_degC=1700.0))
    found = heated.locate(POSE)
    for frame, shares in heated.shares(found, ("moving_platform", "ladle_lip")).items():
        assert figures["frames"][frame]["error"]["translation_mm"] == pytest.approx(shares.together.translation_m * 1e3)
        for name in ("geometry", "heat", "together"):
            said = figures["shares"][frame][name]["translation_mm"]
            assert said == pytest.approx(getattr(shares, name).translation_m * 1e3, abs=1e-6)
        left = figures["shares"][frame]["not_the_sum_by"]
        assert left["distance_mm"] == pytest.approx(np.linalg.norm(shares.remainder.translation_m) * 1e3, abs=1e-6)
        assert left["distance_mm"] > 1e-3
    assert figures["heat"]["computed_degC"]["leg3"] == pytest.approx(found.field.leg_degC[2], abs=1e-6)
    assert figures["heat"]["after_min"] is None


def test_a_warm_pose_as_a_table(run):
    code, out, err = run("pose", *AT, "--model", ACTUAL, "--steady", "--ambient-degC", "30")
    assert (code, err) == (0, "")
    for words in ("geometry", "heat", "together", "not the sum by", "need not add up", "surroundings 30 degC, steady"):
        assert words in out
    assert max(map(len, out.splitlines())) <= 120


def test_without_flags_and_section_nothing_changes(run):
    _, cold, _ = run("pose", *AT, "--model", ACTUAL, "--json")
    assert "heat" not in json.loads(cold) and "shares" not in json.loads(cold)


def test_flags_go_over_the_model_file(run, tmp_path):
    (tmp_path / "hot.yaml").write_text(HEAT, encoding="utf-8")
    hot = ["pose", *AT, "--model", "hot.yaml", "--json"]
    as_told, changed = (json.loads(run(*hot, *more)[1])["heat"] for more in ([], ["--melt-degC", "1700", "--steady"]))
    assert (as_told["melt_degC"], as_told["after_min"]) == (pytest.approx(1650.0), 45.0)
    assert (as_told["measured_degC"], changed["measured_degC"]) == ({"leg1": 210.5}, {})
    assert as_told["leg_strain"][0] == pytest.approx(1.2e-5 * 190.5)
    assert (changed["melt_degC"], changed["after_min"]) == (pytest.approx(1700.0), None)
    assert "heat" not in json.loads(run(*hot, "--cold")[1])


@pytest.fixture
def two_poses(tmp_path):
    """A table of the first two poses: each is warmed for seconds."""
    table = tmp_path / "two.csv"
    table.write_text("".join(POSES.read_text(encoding="utf-8").splitlines(keepends=True)[:3]), encoding="utf-8")
    return table


def test_a_warm_path(run, as_built, two_poses):
    code, out, err = run("path", two_poses, "--model", ACTUAL, "--after-min", "30", "--json")
    assert (code, err) == (0, "")
    rows = json.loads(out)["poses"]
    heated = HeatedRobot(as_built, HeatSection(after_min=30.0))
    expected = heated.locate(PlatformPose.from_mm_deg(-100.0, 0.0, -600.0, 17.0)).location.difference("ladle_lip")
    said = rows[0]["frames"]["ladle_lip"]["error"]["translation_mm"]
    assert said == pytest.approx(expected.translation_m * 1e3, abs=1e-6)
    code, out, _ = run("path", two_poses, "--after-min", "30")
    assert code == 0 and "30 min after the melt came" in out


@pytest.mark.parametrize("command", ["pose", "compensate", "thermal"])
@pytest.mark.parametrize(
    ("flags", "says"),
    [
        (["--melt-degC", "-300"], "melt_degC: -300 degC lies below absolute zero"),
        (["--melt-degC", "-200"], "melt_degC: -200 degC is colder than any surroundings"),
        (["--melt-degC", "1e9"], "hotter than any melt"),
        (["--melt-degC", "nan"], "finite number"),
        (["--after-min", "0"], "0 min since the melt came is impossible"),
        (["--steady", "--after-min", "5"], "not both"),
        (["--melt-degC", "warm"], "--melt-degC"),
    ],
)
def test_nonsense_is_refused_in_one_line(run, command, flags, says):
    code, out, err = run(command, *AT, *flags)
    assert (code, out) == (2, "")
    assert says in err and err.count("\n") == 1


@pytest.mark.parametrize(
    ("flags", "says"),
    [
        (["--melt-degC", "1973"], "1973 degC is probably one at 1699.85 degC, given in kelvin"),
        (["--melt-degC", "-5"], "a melt at -5 degC is colder than the surroundings at 20 degC"),
        (["--melt-degC", "-5", "--ambient-degC", "-5"], ""),
        (["--melt-degC", "20"], ""),
        (["--melt-degC", "1800"], ""),
    ],
)
def test_a_melt_that_is_odd_is_told(run, flags, says):
    code, _, err = run("pose", *AT, *flags)
    assert (code, says in err, err.count("\n")) == (0, True, bool(says))


def test_cold_contradicts_the_other_flags(run):
    code, _, err = run("pose", *AT, "--cold", "--melt-degC", "1700")
    assert code == 2 and "--cold" in err and err.count("\n") == 1


# --- compensate ---------------------------------------------------------------------------------------


def test_compensate_one_pose(run):
    code, out, err = run("compensate", *AT, "--model", ACTUAL, "--melt-degC", "1700", "--json")
    assert (code, err) == (0, "")
    row = json.loads(out)["poses"][0]
    assert row["left"]["distance_mm"] < 1e-6 and abs(row["left"]["tilt_mrad"]) < 1e-6
    assert row["before"]["distance_mm"] > 1.0
    assert abs(row["uncontrolled_mrad"]["yaw"]) > 1e-3
    command = row["command"]
    at = ["--at-mm", *(repr(command[name]) for name in ("x_mm", "y_mm", "z_mm"))]
    at += ["--tilt-deg", repr(command["tilt_deg"])]
    _, out, _ = run("pose", *at, "--model", ACTUAL, "--melt-degC", "1700", "--json")
    frame = json.loads(out)["frames"]["moving_platform"]
    assert frame["actual_mm"] == pytest.approx([-100.0, 20.0, -600.0], abs=1e-6)


def test_a_path_at_once_says_what_pose_by_pose_says(run, tmp_path):
    singly = json.loads(run("path", POSES, "--model", ACTUAL, "--json")[1])["poses"]
    code, out, err = run("path", POSES, "--model", ACTUAL, "--at-once", "--json", "--joints", "joints.json")
    assert (code, err) == (0, "")
    for one, row in zip(singly, json.loads(out)["poses"], strict=True):
        shift = one["frames"]["ladle_lip"]["error"]["translation_mm"]
        assert [row[f"error_{a}_mm"] for a in "xyz"] == pytest.approx(shift, abs=1e-8)
    joints = json.loads((tmp_path / "joints.json").read_text(encoding="utf-8"))["poses"]
    assert run("path", POSES, "--model", ACTUAL, "--joints", "singly.json")[0] == 0
    for one, other in zip(json.loads((tmp_path / "singly.json").read_text())["poses"], joints, strict=True):
        assert other["joints"] == pytest.approx(one["joints"], abs=1e-10)


def test_compensate_at_once_and_as_a_header(run, tmp_path):
    assert run("compensate", POSES, "--model", ACTUAL, "--out", "singly.csv")[0] == 0
    code, out, _ = run("compensate", POSES, "--model", ACTUAL, "--at-once", "--out", "at_once.csv")
    assert code == 0 and "5 of 5 poses" in out
    one, other = (list(csv.DictReader((tmp_path / name).open())) for name in ("singly.csv", "at_once.csv"))
    for row, same in zip(one, other, strict=True):
        assert all(
            float(row[k]) == pytest.approx(float(same[k]), abs=1e-9) for k in ("q1_mm", "q2_mm", "q3_mm", "q4_rad")
        )
    assert run("compensate", "--model", ACTUAL, "--header", "c.h")[0] == 0
    header = (tmp_path / "c.h").read_text(encoding="utf-8")
    assert "pouring_robot_compensate" in header
    for words in ("Robot: layout paper, model file", "actual.yaml.", "Heat: none, the robot is at the temperature"):
        assert words in header
    for wrong in (["--at-once"], [POSES, "--header", "d.h"]):
        assert run("compensate", *wrong)[0] == 2


def test_help_says_how_warm_what_is_not_said_is(run):
    shipped = load_thermal_properties()
    help_page = " ".join(run("pose", "--help")[1].split())
    for what, entry in (("melt", shipped.melt), ("surroundings", shipped.ambient)):
        assert f"Temperature of the {what} (default: the model file's or {entry.temperature.value:g})" in help_page


def test_a_header_and_the_terminal_say_which_robot_and_heat_they_are_for(run, tmp_path, monkeypatch):
    for name, few in {"POINTS": (2, 2, 2, 2), "_CLIMBS": 0}.items():  # how good it is, is another test's
        monkeypatch.setattr(path, name, few)
    model = tmp_path / "of*" / "hot.yaml"
    model.parent.mkdir()
    model.write_text(HEAT, encoding="utf-8")
    heat = "melt 1700, surroundings 60 degC, 45 min after the melt came; measured instead: leg1 210.5 degC"
    warm = ("--melt-degC", "1700", "--ambient-degC", "60")
    assert f"heat: {heat}" in run("compensate", "--model", "of*/hot.yaml", *warm, "--header", "hot.h")[1]
    header = (tmp_path / "hot.h").read_text(encoding="utf-8")
    for words in ("model file of* /hot.yaml.", f"Heat: {heat}.", f"Made by pouring_robot {__version__}."):
        assert words in header
    out = run("compensate", POSES, "--at-once", "--melt-degC", "1650")[1]
    assert "heat: melt 1650, surroundings 20 degC, steady" in out


def test_compensate_a_path_into_a_file(run, tmp_path, two_poses):
    out_file = tmp_path / "commands.csv"
    code, out, err = run("compensate", two_poses, "--model", ACTUAL, "--after-min", "40", "--out", out_file)
    assert (code, err) == (0, "")
    rows = list(csv.DictReader(out_file.open(encoding="utf-8")))
    assert len(rows) == 2
    for row in rows:
        assert float(row["left_mm"]) < 1e-6
        assert float(row["before_mm"]) > 1.0
    for words in ("without compensation", "the drives cannot correct roll", "recomputed", "wrote"):
        assert words in out
    assert max(map(len, out.splitlines())) <= 120


def test_compensate_puts_the_lip_right(run):
    _, out, _ = run("compensate", *AT, "--model", ACTUAL, "--steady", "--frame", "ladle_lip", "--json")
    row = json.loads(out)["poses"][0]
    assert row["left_at_lip"]["distance_mm"] < 1e-6


def test_no_figure_is_minus_zero(run):
    _, out, _ = run("compensate", "--at-mm", "-100", "-0.01", "-625", "--tilt-deg", "-0.01")
    cells = out.split()
    assert cells.count("0.0") == 2  # y and tilt of the wanted pose
    assert not [cell for cell in cells if re.fullmatch(r"-0\.0*", cell)]


@pytest.mark.parametrize("sign", [1, -1])
def test_no_mean_of_a_regression_is_minus_zero(run, tmp_path, sign):
    rows = [[melt, *(sign * k * (melt - 20) / 7000 for k in (1, 2, 4, 5))] for melt in range(1500, 1720, 20)]
    lines = [",".join(map(str, row)) for row in [["melt_degC", "P1_mm", "P2_mm", "P3_mm", "P4_mm"], *rows]]
    (tmp_path / "sets.csv").write_text("\n".join(lines))
    code, out, _ = run("regress", str(tmp_path / "sets.csv"), "--axis", "x")
    assert code == 0 and not [cell for cell in out.split() if re.fullmatch(r"-0\.0*", cell)]


def test_compensate_says_that_the_cold_drawing_needs_none(run):
    code, out, _ = run("compensate", *AT)
    assert code == 0 and "needs no compensation" in out


@pytest.mark.parametrize(
    ("arguments", "code", "says"),
    [
        ([], 2, "give either a file of poses or one command by options"),
        ([POSES, *AT], 2, "either a file of poses"),
        ([POSES, "--tilt-deg", "3"], 2, "either a file of poses"),
        (["nowhere.csv"], 2, "cannot be read"),
        ([*AT, "--frame", "lip"], 2, "no frame 'lip'"),
        ([*AT, "--out", "missing/c.csv"], 2, "does not exist"),
        (["--at-mm", "nan", "0", "0"], 2, "finite"),
        (["--at-mm", "0", "0", "5000"], 3, "out of reach"),
        (["--at-mm", "1e9", "0", "0", "--steady"], 3, "out of reach"),
        (["--at-mm", "-100", "0", "-600", "--tilt-deg", "170", "--steady"], 3, "out of reach"),
    ],
)
def test_compensate_refuses_in_one_line(run, arguments, code, says):
    got, out, err = run("compensate", *arguments)
    assert (got, out) == (code, "")
    assert says in err and err.count("\n") == 1


def test_an_unreachable_pose_of_a_path_is_named_and_nothing_is_written(run, tmp_path):
    (tmp_path / "far.csv").write_text("x_mm,y_mm,z_mm,tilt_deg\n-100,0,-600,0\n-100,0,-6000,0\n", encoding="utf-8")
    code, out, err = run("compensate", "far.csv", "--steady", "--out", "c.csv")
    assert (code, out) == (3, "")
    assert "far.csv: line 3: " in err and err.count("\n") == 1
    assert not (tmp_path / "c.csv").exists()


# --- thermal ------------------------------------------------------------------------------------------


def test_thermal_at_a_pose(run, tmp_path, drawing):
    code, out, err = run("thermal", *AT, "--csv", "t.csv", "--png", "t.png")
    assert (code, err) == (0, "")
    for words in ("steady", "leg4", "ladle_lip", "from the melt", "bending"):
        assert words in out
    rows = list(csv.DictReader((tmp_path / "t.csv").open(encoding="utf-8")))
    field = HeatedRobot(drawing, HeatSection()).locate(POSE).field
    legs = [float(row["temperature_degC"]) for row in rows if row["part"].startswith("leg")]
    assert legs == pytest.approx(field.leg_elements_degC.ravel().tolist(), abs=1e-4)
    assert Image.open(tmp_path / "t.png").width > 800


def test_thermal_leaves_geometry_out_and_json_balances(run):
    _, with_model, _ = run("thermal", *AT, "--model", ACTUAL, "--json")
    _, without, _ = run("thermal", *AT, "--json")
    assert json.loads(with_model)["moved"] == json.loads(without)["moved"]
    heat = json.loads(without)["heat_W"]
    gained = heat["from_melt_by_contact"] + heat["from_melt_by_radiation"]
    assert abs(heat["stored"]) < 1e-9 * gained


def test_a_robot_that_cools_stores_less_than_nothing(run):
    _, out, _ = run("thermal", *AT, "--melt-degC", "-50", "--ambient-degC", "30", "--after-min", "30")
    words = " ".join(out.split())
    gained, lost, stored = (
        float(re.search(what, words)[1]) for what in (r"(\S+) kW from", r"(\S+) kW to", r"(\S+) kW st")
    )
    assert stored == pytest.approx(gained - lost, abs=0.02) and stored < -0.05


def test_conduction_alone_is_cold(run):
    _, out, _ = run("thermal", *AT, "--conduction-only", "--json")
    assert json.loads(out)["parts"]["leg3"]["mean_degC"] < 30.0


def test_a_shift_with_changing_poses(run, tmp_path, shift):
    code, out, err = run("thermal", "--history", shift, "--every-min", "10", "--csv", "s.csv", "--png", "s.png")
    assert (code, err) == (0, "")
    rows = list(csv.DictReader((tmp_path / "s.csv").open(encoding="utf-8")))
    assert [float(row["time_min"]) for row in rows] == [0, 10, 20, 30, 40, 50, 60]
    assert [float(row["z_mm"]) for row in rows] == [-800, -800, -800, -500, -500, -500, -500]
    first, last = rows[0], rows[-1]
    assert float(first["leg1_degC"]) == pytest.approx(20.0) and float(first["moving_platform_moved_mm"]) < 1e-9
    assert float(last["leg1_degC"]) > 50.0
    assert Image.open(tmp_path / "s.png").height > 600
    assert max(map(len, out.splitlines())) <= 120


def test_a_pose_of_a_shift_that_is_out_of_reach_is_told_by_its_line(run, tmp_path):
    (tmp_path / "h.csv").write_text(f"{SHIFT}70,400,22,-60,20,-5000,50\n", encoding="utf-8")
    code, out, err = run("thermal", "--history", "h.csv")
    assert (code, out) == (3, "")
    assert "h.csv: line 6: the pose is out of reach" in err and err.count("\n") == 1


def test_a_shift_at_one_pose_is_that_of_after_min(run, tmp_path):
    (tmp_path / "h.csv").write_text("time_min,melt_degC\n0,1700\n30,1700\n", encoding="utf-8")
    _, out, _ = run("thermal", "--history", "h.csv", *AT, "--json")
    shift = json.loads(out)["rows"][-1]
    _, out, _ = run("thermal", *AT, "--after-min", "30", "--json")
    pose = json.loads(out)
    # A shift takes temperatures at the commanded pose, a pose where the ladle is: some tenths of a kelvin.
    assert shift["leg3_degC"] == pytest.approx(pose["parts"]["leg3"]["mean_degC"], abs=3.0)
    assert shift["moving_platform_moved_mm"] == pytest.approx(pose["moved"]["moving_platform"]["distance_mm"], rel=0.05)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("time_min,melt_degC\n0,1700\n30,1700\n20,1700\n", "line 4, column time_min: is not later than"),
        ("time_min,melt_degC\n0,1700\n30,-1700\n", "line 3, column melt_degC: -1700 degC lies below"),
        ("time_min,melt_degC\n0,1700\n30,1e9\n", "line 3, column melt_degC: 1e+09 degC is hotter"),
        ("time_s,melt_degC\n1.7e9,1700\n1e300,1700\n", "line 3, column time_s: 1e+300 is larger than any quantity"),
        ("time_min,melt_degC\n0,1700\n30,\n", "line 3, column melt_degC: '' is not a finite number"),
        ("time_min,melt_degC\n0,1700\n30,1700,5\n", "line 3: 3 cells"),
        ("time_min,melt\n0,1700\n", "write melt_degC"),
        ("time_min,melt_degC,x_mm\n0,1700,1\n2,1700,1\n", "column 'y_mm' is missing"),
        (SHIFT, "leave --at-mm out"),
        ("", "line 1"),
    ],
)
def test_a_wrong_history_is_refused_in_one_line(run, tmp_path, text, says):
    (tmp_path / "h.csv").write_text(text, encoding="utf-8")
    code, out, err = run("thermal", "--history", "h.csv", *AT, "--png", "h.png")
    assert (code, out) == (2, "")
    assert says in err and err.count("\n") == 1
    assert not (tmp_path / "h.png").exists()


@pytest.mark.parametrize(
    ("arguments", "code", "says"),
    [
        ([], 2, "give the pose: --at-mm"),
        (["--tilt-deg", "3"], 2, "give its position by --at-mm"),
        ([*AT, "--every-min", "3"], 2, "give the shift by --history"),
        (["--history", "shift.csv", "--every-min", "0"], 2, "--every-min 0"),
        (["--history", "shift.csv", "--steady"], 2, "leave out --melt-degC"),
        (["--history", "shift.csv", *AT, "--under", "heat"], 2, "and no --history"),
        (["--history", "nowhere.csv"], 2, "cannot be read"),
        (["--at-mm", "0", "0", "0"], 3, "out of reach"),
    ],
)
def test_thermal_refuses_in_one_line(run, shift, arguments, code, says):
    got, out, err = run("thermal", *arguments)
    assert (got, out) == (code, "")
    assert says in err and err.count("\n") == 1


def test_commands_that_take_the_robot_cold_say_so(run, tmp_path):
    (tmp_path / "hot.yaml").write_text(HEAT, encoding="utf-8")
    code, out, err = run("robots", "--model", "hot.yaml", "--json")
    assert code == 0 and json.loads(out)
    assert "heat section of hot.yaml is left out" in err and err.count("\n") == 1


def test_a_sweep_over_a_warm_model_says_that_it_takes_it_cold(run, tmp_path):
    (tmp_path / "hot.yaml").write_text(HEAT, encoding="utf-8")
    (tmp_path / "sweep.yaml").write_text(
        "format: pouring_robot/sweep/1\nmodel: hot.yaml\nstudy: one_at_a_time\nposes: {random: {count: 1, seed: 1}}\n"
        "errors: [{parameters: drive.leg4_s5, distribution: normal, std_mrad: 0.1}]\n",
        encoding="utf-8",
    )
    code, _, err = run("sweep", "sweep.yaml", "--out", "swept")
    assert code == 0 and err == "note: this command uses the cold robot; the heat section of hot.yaml is left out\n"
    with pytest.warns(UserWarning, match="heat section of hot.yaml is left out"):
        sweep("sweep.yaml", "again")


def test_the_picture_of_a_warm_robot_says_so(run, monkeypatch):
    drawn = []
    monkeypatch.setattr("pouring_robot.viewer.picture.png", lambda scene: drawn.append(scene) or b"")
    for flags in (["--steady"], []):
        assert run("pose", *AT, *flags, "--png", "x.png", "--overwrite")[0] == 0
    assert [scene.robots[0].label for scene in drawn] == ["as built, warm", "as built"]


def test_poses_of_a_list_are_said_to_be_taken_by_themselves(run, tmp_path):
    (tmp_path / "two.csv").write_text("x_mm,y_mm,z_mm,tilt_deg\n-100,0,-600,0\n-100,10,-600,0\n", encoding="utf-8")
    for command in ("path", "compensate"):
        code, out, _ = run(command, "two.csv", "--after-min", "20")
        assert code == 0 and "each pose is computed on its own, from cold and held 20 min" in " ".join(out.split())


def test_figures_too_small_to_show_have_no_sign(run):
    for command in ("thermal", "pose"):
        code, out, _ = run(command, *AT, "--steady")
        assert code == 0 and "-0.000" not in out
    assert "0.00 kW stored" in " ".join(run("thermal", *AT)[1].split())


def test_what_was_measured_at_one_moment_takes_no_part_in_a_shift(run, tmp_path):
    (tmp_path / "h.csv").write_text("time_min,melt_degC\n0,1650\n30,1650\n", encoding="utf-8")
    (tmp_path / "hot.yaml").write_text(HEAT, encoding="utf-8")
    told, bare = (
        json.loads(run("thermal", "--history", "h.csv", *AT, *model, "--json")[1])
        for model in (["--model", "hot.yaml"], [])
    )
    assert told["rows"][0]["ladle_lip_moved_mm"] < 1e-9  # as cold as the drawing
    assert told["rows"] == bare["rows"] and "measured_degC" not in told
    note = "measured temperatures of the model file are of one moment and not used in a shift: leg1 210.5 degC"
    assert (told["notes"], bare["notes"]) == ([note], [])
    assert note in " ".join(run("thermal", "--history", "h.csv", *AT, "--model", "hot.yaml")[1].split())
    held = json.loads(run("thermal", *AT, "--model", "hot.yaml", "--json")[1])
    assert held["measured_degC"] == {"leg1": 210.5} and "replace computed ones" in held["notes"][0]


def test_what_was_measured_at_one_moment_takes_no_part_at_another(run, tmp_path):
    (tmp_path / "hot.yaml").write_text(HEAT, encoding="utf-8")
    (tmp_path / "bare.yaml").write_text(HEAT.replace("{leg1: 210.5}", "{}"), encoding="utf-8")
    note = "note: measured temperatures of the model file are of another time and not used: leg1\n"
    for command in ("pose", "compensate", "thermal"):
        told, bare = (run(command, *AT, "--model", m, "--after-min", "1", "--json") for m in ("hot.yaml", "bare.yaml"))
        assert json.loads(told[1]) == json.loads(bare[1])
        assert (told[2], bare[2]) == (note, "")
    assert run("pose", *AT, "--model", "hot.yaml", "--after-min", "45", "--json")[2] == ""


def test_the_picture_of_a_shift_shows_curves_between_the_rows(run, tmp_path, monkeypatch):
    (tmp_path / "h.csv").write_text("time_min,melt_degC\n0,1700\n60,1700\n", encoding="utf-8")
    drawn = []
    figure = new_figure(1.0, 1.0)
    figure.subplots()
    monkeypatch.setattr("pouring_robot.thermal.page.shift_picture", lambda shift, _: drawn.append(shift) or figure)
    code, out, _ = run("thermal", "--history", "h.csv", *AT, "--png", "x.png", "--report", "x.html", "--json")
    assert "<svg" in (tmp_path / "x.html").read_text(encoding="utf-8")
    rows, picture = json.loads(out)["rows"], drawn[0]
    assert code == 0 and [row["time_min"] for row in rows] == [0.0, 60.0]
    halfway = float(np.interp(1800.0, picture.times_s, picture.to_frame()["leg1_degC"]))
    assert halfway > 20.0 + 0.7 * (rows[-1]["leg1_degC"] - 20.0)  # a straight line would be at half


def test_room_temperature_in_kelvin_is_refused(run, tmp_path):
    code, _, err = run("pose", *AT, "--ambient-degC", "293")
    assert code == 2 and "hotter than any surroundings" in err and err.count("\n") == 1
    (tmp_path / "h.csv").write_text("time_min,melt_degC,ambient_degC\n0,1700,20\n60,1700,293\n", encoding="utf-8")
    code, _, err = run("thermal", "--history", "h.csv", *AT)
    assert code == 2 and "line 3, column ambient_degC: 293 degC" in err


# --- a thermal model of a regression -----------------------------------------------------------------


@pytest.fixture
def thermal_model(tmp_path):
    """A law near what heat does at POSE and 1700 degC."""
    from pouring_robot.thermal.regression.thermal_model import ThermalModel

    axes = {
        "x": {"method": "mean", "coefficients": [[-3e-4], [-4e-7]]},
        "z": {"method": "mean", "coefficients": [[-1e-3], [-2e-6]]},
    }
    content = {"source": "t.csv", "temperature_degC": 1150.0, "melt_degC": [600.0, 1700.0], "axes": axes}
    return ThermalModel.model_validate(content).save(tmp_path / "law.yaml")


def test_the_papers_sum_beside_the_full_closure(run, as_built, thermal_model):
    code, out, err = run("pose", *AT, "--model", ACTUAL, "--thermal-model", str(thermal_model), "--json")
    assert (code, err) == (0, "")
    parts = {name: np.array(shift) for name, shift in json.loads(out)["paper_sum_mm"].items()}
    np.testing.assert_allclose(parts["theory"], [-100.0, 20.0, -600.0])
    np.testing.assert_allclose(parts["heat"], [-0.3 - 4e-4 * 550.0, 0.0, -1.0 - 2e-3 * 550.0], atol=1e-9)
    geometry = as_built.locate(POSE).difference("moving_platform").translation_m
    np.testing.assert_allclose(parts["geometry"], geometry * 1e3, atol=1e-9)
    np.testing.assert_allclose(parts["sum"], parts["theory"] + parts["geometry"] + parts["heat"])
    warm = HeatedRobot(as_built, HeatSection()).locate(POSE).location.difference("moving_platform").translation_m
    np.testing.assert_allclose(parts["full_closure"], parts["theory"] + warm * 1e3, atol=1e-6)
    code, out, err = run("pose", *AT, "--thermal-model", str(thermal_model), "--melt-degC", "1750")
    assert (
        code == 0
        and "sum misses by" in out
        and "BEYOND the fitted range: melt 1750 degC (600 to 1700)" in " ".join(out.split())
    )


def test_compensation_by_a_thermal_model(run, thermal_model):
    """The drives are those of the cold robot sent the other way; what is left is the full closure's."""
    code, out, err = run("compensate", *AT, "--model", ACTUAL, "--thermal-model", str(thermal_model), "--json")
    assert (code, err) == (0, "")
    by_law = json.loads(out)["poses"][0]
    shifted = ["--at-mm", str(-100.0 + 0.52), "20", str(-600.0 + 2.1), "--tilt-deg", "17"]
    cold = json.loads(run("compensate", *shifted, "--model", ACTUAL, "--json")[1])["poses"][0]
    assert by_law["drives"] == pytest.approx(cold["drives"], abs=1e-6)
    assert by_law["left"]["distance_mm"] < 0.5 * by_law["before"]["distance_mm"]
    assert by_law["left"]["distance_mm"] > 1e-3


def test_a_thermal_model_that_does_not_fit_is_refused(run, thermal_model):
    thermal_model.write_text(thermal_model.read_text().replace("inputs: []", "inputs: [q1]"), encoding="utf-8")
    code, _, err = run("pose", *AT, "--thermal-model", str(thermal_model))
    assert code == 2 and "centre needs one number" in err
    assert run("pose", *AT, "--thermal-model", "/nowhere.yaml")[0] == 2
    thermal_model.write_text(thermal_model.read_text().replace("centre: []", "centre: [0.5]"), encoding="utf-8")
    for command in ("pose", "compensate"):
        code, out, err = run(command, *AT, "--thermal-model", str(thermal_model))
        assert (code, out) == (2, "") and "depends on q1, but a pose gives x, y, z, tilt; repeat the regression" in err
