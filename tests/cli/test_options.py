"""Common behaviour of all subcommands: help, overwriting, quiet, completion, remaining time, a reader that goes."""

import shutil
import subprocess
import sys

import pytest

from pouring_robot.cli.app import _MODULES
from pouring_robot.cli.shared.progress import time_left
from pouring_robot.cli.shared.tables import print_table
from tests.support import ACTUAL, LEARNED, ROOT

_COMMANDS = tuple(_MODULES)
POSES, AT = ROOT / "examples" / "poses.csv", ["--at-mm", "-100", "20", "-600"]


def test_help_has_whole_summaries_in_the_order_of_use(run):
    code, out, err = run("-h")
    assert (code, err) == (0, "") and "…" not in out and "..." not in out.replace("[ARGS]...", "")
    places = [out.index(f"\n  {command} ") for command in _COMMANDS]
    assert places == sorted(places) and _COMMANDS.index("pose") < _COMMANDS.index("diagnose") < _COMMANDS.index(
        "regress"
    )
    assert run("campaign", "simulate", "-h")[0] == 0


@pytest.mark.parametrize(
    "command",
    [
        "pose {at} --condition payload_kg=200",
        "path {poses} --condition payload_kg=200",
        "compensate {at} --condition payload_kg=200",
        "campaign simulate --out c.csv --random 2",
        "thermal {at}",
        "robots",
        "export --out tree",
    ],
)
def test_a_model_that_is_not_to_be_used_is_said_to_be(run, tmp_path, command):
    """Its mark is noted on standard error by whatever takes it, once, and changes no exit code."""
    model, text = tmp_path / "model.yaml", LEARNED.read_text(encoding="utf-8")
    model.write_text(text.replace("    ranges:", "    worse: true\n    ranges:", 1), encoding="utf-8")
    words = command.format(at=" ".join(AT), poses=POSES).split()
    code, _, err = run(*words, "--model", model)
    assert (code, err.count(f"note: {model} with what it learned in 'campaign': ")) == (0, 1)
    assert ": do not use it\n" in err
    assert "do not use it" not in run(*words, "--overwrite", "--model", LEARNED)[2]


def test_a_table_is_as_wide_as_its_cells(capsys):
    rows = [["n" * 90, "1.250", "u" * 60], ["short", "-0.5"]]
    print_table(("name", "x", "what"), rows, title="of three columns")
    title, *lines = capsys.readouterr().out.splitlines()
    assert title.strip() == "of three columns" and [line.split() for line in lines] == [["name", "x", "what"], *rows]


# Every option that names a file or folder to write; what stands in a folder is one of the files written there.
OUTPUTS = [
    ("pose --at-mm 0 0 -600", "--html"), ("pose --at-mm 0 0 -600", "--png"), ("pose --at-mm 0 0 -600", "--joints"),
    ("path {poses}", "--out"), ("path {poses}", "--html"), ("path {poses}", "--png"), ("path {poses}", "--joints"),
    ("thermal --at-mm 0 0 -600", "--report"), ("regress {poses}", "--report"),
    ("thermal --at-mm 0 0 -600", "--csv"), ("thermal --at-mm 0 0 -600", "--png"),
    ("thermal --at-mm 0 0 -600 --under heat", "--html"), ("compensate {poses}", "--out"), ("compensate", "--header"),
    ("regress {poses}", "--out"), ("campaign plan", "--out"), ("campaign simulate --random 3", "--out"),
    ("campaign simulate --random 3 --out c.csv", "--truth"), ("campaign check {poses}", "--png"),
    ("robot init {poses}", "--out"), ("calibrate {poses}", "--out report.html"), ("sensitivity", "--out report.html"),
    ("diagnose {poses}", "--out diagnosis.json"), ("export", "--out loops.yaml"),
]  # fmt: skip


