"""Every kind of input file, damaged at random, is read or refused in one line; the study reads many more."""

import pytest

from pouring_robot.exceptions import BadInputError
from scripts.studies.fuzz_files import Kind, fuzz, kinds, outcome

KNOWN = kinds()


@pytest.mark.parametrize("name", KNOWN)
def test_a_damaged_file_is_read_or_refused_in_one_line(name):
    tally = fuzz(KNOWN[name], seed=7, count=15)
    assert not tally.faults
    assert tally.read + tally.refused == 15
    assert tally.refused


@pytest.mark.parametrize(
    "fault", [KeyError("x"), BadInputError(2000 * "x"), BadInputError(""), MemoryError(), OSError(1)]
)
def test_the_study_sees_faults(tmp_path, fault):
    def read(path):
        raise fault

    assert outcome(read, tmp_path) not in ("read", "refused")


def test_the_study_sees_a_crash_and_what_is_left_behind():
    import os

    calls = {"dies": lambda path: os._exit(9), "litters": lambda path: path.with_name("half.part").write_bytes(b"")}
    for read in calls.values():
        first = []

        def once_sound(path, read=read, first=first):
            return read(path) if first else first.append(1)

        tally = fuzz(Kind("a.yaml", b"a: 1", once_sound), seed=1, count=2)
        assert sum(tally.faults.values()) == 2
