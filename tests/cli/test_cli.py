"""The command line: what it prints, what it writes, and one clear line when something is wrong."""

import contextlib
import json
import os
import re
import signal
import socket
import subprocess
import sys
import termios
import textwrap
import time
import urllib.request

import numpy as np
import pinocchio as pin
import psutil
import pytest

import pouring_robot
from pouring_robot.cli.shared.progress import stage_bars
from pouring_robot.cli.shared.tables import print_lines, print_table
from pouring_robot.exceptions import SingularPoseError
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.closure.solver import ClosureSolver
from pouring_robot.mechanism.loops_file import load_loops
from pouring_robot.robot.command_table import read_poses
from pouring_robot.robot.pouring.layout import shipped_layouts_file
from pouring_robot.robot.pouring.platform_pose import PlatformPose
from pouring_robot.robot.pouring_robot import PouringRobot
from tests.support import ACTUAL, ROOT, pose_gap

POSES = ROOT / "examples" / "poses.csv"
AT = ["--at-mm", "-100", "20", "-600", "--tilt-deg", "17"]
WORKSPACE = "the workspace is x_mm -150 to -50, y_mm -50 to 50, z_mm -825 to -425, tilt_deg "  # the paper's


# --- what it says -------------------------------------------------------------------------------------


def test_pose_as_json_says_what_the_library_says(run, as_built):
    code, out, err = run("pose", *AT, "--model", ACTUAL, "--json")
    assert (code, err) == (0, "")
    figures = json.loads(out)
    location = as_built.locate(PlatformPose.from_mm_deg(-100.0, 20.0, -600.0, 17.0))
    for frame in ("moving_platform", "ladle", "ladle_lip"):
        nominal, actual = location.poses(frame)
        assert figures["frames"][frame]["nominal_mm"] == pytest.approx(nominal.translation * 1e3, abs=1e-9)
        assert figures["frames"][frame]["actual_mm"] == pytest.approx(actual.translation * 1e3, abs=1e-9)
    assert figures["drives"]["leg1_s3_mm"] == pytest.approx(location.drives["leg1_s3"] * 1e3, abs=1e-9)
    assert figures["layout"] == "paper"
    assert figures["written"] == []


def test_pose_without_a_model_is_the_drawing(run):
    code, out, _ = run("pose", "--at-mm", "-100", "20", "-600", "--tilt-deg", str(np.degrees(0.3)), "--json")
    figures = json.loads(out)
    assert code == 0
    # Closed form, by hand: l = |p + R_y(r) B − A|, and θ46 = r − ψ4.
    assert figures["drives"]["leg1_s3_mm"] == pytest.approx(550.5232, abs=5e-5)
    assert figures["drives"]["leg4_s5_deg"] == pytest.approx(np.degrees(-0.0858709), abs=5e-6)
    assert figures["frames"]["moving_platform"]["actual_mm"] == pytest.approx([-100.0, 20.0, -600.0], abs=1e-9)
    assert figures["closure"]["rank_actual"] == 22


def test_pose_as_a_table(run, as_built):
    code, out, err = run("pose", *AT, "--model", ACTUAL)
    assert (code, err) == (0, "")
    location = as_built.locate(PlatformPose.from_mm_deg(-100.0, 20.0, -600.0, 17.0))
    _, lip = location.poses("ladle_lip")
    for value in lip.translation * 1e3:
        assert f"{value:.3f}" in out
    assert "rank 22 nominal, 24 as built" in out
    assert f"{location.drives['leg1_s3'] * 1e3:.4f} mm" in out
    assert f"leg4_s5 {np.degrees(location.drives['leg4_s5']):.5f} deg" in out  # the unit of the JSON output
    torque = np.linalg.norm(location.actual.internal_wrench[:, 3:], axis=1).max()
    assert f" N and {torque:.1f} Nm in a chain" in out
    weakness = as_built.axis_weakness(location)
    assert f"sideways: {weakness.m_per_rad:.1f} mm at the lip per mrad of axis tilt" in out
    assert max(map(len, out.splitlines())) <= 120


def test_pose_as_json_holds_load_and_weakness(run, as_built):
    figures = json.loads(run("pose", *AT, "--model", ACTUAL, "--json")[1])
    location = as_built.locate(PlatformPose.from_mm_deg(-100.0, 20.0, -600.0, 17.0))
    load = figures["closure"]["internal_load"]
    wrench = location.actual.internal_wrench
    assert load["torque_Nm"] == pytest.approx(np.linalg.norm(wrench[:, 3:], axis=1).max(), rel=1e-6)
    assert load["torque_Nm"] > 1.0
    for i in range(4):
        assert load["loops"][f"chain_{i + 1}"]["torque_Nm"] == pytest.approx(wrench[i, 3:], rel=1e-5, abs=1e-6)
    weakness = as_built.axis_weakness(location)
    assert figures["sideways"] == {"mm_per_mrad": pytest.approx(weakness.m_per_rad), "axis_tilt": weakness.parameter}
    assert figures["notes"] == []


