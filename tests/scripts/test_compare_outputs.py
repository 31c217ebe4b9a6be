"""When the outputs of two checkouts count as the same."""

import math

import pytest

from pouring_robot.cli.app import _MODULES
from scripts.compare_outputs import HELP, Tolerance, compare, difference, main


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("lip 1.234567890 mm", "lip 1.234567891 mm"),
        ("a  −0.000  b", "a 0.000 b"),
        ("rms 0.25", "rms 0.26"),  # one in the last printed digit
        ("1.0e-05", "1.1e-05"),
        ('"x": 0.12345678901234', '"x": 0.12345678901299'),
        ("fitted in 3.2 s", "fitted in 17.9 s"),
        ('{"seconds": 3.25, "rows": 8}', '{"seconds": 4, "rows": 8}'),
    ],
)
def test_the_same(before, after):
    assert difference(before, after, Tolerance())[1] == ""


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        ("lip 1.23456 mm", "lip 1.23466 mm", "1.23456 → 1.23466"),
        ("8 rows", "9 rows", "8 → 9"),
        ("rms 0.25", "rms 0.27", "0.25 → 0.27"),
        ("verdict: named 1", "verdict: group 1", "verdict: group 1"),
        ("one\ntwo\nthree", "one\nthree", "-two"),
        ("mm 1.00", "mrad 1.00", "+mrad 1.00"),
    ],
)
def test_different(before, after, said):
    assert said in difference(before, after, Tolerance())[1]


def test_the_largest_difference_is_told_also_where_it_is_allowed():
    assert difference("1.00 2.0000 3", "1.01 2.0001 3", Tolerance())[0] == pytest.approx(0.01 / 1.01)
    assert difference("1.00 a", "1.00 b", Tolerance())[0] == math.inf


def test_files_of_one_side_only():
    largest, faults = compare({"exit code": "code 0", "a.csv": "1"}, {"exit code": "code 2", "b.csv": "1"}, Tolerance())
    assert faults == ["a.csv: only before", "b.csv: only after", "exit code: 0 → 2 in: code 0"]
    assert largest == 1.0


def test_a_comparison_of_nothing_is_no_success():
    with pytest.raises(SystemExit) as ended:
        main([".", ".", "--only", "nothing*"])
    assert ended.value.code == 2 and {*_MODULES} == {*HELP}
