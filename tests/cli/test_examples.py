"""Examples from an installation, and modules that a plain installation lacks: the message names the extra."""

import filecmp
import re
import sys
import tomllib

import pytest

from pouring_robot.cli.app import EXTRAS
from tests.support import ACTUAL, ROOT

AT = ["--at-mm", "-100", "20", "-600"]


def test_examples_are_copied_whole_and_work_where_they_are(run, tmp_path):
    code, out, err = run("examples", "copy", "mine")
    assert (code, err) == (0, "") and "--model mine/actual.yaml" in out
    names = [path.relative_to(tmp_path / "mine") for path in (tmp_path / "mine").rglob("*") if path.is_file()]
    assert len(names) > 30 and not any("__pycache__" in name.parts for name in names)
    assert filecmp.cmpfiles(ROOT / "examples", tmp_path / "mine", names, shallow=False)[0] == names
    assert run("pose", *AT, "--model", "mine/actual.yaml")[0] == 0


def test_where_they_are_not_it_is_said_how_to_get_them(run):
    code, _, err = run("pose", *AT, "--model", "examples/actual.yaml")
    assert code == 2 and err.count("\n") == 1 and "'pouring-robot examples copy examples'" in err
    assert run("examples", "copy", "examples")[0] == 0
    assert run("pose", *AT, "--model", "examples/actual.yaml")[0] == 0
    assert "examples copy" not in run("pose", *AT, "--model", "examples/none.yaml")[2]


def test_a_folder_that_is_there_is_left_alone(run, tmp_path):
    (tmp_path / "mine").mkdir()
    code, _, err = run("examples", "copy", "mine")
    assert code == 2 and "it exists already" in err
    assert not list((tmp_path / "mine").iterdir())


@pytest.mark.parametrize(
    ("module", "extra", "command"),
    [
        ("embreex", "viewer", ["pose", *AT, "--png", "a.png"]),
        ("pyarrow", "parquet", ["campaign", "simulate", "--random", "20", "--out", "a.parquet"]),
        ("distributed", "distributed", ["sweep", ROOT / "examples" / "sweep.yaml", "--out", "s", "--workers", "1"]),
    ],
)
def test_what_is_not_installed_is_named_with_its_extra(run, monkeypatch, tmp_path, module, extra, command):
    for name in [name for name in sys.modules if name.partition(".")[0] == module]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, module, None)  # Python's own way to say that there is none
    code, _, err = run(*command)
    assert code == 2
    assert err.splitlines()[-1].endswith(f"which is not installed: pip install 'pouring_robot[{extra}]'")
    assert not list(tmp_path.iterdir())


def test_the_extras_are_those_of_the_package():
    with (ROOT / "pyproject.toml").open("rb") as file:
        project = tomllib.load(file)["project"]
    listed = {
        re.match(r"[\w-]+", line)[0].replace("scikit-learn", "sklearn"): extra
        for extra, lines in project["optional-dependencies"].items()
        for line in lines
        if extra not in ("all", "dev", "docs")
    }
    assert listed == EXTRAS
    assert not any(line.startswith(tuple(EXTRAS)) for line in project["dependencies"])


def test_a_pose_needs_none_of_the_extras(run, monkeypatch):
    for module in ("embreex", "pyarrow", "distributed", "dask", "sklearn", "statsmodels"):
        monkeypatch.setitem(sys.modules, module, None)
    assert run("pose", *AT, "--model", ACTUAL, "--html", "a.html")[0] == 0