@pytest.mark.parametrize(
    ("text", "words", "absent"),
    [
        (None, "no model file was given", "holds no errors"),
        ("layout: paper\n", "the model file holds no errors", "no model file"),
        ("joint_placements: {leg1_s1: {}}\n", "the model file holds no errors", "no model file"),
        ("drive_offsets: {leg1_s3: {offset_mm: 1.0}}\n", "", "is the drawing"),
        ("joint_placements: {truss_travel: {translation_mm: [1, 2, 3]}}\n", "displacing 'truss_travel'", "the drawing"),
        ("joint_placements: {trolley_travel: {rotation_mrad: [1, 0, 0]}}\n", "displacing 'trolley_travel'", "drawing"),
    ],
)
def test_notes_say_what_the_model_does_not_change(run, tmp_path, text, words, absent):
    model = ["--model", tmp_path / "model.yaml"] if text else []
    if text:
        (tmp_path / "model.yaml").write_text(text)
    for command in (["pose", *AT], ["path", POSES]):
        code, out, err = run(*command, *model)
        assert (code, err) == (0, "")
        assert words in out
        assert absent not in out
        notes = json.loads(run(*command, *model, "--json")[1])["notes"]
        assert len(notes) == (1 if words else 0)
        assert all(words in note for note in notes)


@pytest.mark.parametrize(
    ("said", "noted"), [("layout: paper\n", False), ("heat: {melt_degC: 1650}\n", True), (None, True)]
)
def test_sensitivity_says_that_it_leaves_out_what_a_model_says_of_the_robot_as_built(run, tmp_path, said, noted):
    (tmp_path / "model.yaml").write_text(said or ACTUAL.read_text(encoding="utf-8"))
    code, _, err = run("sensitivity", "--poses", 5, "--model", "model.yaml")
    assert (code, "of model.yaml are left out" in err) == (0, noted)


def test_a_picture_of_another_ladle_is_noted(run, tmp_path):
    text = shipped_layouts_file().read_text(encoding="utf-8")
    start = text.index("    height:", text.index("  ladle:"))
    line = text[start : text.index("\n", start)]
    assert "value: " in line
    value = float(line.split("value: ")[1].split(",")[0])
    larger = line.replace(line.split("value: ")[1].split(",")[0], str(value * 1.2))
    (tmp_path / "mine.yaml").write_text(text.replace(line, larger, 1), encoding="utf-8")
    (tmp_path / "model.yaml").write_text("layouts_file: mine.yaml\n")
    model = ["--model", tmp_path / "model.yaml"]
    assert "make_meshes" not in run("pose", *AT, *model)[1]  # no picture, no matter
    noted = run("pose", *AT, *model, "--html", "view.html")[1]
    assert f"ladle.stl, which is {0.2 * value:.0f} mm off" in noted.replace("\n", " ")
    assert "ladle.stl" not in run("pose", *AT, "--html", "view.html")[1]
    assert "note: the ladle is drawn" in run("export", "--out", "robot", *model)[1]


def test_a_terminal_sees_how_far_a_path_is(run, monkeypatch):
    monkeypatch.setenv("FORCE_COLOR", "1")
    code, out, err = run("path", POSES, "--json")
    assert code == 0
    assert "closing" in err
    assert "5/5" in err
    assert len(json.loads(out)["poses"]) == 5


def test_the_time_goes_on_between_steps_while_work_can_be_copied_to_another_core():
    code = """
        import os, signal, time
        from pouring_robot.cli.shared.progress import stage_bars
        from pouring_robot.io.background_process import forked
        with stage_bars() as show:
            show("searching", 0, 0)
            with forked(os.getpid) as pid:
                copied = pid() != os.getpid()
            end = time.monotonic() + 1.6
            while time.monotonic() < end:
                pass
        print(copied, signal.getitimer(signal.ITIMER_REAL)[0], signal.getsignal(signal.SIGALRM) == signal.SIG_DFL)
    """
    command = [sys.executable, "-c", textwrap.dedent(code)]
    terminal = os.environ | {"FORCE_COLOR": "1", "COLUMNS": "80"}
    there = subprocess.run(command, env=terminal, capture_output=True, text=True, check=False, timeout=60)
    assert there.stdout == "True 0.0 True\n", there.stderr
    assert "0:00:01" in there.stderr


