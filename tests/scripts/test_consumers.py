"""The table of other programs, for those in this environment; the whole table is in docs/export.md."""

import pytest

from scripts.studies import closure_elsewhere
from scripts.studies.consumers import PROGRAMS, REFUSED, check, main


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The exported robot in all formats."""
    place = tmp_path_factory.mktemp("consumers")
    main(["write", str(place)])
    return place


@pytest.mark.parametrize("name", [name for name, _, _ in PROGRAMS])
def test_a_program_loads_all_of_the_closed_robot(name, folder):
    rows = check(folder, [name])
    if not rows:
        pytest.skip("it is not installed here")
    ((_, _, loads, shown, mass, lip),) = rows
    assert loads.startswith("no: ") if name in REFUSED else loads == "yes"
    assert shown in ("160 of 160", "–")
    assert mass == "–" or abs(float(mass.split()[0])) < 1e-5
    assert lip == "–" or float(lip) < 1e-6


def test_engines_that_know_nothing_of_ours_close_it_where_we_do(tmp_path, monkeypatch):
    """Two poses a case of what docs/export.md has at fifty."""
    monkeypatch.setattr(closure_elsewhere, "POSES", 2)
    closure_elsewhere.main(["write", str(tmp_path)])
    rows = closure_elsewhere.check(tmp_path)
    assert len(rows) in (3, 6)  # MuJoCo is of the environment, Drake need not be
    for _, case, poses, _, apart, share in rows:
        assert poses == "2"
        assert float(apart.split()[0]) < {"drawing": 1e-6, "centres": 1e-5, "loaded": 1.0}[case]
        assert share == "–" or float(share.rstrip("%")) < 2.0