@pytest.mark.parametrize(("command", "option"), OUTPUTS, ids=[" ".join(one) for one in OUTPUTS])
def test_nothing_is_replaced_unasked(run, tmp_path, command, option):
    option, _, inside = option.partition(" ")
    there = tmp_path / "there" / inside if inside else tmp_path / ("there.png" if option == "--png" else "there.csv")
    there.parent.mkdir(exist_ok=True)
    there.write_text("mine")
    given = [*command.format(poses=POSES).split(), option, there.parent if inside else there]
    code, out, err = run(*given)
    assert (code, out) == (2, "") and "it exists already; choose another name, or use --overwrite" in err
    assert there.read_text() == "mine"


def test_overwrite_replaces(run, tmp_path):
    (tmp_path / "p.csv").write_text("old")
    assert run("path", POSES, "--out", "p.csv", "--overwrite")[0] == 0
    rows = (tmp_path / "p.csv").read_text().splitlines()
    assert rows[0].startswith("x_mm,y_mm,z_mm,tilt_deg,error_x_mm") and len(rows) == 6
    assert run("path", POSES, "--out", "/dev/null")[0] == 0  # nothing is lost there


def test_a_file_that_is_read_is_not_replaced_by_one_that_goes_with_another(run, tmp_path):
    """A campaign's YAML stands beside its table; a robot file and a plan in the folder of what is found."""
    model = tmp_path / "m.yaml"
    model.write_bytes(ACTUAL.read_bytes())
    shutil.copytree(ROOT / "examples" / "machines" / "ur10", tmp_path / "arm")
    robot, campaign = tmp_path / "arm" / "robot.yaml", tmp_path / "arm" / "series_a.csv"
    for suffix in (".csv", ".yaml"):
        for other in ("arm/next", "calibrated", "model"):
            (tmp_path / other).with_suffix(suffix).write_bytes(campaign.with_suffix(suffix).read_bytes())
    for command in (
        f"campaign simulate --random 2 --model {model} --out m.csv --overwrite",
        f"export --robot {robot} --out arm --overwrite",
        f"calibrate {campaign} --robot {robot} --out arm --overwrite",
        f"diagnose arm/next.csv --robot {robot} --out arm --overwrite",
        f"calibrate calibrated.csv --robot {robot} --out . --overwrite",
        f"calibrate {campaign} --model calibrated.yaml --out . --overwrite",
        f"diagnose model.csv --robot {robot} --out . --overwrite",
    ):
        before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
        code, _, err = run(*command.split())
        assert code == 2 and "this command reads it" in err
        assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before