def test_a_terminal_that_is_held_with_ctrl_s_holds_the_work_and_no_more():
    code = """
        import time
        from pouring_robot.cli.shared.progress import stage_bars
        with stage_bars() as show:
            show("searching", 0, 0)
            end = time.monotonic() + 2.0
            while time.monotonic() < end:
                pass
        print("done")
    """
    ours, theirs = os.openpty()
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    command = [sys.executable, "-c", textwrap.dedent(code)]
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=theirs, text=True) as there:
        shown = b""
        while b"searching" not in shown:
            shown += os.read(ours, 4096)
        termios.tcflow(theirs, termios.TCOOFF)
        time.sleep(1.0)
        termios.tcflow(theirs, termios.TCOON)
        assert there.communicate(timeout=60)[0] == "done\n"
    os.close(theirs)
    with contextlib.suppress(OSError), os.fdopen(ours, "rb", buffering=0) as screen:
        while more := screen.read(4096):
            shown += more
    assert shown.count(b"searching") <= 9


def test_a_bar_stays_in_one_line_with_room_for_a_ctrl_c_and_shows_one_unfinished_stage(monkeypatch, capsys):
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "60")
    with stage_bars() as show:
        for stage, done in (("searching for effects", 0), ("holding out each block in turn", 0), ("searching for", 0)):
            show(stage, done, 0)
        time.sleep(1.2)
        show("holding out each block in turn", 3, 10)
        time.sleep(0.6)
        show("sweep", 14, 163)  # gone on with
        time.sleep(1.0)
        show("sweep", 15, 163)
        time.sleep(0.6)
    frames = re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", capsys.readouterr().err).split("\r")
    assert max(len(frame.strip("\n")) for frame in frames) <= 60 - len("^C^C")
    assert any(re.search("^holding out each bloc.* 3/10 0:00:0[1-3] about 0:0[2-9] left$", frame) for frame in frames)
    assert any(re.search("^sweep .* 15/163 0:00:0[1-3] about [2-7]:[0-9]{2} left$", frame) for frame in frames)


def test_a_cursor_is_not_hidden_and_where_it_cannot_be_moved_there_is_no_bar(run, monkeypatch):
    monkeypatch.setenv("FORCE_COLOR", "1")
    bars = run("path", POSES, "--model", ACTUAL)[2]
    assert "closing" in bars and "\x1b[?25l" not in bars
    monkeypatch.setenv("TERM", "dumb")
    assert run("path", POSES, "--model", ACTUAL)[2] == ""


def test_a_terminal_of_80_columns_breaks_between_words_and_never_within_a_figure(run, monkeypatch):
    piped = [run(*command)[1] for command in (["robots"], ["path", POSES])]
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("NO_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "80")
    shown = [re.sub(r"\x1b\[[0-9;]*m", "", run(*command)[1]) for command in (["robots"], ["path", POSES])]
    for there, here in zip(piped, shown, strict=True):
        assert max(map(len, here.splitlines())) <= 80
        assert here.split() == there.split()
    assert "  20 chain joints, 24 closure equations of rank 22: 4 freedoms (2 equations\n  redundant)\n" in shown[0]


def test_a_table_folds_between_words_where_that_makes_it_fit_a_terminal_and_else_between_columns(capsys, monkeypatch):
    def printed(columns, head=("part", "off by mm"), row=("places of the lower U joints", "123456.789"), left=(0,)):
        monkeypatch.setenv("COLUMNS", str(columns))
        print_table(head, [row], left)
        return re.sub(r"\x1b\[[0-9;]*m", "", capsys.readouterr().out).splitlines()

    in_a_pipe = ["part                           off by mm", "places of the lower U joints  123456.789"]
    assert printed(30) == in_a_pipe
    monkeypatch.setenv("FORCE_COLOR", "1")
    assert printed(80) == in_a_pipe
    folded = [("part", "off by mm"), ("places of the", "123456.789"), ("lower U joints", "")]
    assert printed(30) == [f"{text:18}  {figure:>10}".rstrip() for text, figure in folded]
    assert printed(17) == ["part    off by mm", "places 123456.789", "of the", "lower", "U", "joints"]
    assert printed(16) == ["part", "   off by mm", "places of the lower U joints", "  123456.789"]
    # One column would have to give way to another, and no word is cut for it.
    texts = printed(29, ("part", "group"), ("places of the lower U joints", "moving_centres"), (0, 1))
    assert texts == ["part           group", "places of the  moving_centres", "lower U", "joints"]


def test_a_command_to_type_is_printed_in_one_line_with_its_files_quoted(run, tmp_path, capfd, monkeypatch):
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "40")
    folder = tmp_path / "a folder"
    assert f"--model '{folder}/actual.yaml'\n" in run("examples", "copy", folder)[1]
    urdf = tmp_path / "an arm.urdf"
    urdf.write_text('<robot name="arm"/>')
    assert f"'pouring-robot robot init '{urdf}''" in run("robots", "--robot", urdf)[2]
    command = f"pouring-robot campaign plan --out next.csv{' --parameters axes' * 4}"
    print_lines([f"poses that tell most: {command}", " so"])
    lines = ["  poses that tell most:", f"    {command}", "   so"]
    assert capfd.readouterr().out.splitlines() == lines


