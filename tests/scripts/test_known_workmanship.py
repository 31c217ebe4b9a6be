"""What is missed beside workmanship that the diagnosis takes for coarser than it is."""

import numpy as np

from pouring_robot.inference.hypotheses import WORKMANSHIP_LEVELS
from scripts.studies.known_workmanship import finer_level, main
from tests.examiner import cases


def test_the_level_of_a_size_is_the_next_finer_one():
    assert finer_level(0.0) == 0
    assert WORKMANSHIP_LEVELS[finer_level(2.0**-6)] == 2.0**-6
    assert WORKMANSHIP_LEVELS[finer_level(1.9 * 2.0**-6)] == 2.0**-6


def test_a_zero_beside_a_coarse_screw_shows_where_workmanship_is_known(tmp_path, capsys):
    """A zero of 0.47 mm: what is found beside it says that joints are 62 um off, where they are 26 um."""
    seed, number = 64, 38
    case = cases.make(seed, number, *cases.plan(120, seed)[number])
    cases.write(case, tmp_path / "case_038", np.random.default_rng([seed, number, 10**6]))
    main([str(tmp_path)])
    said = capsys.readouterr().out
    assert "1 of 2 hidden effects are missed; who knows workmanship would name 1 of them" in said
    (row,) = (line for line in said.splitlines() if "drive_zero_offset (one home switch) 3.2" in line)
    found, known, least = (float(cell) for cell in row.split("|")[3:6])
    assert found < least < known
