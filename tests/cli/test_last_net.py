"""An unexpected error ends as one line, with the details in a file."""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from pouring_robot.cli import app
from tests.effects.plugins import installed
from tests.support import ROOT


@pytest.fixture
def broken(monkeypatch, tmp_path):
    """Let every command fail in a way that nobody foresaw."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))

    def fail(problem):
        def raising(**_):
            raise problem

        monkeypatch.setattr(app, "app", raising)

    return fail


@pytest.mark.parametrize(
    "problem", [KeyError("x\ny"), RecursionError(), AssertionError("z" * 9999), ValueError("\udcff")]
)
def test_any_error_is_one_line_and_a_file(run, broken, problem):
    broken(problem)
    code, out, err = run("pose", "--model", "a b")
    assert (code, out, err.count("\n")) == (70, "", 1)
    assert type(problem).__name__ in err
    assert len(err) < 600
    details = Path(err.partition("the file ")[2].partition(",")[0]).read_text(encoding="utf-8")
    assert "Traceback" in details
    assert "pouring-robot pose --model 'a b'" in details


def test_too_little_memory_is_said(run, broken):
    broken(MemoryError())
    code, _, err = run("pose")
    assert (code, "not enough memory" in err) == (70, True)


def test_no_place_for_the_details(run, broken, monkeypatch):
    def full(**_):
        raise OSError(28, "No space left on device")

    broken(ZeroDivisionError("q"))
    monkeypatch.setattr(tempfile, "mkstemp", full)
    code, _, err = run("pose")
    assert (code, "ZeroDivisionError: q" in err.splitlines()[-1]) == (70, True)


def test_what_cannot_be_said_is_no_fault_of_the_program(tmp_path):
    line = "import sys, tempfile; tempfile.tempdir = sys.argv[1]; from pouring_robot.cli.app import main; "
    line += "sys.exit(main(['pose', '--at-mm', '1', '2']))"
    buffered = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    with Path("/dev/full").open("w") as full:
        done = subprocess.run([sys.executable, "-c", line, tmp_path], cwd=ROOT, env=buffered, stderr=full, check=False)
    assert (done.returncode, list(tmp_path.iterdir())) == (2, [])


def test_a_module_that_the_installation_has_lost(tmp_path):
    lost = "import sys; sys.modules['typing_extensions'] = sys.modules['pouring_robot.cli.poses.pose'] = None; "
    line = lost + "from pouring_robot.cli.app import main; sys.exit(main(['pose']))"
    done = subprocess.run(
        [sys.executable, "-c", line],
        cwd=ROOT,
        env={"TMPDIR": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 70
    assert done.stderr.count("\n") == 1


FAILING = """
from pouring_robot.effects import Effect


class Failing(Effect):
    id, story, needs = "failing", "a package's effect that fails", ()

    def missing(self, conditions):
        {how}

    def forms(self, conditions):
        return ()


class Twin(Failing):
    id = "twin"
"""


@pytest.mark.parametrize(
    ("how", "said"), [("raise KeyError('q7')", "KeyError: 'q7'"), ("raise SystemExit", "SystemExit")]
)
def test_an_effect_of_a_package_is_named_where_it_fails(run, monkeypatch, tmp_path, how, said):
    entries = {"failing": "failing:Failing", "twin": "failing:Twin"}  # which of one file it was is not known
    folder = installed(tmp_path / "site", "failing", FAILING.format(how=how), entries)
    monkeypatch.syspath_prepend(folder)
    assert run("campaign", "simulate", "--random", "30", "--out", "measured.csv")[0] == 0
    code, _, err = run("diagnose", "measured.csv", "--out", "found")
    sys.modules.pop("failing", None)
    assert (code, err.splitlines()[-1].count("'failing'")) == (2, 1), err
    assert f"{folder / 'failing.py'}, line 9" in err
    assert said in err and "the effect 'failing' or 'twin' (" in err
    assert not (tmp_path / "found").exists()