def test_a_path_is_printed_in_one_line(run, tmp_path):
    file = tmp_path / ("long" * 40) / "path.csv"
    file.parent.mkdir()
    assert f"wrote {file}\n" in run("path", POSES, "--out", file)[1]


def test_the_version(run):
    assert run("--version") == (0, f"pouring-robot {pouring_robot.__version__}\n", "")


def test_pose_outside_the_box_says_so(run):
    code, out, _ = run("pose", "--at-mm", "-160", "0", "-600")
    assert code == 0
    assert "outside the workspace box: x by 10.0 mm" in out


def test_path_gives_one_row_a_pose(run, as_built):
    code, out, err = run("path", POSES, "--model", ACTUAL, "--json")
    assert (code, err) == (0, "")
    rows = json.loads(out)["poses"]
    commanded = read_poses(POSES)
    assert len(rows) == len(commanded) == 5
    errors = []
    for row, pose in zip(rows, commanded, strict=True):
        error = as_built.locate(pose).difference("ladle_lip")
        assert row["frames"]["ladle_lip"]["error"]["distance_mm"] == pytest.approx(error.distance_m * 1e3, abs=1e-9)
        errors.append(error.distance_m * 1e3)
    code, out, _ = run("path", POSES, "--model", ACTUAL)
    assert code == 0
    assert f"largest error {max(errors):.3f} mm" in out
    assert all(f"{error:.3f}" in out for error in errors)


def test_robots_lists_both_layouts(run):
    code, out, err = run("robots", "--json")
    assert (code, err) == (0, "")
    robots = {robot["layout"]: robot for robot in json.loads(out)}
    assert set(robots) == {"paper", "wide"}
    for robot in robots.values():
        assert (robot["equations"], robot["rank_nominal"], robot["freedoms"], robot["joints"]) == (24, 22, 4, 20)
        assert list(robot["drives"]) == ["leg1_s3", "leg2_s3", "leg3_s3", "leg4_s5"]
        assert robot["drives"]["leg1_s3"]["unit"] == "mm"
        assert robot["drives"]["leg4_s5"]["unit"] == "deg"
        # Exactly, not nearly: -824.9999999999999 is no figure for people.
        assert robot["workspace"]["position_lower_mm"] == [-150.0, -50.0, -825.0]
        tilt = robot["workspace"]["tilt"]
        assert (tilt["lower"], tilt["upper"]) == pytest.approx((np.degrees(-0.4884), np.degrees(1.08155)), abs=1e-8)
    assert robots["paper"]["drives"]["leg1_s3"] == {"lower": 260.0, "upper": 1100.0, "unit": "mm"}
    code, out, _ = run("robots", "--model", ACTUAL)
    assert code == 0
    assert "20 joints displaced, rank 24" in out
    assert "drive leg1_s3: 260 … 1100 mm" in out
    assert "rad" not in out
    assert "4 freedoms" in out


