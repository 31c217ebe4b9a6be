"""Ctrl-C ends with one line and 130, also where a library catches it or converts it to another error."""

import subprocess
import sys

import pytest

from tests.support import ROOT

# The command of each is replaced by one that meets Ctrl-C where a library has called back.
SWALLOWED = """
class Callback:
    def __del__(self):
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(10)
def command(**_):
    Callback()
    time.sleep(10)
"""
TURNED = """
def command(**_):
    try:
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(10)
    except KeyboardInterrupt:
        raise ValueError("no schema") from None
"""
FORGOTTEN = """
def command(**_):
    try:
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(10)
    except BaseException:
        logging.getLogger("library").exception("no facets")
    {then}
"""
WRITTEN = FORGOTTEN.format(then='files.write_whole("half.txt", "x")')
TOGETHER = FORGOTTEN.format(then='files.write_together({pathlib.Path("half.txt"): "x"})')
IN_NEW_FOLDER = FORGOTTEN.format(then='files.write_together({pathlib.Path("half/a.txt"): "x"})')
NOTHING = FORGOTTEN.format(then="")
FROM_TEXT = """
def command(**_):
    exec("os.kill(os.getpid(), signal.SIGINT); time.sleep(10)")
"""
TAKEN_DOWN = """
class Half:
    def __del__(self, abort=os.abort):
        abort()
sys.loading = Half()
def command(**_):
    os.kill(os.getpid(), signal.SIGINT)
    time.sleep(10)
"""
WHILE_LOADING = """
class Loading:
    def find_spec(self, name, path=None, target=None):
        if name == "pouring_robot.cli.app":
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Loading())
command = None
"""


@pytest.mark.parametrize(
    "how", [SWALLOWED, TURNED, WRITTEN, TOGETHER, IN_NEW_FOLDER, NOTHING, FROM_TEXT, TAKEN_DOWN, WHILE_LOADING]
)
def test_a_stop_is_one_line(how, tmp_path):
    start = "import logging, os, pathlib, signal, sys, time\nsignal.signal(signal.SIGINT, signal.default_int_handler)\n"
    run = "from pouring_robot import cli\nfrom pouring_robot.io import files\n"
    run += "if command: from pouring_robot.cli import app; app.app = command\n"
    (tmp_path / "stopped.py").write_text(f"{start}{how}{run}sys.exit(cli.main())", encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-m", "stopped"],
        cwd=tmp_path,
        env={"TMPDIR": str(tmp_path), "PYTHONPATH": f"{tmp_path}:{ROOT}"},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "pouring-robot: stopped\n")
    assert not list(tmp_path.glob("*fault*"))
    assert not list(tmp_path.glob("*half*"))
