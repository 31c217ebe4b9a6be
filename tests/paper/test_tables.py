"""The slot for the paper's tables: values that a reader enters are compared, wrong ones are refused."""

import pytest

from pouring_robot.exceptions import DescriptionError
from pouring_robot.robot.model import RobotModel
from scripts.paper.geometry import parameter_claims, size_claims
from scripts.paper.geometry.study import run_open_study
from scripts.paper.tables import TABLES_FILE, PaperTables, load_tables


@pytest.fixture(scope="module")
def opened():
    return run_open_study(RobotModel(), 50, 5, chain=1)


def test_only_table_1_is_known():
    known = load_tables()
    assert known.table_1 is not None and known.table_1["56"] == "lower U joint"
    assert (known.table_3, known.poses_mm, known.eigenvalues) == (None, None, None)


def test_a_wrong_row_of_table_1_is_seen(opened, monkeypatch):
    assert parameter_claims.meanings(opened).verdict == "reproduced"
    wrong = load_tables().table_1 | {"56": "fixed rod"}
    monkeypatch.setattr(parameter_claims, "load_tables", lambda: PaperTables(table_1=wrong))
    claim = parameter_claims.meanings(opened)
    assert claim.verdict == "differs" and claim.figures["disagree"] == ["56"]


def test_table_3_is_compared_where_a_reader_has_it(opened, monkeypatch):
    for cells, verdict in (({"α56": (1.0, 1e-3), "a01": (0.1, 0.0)}, "reproduced"), ({"a01": (1.0, 0.0)}, "differs")):
        monkeypatch.setattr(size_claims, "load_tables", lambda cells=cells: PaperTables(table_3=cells))
        assert size_claims.table_3_cells(opened, opened.open_branch).verdict == verdict


def test_a_wrong_file_is_refused(tmp_path):
    path = tmp_path / "tables.yaml"
    path.write_text(TABLES_FILE.read_text(encoding="utf-8").replace("poses_mm: null", "poses_mm: [[1, 2, 3]]"))
    with pytest.raises(DescriptionError, match="poses_mm"):
        load_tables(path)
    path.write_text("table_1: {O0: platform}\n")
    with pytest.raises(DescriptionError, match="a row for each"):
        load_tables(path)