def test_export_is_the_robot_as_built(run, tmp_path, as_built):
    code, out, err = run("export", "--out", tmp_path / "robot", "--model", ACTUAL)
    assert (code, err) == (0, "")
    folder = tmp_path / "robot"
    urdf = folder / "pouring_robot.urdf"
    assert str(urdf) in out.replace("\n", "")
    # Pinocchio reads it from the file, meshes and all; it looks for relative addresses in the folders it is told.
    model = pin.buildModelFromUrdf(str(urdf))
    visual = pin.buildGeomFromUrdf(model, str(urdf), pin.GeometryType.VISUAL, package_dirs=[str(folder)])
    assert len(visual.geometryObjects) > 20
    built = pin.buildModelFromXML(as_built.model.urdf())
    assert list(model.names) == list(built.names)
    for mine, theirs in zip(model.jointPlacements, built.jointPlacements, strict=True):
        assert np.abs(mine.homogeneous - theirs.homogeneous).max() < 1e-12
    # With the exported loops it closes where the library says.
    mechanism = ClosedChainMechanism(urdf.read_text(encoding="utf-8"), load_loops(folder / "loops.yaml"))
    location = as_built.locate(PlatformPose((-0.1, 0.02, -0.6), 0.3))
    found = ClosureSolver(mechanism).solve(location.drives, location.nominal.configuration)
    gap = pose_gap(found.pose_base_to_end, location.actual.pose_base_to_end)
    assert gap == pytest.approx([0.0, 0.0], abs=1e-12)