@pytest.mark.parametrize(
    ("command", "said"),
    [
        (f"path {POSES} --out p.csv --exaggerate 5", "ask for one with --html or --png"),
        (f"path {POSES} --out p.csv --html p.html --exaggerate 0", "exaggeration factor"),
        (f"path {POSES} --at-once --exaggerate 5", "ask for one with --html or --png"),
        (f"path {POSES} --html p.html --joints p.txt", "it is written as .csv or .json, not as .txt"),
        (f"path {POSES} --at-once --condition payload_kg=1", "leave out --condition"),
        (f"compensate {POSES} --at-once --condition payload_kg=1", "leave out --condition"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_is_written(run, tmp_path, command, said):
    code, out, err = run(*command.split())
    assert (code, out) == (2, "") and said in err and list(tmp_path.iterdir()) == []


def test_a_table_goes_to_a_pipe_and_does_not_come_from_one():
    """``/dev/stdout`` of a pipe resolves to no file, and what is commanded is read more than once."""
    command = f"{sys.executable} -m pouring_robot path {POSES} -q --out /dev/stdout | cat"
    done = subprocess.run(["bash", "-c", command], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.stderr == "" and done.stdout.startswith("x_mm,y_mm,z_mm,tilt_deg,")
    command = f"cat {POSES} | {sys.executable} -m pouring_robot path /dev/stdin"
    done = subprocess.run(["bash", "-c", command], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 2 and "/dev/stdin: is a pipe" in done.stderr


def test_a_folder_that_is_gone_is_said_to_be(run, tmp_path, monkeypatch):
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    for command in ("path poses.csv", "examples copy here", f"campaign check {POSES}"):
        code, _, err = run(*command.split())
        assert code == 2 and "the current folder no longer exists" in err
    for command in ("--version", "pose -h", f"robots --robot {ROOT}/examples/machines/ur10/robot.yaml"):
        assert run(*command.split())[0] == 0, "it needs no folder"
    monkeypatch.chdir(tmp_path)


def test_a_quiet_command_says_errors_and_figures_only(run):
    assert run("pose", *AT, "--quiet") == (0, "", "")
    assert run("path", POSES, "-q", "--out", "p.csv") == (0, "", "")
    assert run("pose", *AT, "-q", "--json")[1].startswith("{")
    assert run("pose", "--at-mm", "0", "0", "0", "-q")[2].startswith("pouring-robot: ")
    assert run("pose", *AT)[1]  # and the next one speaks again


def test_the_line_that_matters_comes_first(run, as_built, tmp_path):
    first = run("pose", *AT, "--model", ACTUAL)[1].splitlines()[0]
    assert first.startswith("ladle_lip is ") and first.endswith(" off at -100, 20, -600 mm, 0 deg")
    out = run("path", POSES, "--model", ACTUAL)[1]
    assert out.startswith("largest error 6.553 mm")
    assert run("compensate", POSES, "--model", ACTUAL)[1].startswith("largest: 'moving_platform' is ")


def test_a_long_table_is_shown_in_part_and_written_as_a_whole(run, tmp_path):
    lines = ["x_mm,y_mm,z_mm,tilt_deg", *(f"{x},0,-600,10" for x in range(-60, 0))]
    (tmp_path / "long.csv").write_text("\n".join(lines))
    for more in ([], ["--at-once"]):
        out = run("path", "long.csv", *more)[1]
        assert "… and 20 more; --out FILE.csv writes all" in out and out.count("-600.000") == 40
    out = run("path", "long.csv", "--out", "all.csv")[1]
    assert "-600.000" not in out and len((tmp_path / "all.csv").read_text().splitlines()) == 61


def test_drives_have_one_set_of_names_and_the_tilt_one_unit(run):
    posed = run("pose", *AT)[1]
    assert "leg1_s3 " in posed and "leg4_s5 " in posed and " deg" in posed
    head = next(line for line in run("compensate", *AT, "--model", ACTUAL)[1].splitlines() if "tilt °" in line)
    assert "leg1_s3 mm" in head and "leg4_s5 °" in head and "q4" not in head and "rad" not in head
    assert "drive leg4_s5: " in (listed := run("robots")[1]) and "deg; q4 in campaigns" in listed


@pytest.mark.parametrize(
    ("done", "total", "elapsed", "since", "words"),
    [
        (0, 10, 5.0, 0.0, ""),
        (5, None, 5.0, 0.0, ""),
        (2, 10, 10.0, 0.0, "about 0:40 left"),
        (2, 10, 13.0, 3.0, "about 0:37 left"),  # counted down while a step takes its time
        (1, 100, 10.0, 0.0, "about 16:30 left"),
        (9, 10, 30.0, 20.0, "nearly there"),
        (10, 10, 30.0, 0.0, ""),
    ],
)
def test_the_time_left_moves(done, total, elapsed, since, words):
    assert time_left(done, total, elapsed, since) == words


def test_the_shell_completes(tmp_path):
    env = {"PYTHONPATH": str(ROOT), "_POURING_ROBOT_COMPLETE": "complete_bash", "HOME": str(tmp_path)}
    env |= {"COMP_WORDS": "pouring-robot ca", "COMP_CWORD": "1"}
    done = subprocess.run([sys.executable, "-m", "pouring_robot"], env=env, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr, done.stdout.split()) == (0, "", ["campaign", "calibrate"])


def test_a_reader_that_reads_one_line_is_no_failure():
    command = f"{sys.executable} -m pouring_robot path {POSES} | head -1; exit ${{PIPESTATUS[0]}}"
    done = subprocess.run(["bash", "-c", command], cwd=ROOT, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "") and done.stdout.startswith("largest error")
