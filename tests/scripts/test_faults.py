"""A command that is stopped, or cannot write, leaves complete files or none; the study tries many more cases."""

import random
import signal

import pytest

from scripts.studies.fault_places import PLACES, place_fault
from scripts.studies.fault_study import COMMANDS, Ended, Study, stop_faults

BY_NAME = {command.name: command for command in COMMANDS}
SOUND = Ended(0, "", {"a.csv": b"1", "a.yaml": b"2"})


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    return Study(tmp_path_factory.mktemp("faults"))


@pytest.mark.parametrize("what", ["SIGKILL", "SIGINT"])
@pytest.mark.parametrize(
    ("name", "in_time"), [("campaign simulate", True), ("campaign simulate", False), ("examples copy", False)]
)
def test_a_stopped_command_leaves_whole_files_or_none(study, name, what, in_time):
    _, wrong = study.stopped(BY_NAME[name], what, random.Random(5), in_time=in_time, warm=not in_time)
    assert not wrong


@pytest.mark.parametrize(
    ("place", "name"),
    [
        ("disk full from a random operation on", "examples copy"),
        ("no file may pass 4 kB", "examples copy"),
        ("cache that is a file", "pose"),  # which compiles no kernels: that would take as long as all others
        ("two runs at once", "examples copy"),
        ("output in ASCII", "campaign simulate"),
        ("output closed", "examples copy"),
        ("names of 255 bytes", "examples copy"),
    ],
)
def test_a_command_ends_right_or_with_one_line(study, place, name):
    ended, sound = PLACES[place](study, BY_NAME[name])
    assert not place_fault(ended, sound)


@pytest.mark.parametrize(
    ("ended", "fault"),
    [
        (Ended(130, "pouring-robot: stopped\n", {}), ""),
        (Ended(0, "", SOUND.left), ""),
        (Ended(130, "", {}), "exit code 130"),
        (Ended(1, 'File "<frozen site>", line 1, in main\nKeyboardInterrupt\n', {}), ""),
        (Ended(1, 'File "/a/cli/__init__.py", line 9, in main\nKeyboardInterrupt\n', {}), "exit code 1"),
        (Ended(130, "pouring-robot: stopped\n", {"a.csv": b""}), "neither whole nor absent"),
        (Ended(130, "pouring-robot: stopped\n", {".a.csv.12.part": b"1"}), "left .a.csv.12.part"),
    ],
)
def test_the_study_sees_what_an_interrupt_leaves(ended, fault):
    assert fault in "; ".join(found := stop_faults(ended, SOUND, "SIGINT"))
    assert bool(found) == bool(fault)


def test_the_study_sees_what_a_kill_leaves():
    assert not stop_faults(Ended(-signal.SIGKILL, "", {".a.csv.12.part": b"1"}), SOUND, "SIGKILL")
    assert stop_faults(Ended(-signal.SIGKILL, "", {"a.csv": b"half"}), SOUND, "SIGKILL")
    assert stop_faults(Ended(70, "", {}), SOUND, "SIGKILL")


@pytest.mark.parametrize(
    "ended",
    [
        Ended(0, "", {"a.csv": b"1"}),
        Ended(2, "pouring-robot: no\n", {"a.csv": b"half"}),
        Ended(2, "pouring-robot: no\n", {".a.csv.12.part": b"1"}),
        Ended(70, "pouring-robot: a fault\n", {}),
        Ended(2, "two\nlines\n", {}),
        Ended(-99, "", {}),
    ],
)
def test_the_study_sees_a_bad_end(ended):
    assert place_fault(ended, SOUND)
    assert not place_fault(Ended(2, "note: cold\npouring-robot: no space\n", {}), SOUND)