def test_page_and_picture_are_written(run, tmp_path):
    code, out, err = run("pose", *AT, "--model", ACTUAL, "--html", "view.html", "--png", "view.png", "--json")
    assert (code, err) == (0, "")
    assert json.loads(out)["written"] == ["view.html", "view.png"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["view.html", "view.png"]
    assert (tmp_path / "view.png").read_bytes().startswith(b"\x89PNG")
    assert "<html" in (tmp_path / "view.html").read_text(encoding="utf-8").lower()


def test_a_place_in_another_unit_is_told_with_its_fault(run, tmp_path):
    arm = ["--robot", ROOT / "examples" / "machines" / "ur10" / "robot.yaml"]
    (tmp_path / "p.csv").write_text("x_m,y_m,z_m,tilt_deg\n-100,20,-600,17\n", encoding="utf-8")
    larger, smaller = (f"; with x, y, z {factor} times as large it is in reach: mm or m?" for factor in (1000, 0.001))
    for hint, command in (
        (larger, ["pose", "--at-mm", "-0.1", "0.02", "-0.6"]),
        (larger, ["compensate", "--at-mm", "-0.1", "0.02", "-0.6", "--melt-degC", "1700"]),
        (smaller, ["path", "p.csv", "--steady"]),
        (smaller, ["pose", "--at-mm", "300000", "200000", "400000", *arm]),
    ):
        code, out, err = run(*command)
        assert (code, out) == (3, "") and "out of reach" in err
        assert err.endswith(f"{hint}\n") and err.count("\n") == 1
    for beyond in (["--at-mm", "0", "0", "-3000"], ["--drives", "9000 600 600 0"]):
        code, _, err = run("pose", *beyond)
        assert code == 3 and "times as large" not in err


def test_help_of_every_command(run):
    code, out, _ = run("--help")
    assert code == 0
    for command in ("pose", "path", "robots", "view", "export"):
        assert command in out
        code, own, err = run(command, "--help")
        assert (code, err) == (0, "")
        assert "--model" in own


# --- what it refuses ------------------------------------------------------------------------------------


def refused(run, tmp_path, code, words, *arguments):
    """Check for the exit code, exactly one line that holds the words, no output and no file."""
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")}
    found, out, err = run(*arguments)
    assert (found, out) == (code, "")
    assert err.endswith("\n")
    assert err.count("\n") == 1
    assert err.startswith("pouring-robot: ")
    assert "Traceback" not in err
    for word in [words] if isinstance(words, str) else words:
        assert word in err
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")} == before


@pytest.mark.parametrize(
    ("code", "words", "arguments"),
    [
        (3, ("leg1_s3", "mm beyond", WORKSPACE), ["pose", "--at-mm", "0", "0", "-2000"]),
        (3, ("deg beyond", "'leg"), ["pose", "--at-mm", "0", "0", "-600", "--tilt-deg", "120"]),
        (3, "out of reach", ["pose", "--at-mm", "0", "0", "0"]),
        (2, ("--at-mm", "1e+203", "check the unit"), ["pose", "--at-mm", "1e203", "0", "-600"]),
        (2, ("--tilt-deg", "1e+203", "check the unit"), ["pose", "--at-mm", "0", "0", "-600", "--tilt-deg", "1e203"]),
        (
            2,
            ("--rotation-deg", "check the unit"),
            ["pose", "--at-mm", "0", "0", "-600", "--rotation-deg", "0", "1e203", "0"],
        ),
        (2, ("--drives", "-1e+300", "check the unit"), ["pose", "--drives", "600 600, -1e300 0"]),
        (2, ("--at-mm", "finite"), ["pose", "--at-mm", "nan", "0", "-600"]),
        (2, ("--at-mm", "finite"), ["pose", "--at-mm", "0", "0", "-inf"]),
        (2, ("--tilt-deg", "finite"), ["pose", "--at-mm", "0", "0", "-600", "--tilt-deg", "nan"]),
        (2, ("--at-mm", "(it is 'a')"), ["pose", "--at-mm", "a", "0", "-600"]),
        (2, ("--false-names", "(it is '5%')"), ["diagnose", POSES, "--out", "o", "--false-names", "5%"]),
        (2, "--tilt-deg", ["pose", "--at-mm", "0", "0", "-600", "--tilt-deg", "steep"]),
        (2, ("--at-mm", "see pouring-robot pose --help"), ["pose", "--at-mm", "0", "0"]),
        (2, "--at-mm", ["pose"]),
        (2, "5", ["pose", "--at-mm", "0", "0", "-600", "5"]),
        (2, "--titl-deg", ["pose", "--at-mm", "0", "0", "-600", "--titl-deg", "5"]),
        (2, ("papre", "known: paper, wide"), ["pose", *AT, "--layout", "papre"]),
        (2, "not both", ["pose", *AT, "--layout", "paper", "--model", ACTUAL]),
        (2, "layouts belong to the pouring robot", ["robots", "--layout", "paper", "--robot", ACTUAL]),
        (2, ("absent.yaml", "cannot be read"), ["pose", *AT, "--model", "absent.yaml"]),
        (2, ("absent", "does not exist"), ["pose", *AT, "--png", "absent/view.png"]),
        (2, ("absent", "does not exist"), ["pose", *AT, "--html", "absent/view.html"]),
        (2, "it is a folder", ["pose", *AT, "--html", "."]),
        (2, "pictures are PNG; call it view.png", ["pose", *AT, "--png", "view.jpg"]),
        (2, "written as .csv, not as .parquet", ["path", POSES, "--out", "poses.parquet"]),
        (2, "one of a command, --path and --campaign", ["view", *AT, "--path", POSES, "--no-browser"]),
        (2, "absent.csv", ["view", "--campaign", "absent.csv", "--no-browser"]),
        (2, "same file", ["pose", *AT, "--html", "view", "--png", "view"]),
        (2, "exaggeration factor", ["pose", *AT, "--html", "view.html", "--exaggerate", "0"]),
        (2, "exaggeration factor", ["pose", *AT, "--html", "view.html", "--exaggerate", "nan"]),
        (2, "--exaggerate", ["pose", *AT, "--html", "view.html", "--exaggerate", "much"]),
        (2, ("absent.csv", "cannot be read"), ["path", "absent.csv"]),
        (2, "POSES.csv", ["path"]),
        (2, "cannot write", ["export", "--out", "/proc/no/such/place"]),
        (2, "--out", ["export"]),
        (2, "--zero-here is for --format urdf", ["export", "--out", "o", "--format", "mjcf", "--zero-here"]),
        (2, "--absolute-meshes is for", ["export", "--out", "o", "--format", "sdf", "--absolute-meshes"]),
        (2, ("'--format'", "drake"), ["export", "--out", "o", "--format", "usd"]),
        (2, "--header cannot be used with --at-mm", ["compensate", *AT, "--header", "c.h"]),
        (2, "--header cannot be used with", ["compensate", POSES, "--at-once", "--thermal-model", POSES]),
        (2, "port", ["view", "--port", "70000", "--no-browser"]),
        (2, "poes", ["poes", *AT]),
        (2, "--modle", ["robots", "--modle", "x"]),
    ],
    ids=lambda value: " ".join(map(str, value)) if isinstance(value, list) else "",
)
def test_bad_input_is_one_line_and_an_exit_code(run, tmp_path, code, words, arguments):
    refused(run, tmp_path, code, words, *arguments)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("layout: [paper\n", ("model.yaml", "line", "not valid YAML")),
        ("format: pouring_robot/model/1\nlayot: paper\n", ("line 2", "'layot'", "did you mean 'layout'")),
        ("layout: papre\n", ("papre", "known: paper, wide")),
        ("joint_placements: {leg1_s1: {translation_mm: [.nan, 0, 0]}}\n", ("line 1", "finite")),
        ("joint_placements: {leg1_x1: {}}\n", ("leg1_x1", "did you mean")),
        ("layouts_file: absent.yaml\n", ("absent.yaml", "cannot be read")),
        ("", ("model.yaml", "mapping")),
        ("\x00", ("model.yaml", "YAML")),
    ],
)
@pytest.mark.parametrize("command", [["pose", *AT], ["robots"], ["path", POSES], ["export", "--out", "robot"]])
def test_bad_model_files(run, tmp_path, command, text, words):
    path = tmp_path / "model.yaml"
    path.write_text(text, encoding="utf-8")
    refused(run, tmp_path, 2, words, *command, "--model", path)


def test_a_model_that_cannot_close_is_no_solution(run, tmp_path):
    path = tmp_path / "model.yaml"
    path.write_text(
        "joint_placements:\n"
        "  leg4_s1: {rotation_mrad: [100, 0, 100]}\n"
        "  leg4_seat_mount: {rotation_mrad: [-100, 0, -100]}\n"
        "  leg1_s1: {rotation_mrad: [-100, 0, -100]}\n"
    )
    refused(run, tmp_path, 3, ("the loops do not close", "mrad"), "pose", *AT, "--model", path)


@pytest.mark.parametrize(
    ("text", "code", "words"),
    [
        ("", 2, "is empty"),
        ("x_mm,y_mm,z_mm,tilt_deg\n", 2, "no pose"),
        ("x_mm,y_mm,z_mm,tilt_deg\n0,0,-600,0\n0,0,x,0\n", 2, "line 3, column z_mm: 'x'"),
        ("x_mm,y_mm,z_mm,tilt_deg\n0,0,nan,0\n", 2, "line 2, column z_mm"),
        ("x_mm,y_mm,z_mm\n0,0,-600\n", 2, "the column for tilt"),
        ("x_mm,y_mm,z_mm,tilt_deg\n-100,0,-600,0\n-100,0,-3000,0\n", 3, "out of reach"),
    ],
)
def test_bad_pose_files(run, tmp_path, text, code, words):
    path = tmp_path / "poses.csv"
    path.write_text(text)
    refused(run, tmp_path, code, words, "path", path, "--png", "view.png")


@pytest.mark.parametrize("command", [["path"], ["compensate"], ["compensate", "--at-once"]])
def test_a_campaign_in_the_place_of_poses_is_told_as_such(run, tmp_path, command):
    """Its x, y and z are a tracker's, and no slip of the pen makes one of its columns another."""
    path = tmp_path / "campaign.csv"
    path.write_text("sample,q1_mm,q2_mm,q3_mm,q4_rad,x_mm,y_mm,z_mm,operator\n0,500,500,600,0,1,2,3,me\n")
    refused(
        run,
        tmp_path,
        2,
        ("'q1_mm' is the column of a drive, as in a campaign", "x_mm, y_mm, z_mm, tilt_deg"),
        *command,
        path,
    )


def test_path_says_which_row_is_out_of_reach(run, tmp_path):
    path = tmp_path / "poses.csv"
    path.write_text("x_mm,y_mm,z_mm,tilt_deg\n-100,0,-600,0\n-100,0,-3000,0\n")
    refused(run, tmp_path, 3, ("poses.csv", "line 3"), "path", path)


def test_broken_dimensions_file(run, tmp_path):
    text = shipped_layouts_file().read_text(encoding="utf-8")
    (tmp_path / "mine.yaml").write_text(text.replace("fixed_centres:", "fixed_centers:", 1), encoding="utf-8")
    (tmp_path / "model.yaml").write_text("layouts_file: mine.yaml\n")
    refused(run, tmp_path, 2, ("mine.yaml", "line", "fixed_cent"), "pose", *AT, "--model", tmp_path / "model.yaml")


def test_a_singular_pose_draws_nothing(run, tmp_path, monkeypatch):
    def singular(robot, location):
        raise SingularPoseError(1e-16)

    monkeypatch.setattr(PouringRobot, "dexterity", singular)
    refused(run, tmp_path, 3, ("line 2", "singular"), "path", POSES, "--json", "--png", "view.png")
    refused(run, tmp_path, 3, "singular", "pose", *AT, "--png", "view.png")


def test_joint_values_of_a_path_put_the_exported_tree_where_the_ladle_is(run, tmp_path):
    """Read back from the files by Pinocchio alone, at the pose that was exported."""
    at = ("--at-mm", "-100", "20", "-600", "--tilt-deg", "17", "--model", ACTUAL)
    assert run("export", "--out", "out", *at)[0] == 0
    assert run("pose", *at, "--joints", "pose.json")[0] == 0
    assert run("path", POSES, "--model", ACTUAL, "--joints", "path.csv")[0] == 0
    figures = json.loads(run("pose", *at, "--json")[1])
    table = json.loads((tmp_path / "pose.json").read_text(encoding="utf-8"))["poses"][0]["joints"]
    tree = pin.buildModelFromUrdf(str(tmp_path / "out" / "pouring_robot.urdf"))
    data, configuration = tree.createData(), np.array([table[name] for name in list(tree.names)[1:]])
    pin.framesForwardKinematics(tree, data, configuration)
    base, lip = (data.oMf[tree.getFrameId(name)] for name in ("fixed_platform", "ladle_lip"))
    expected = figures["frames"]["ladle_lip"]["actual_mm"]
    np.testing.assert_allclose(base.actInv(lip).translation, np.array(expected) / 1e3, rtol=0, atol=1e-6)
    rows = (tmp_path / "path.csv").read_text(encoding="utf-8").splitlines()
    assert len(rows) == 6 and rows[0].startswith("truss_travel_m,") and rows[0].count(",") == 23


def test_an_export_that_fails_leaves_the_folder_as_it_was(run, tmp_path):
    (tmp_path / "robot" / "loops.yaml").mkdir(parents=True)
    refused(run, tmp_path, 2, ("loops.yaml", "it is a folder"), "export", "--out", "robot")


def test_what_a_command_reads_it_does_not_write(run, tmp_path):
    (tmp_path / "poses.csv").write_text("x_mm,y_mm,z_mm,tilt_deg\n0,0,-600,0\n")
    told = ("poses.csv", "this command reads it")
    refused(run, tmp_path, 2, told, "path", "poses.csv", "--out", "./poses.csv", "--overwrite")
    assert (tmp_path / "poses.csv").read_text() == "x_mm,y_mm,z_mm,tilt_deg\n0,0,-600,0\n"


def test_an_older_output_survives_a_failure(run, tmp_path):
    (tmp_path / "view.png").write_bytes(b"older")
    refused(run, tmp_path, 3, "out of reach", "pose", "--at-mm", "0", "0", "-2000", "--png", "view.png", "--overwrite")
    assert (tmp_path / "view.png").read_bytes() == b"older"


# --- the live view --------------------------------------------------------------------------------------


def listening(process):
    return [one.laddr for one in process.net_connections("inet") if one.status == psutil.CONN_LISTEN]


def test_view_listens_on_loopback_until_ctrl_c_and_leaves_nothing(tmp_path):
    home, empty = tmp_path / "home", tmp_path / "empty"
    home.mkdir()
    empty.mkdir()
    command = [sys.executable, "-m", "pouring_robot", "view", *AT, "--model", str(ACTUAL), "--no-browser"]
    with subprocess.Popen(
        command, cwd=empty, env={"PYTHONPATH": str(ROOT), "PATH": "", "HOME": str(home)},
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    ) as started:  # fmt: skip
        try:
            line = started.stdout.readline()
            url = next(word for word in line.split() if word.startswith("http://127.0.0.1:"))
            port = int(url.rsplit(":", 1)[1].strip("/"))
            process = psutil.Process(started.pid)
            family = [process, *process.children(recursive=True)]
            assert [tuple(address) for one in family for address in listening(one)] == [("127.0.0.1", port)]
            with urllib.request.urlopen(url, timeout=10) as answer:
                assert b"<html" in answer.read().lower()
            started.send_signal(signal.SIGINT)
            out, err = started.communicate(timeout=15)
        finally:
            started.kill()
    assert (started.returncode, err) == (0, "")
    assert "nothing is left running" in out
    assert not any(one.is_running() and one.status() != psutil.STATUS_ZOMBIE for one in family)
    with contextlib.closing(socket.socket()) as probe:
        assert probe.connect_ex(("127.0.0.1", port)) != 0
    assert list(empty.iterdir()) == []


@pytest.mark.parametrize("arguments", [["robots"], ["effects", "--json"], ["--help"]])
def test_a_reader_that_has_had_enough_is_no_failure(arguments):
    """``pouring-robot robots | head -1``, with a reader that is gone before the first line."""
    reader, writer = os.pipe()
    os.close(reader)
    command = [sys.executable, "-m", "pouring_robot", *arguments]
    with os.fdopen(writer, "wb") as out:
        done = subprocess.run(command, stdout=out, stderr=subprocess.PIPE, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize(
    "python",
    [
        "-m pouring_robot pose --at-mm -100 20 -600 --tilt-deg 17",
        "-c 'import pouring_robot; pouring_robot.load_robot()'",
    ],
)
def test_a_process_without_standard_error_works(python):
    done = subprocess.run(["sh", "-c", f"exec {sys.executable} {python} 2>&-"], capture_output=True, check=False)
    assert done.returncode == 0
