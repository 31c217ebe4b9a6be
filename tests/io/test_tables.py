"""One reader for all tables: the same cells from CSV and Parquet, and errors of one line."""

import math
from decimal import Decimal

import numpy as np
import pandas as pd
import pytest

from pouring_robot.exceptions import CampaignError, TableError
from pouring_robot.io.quantity_columns import Quantity, read_quantities
from pouring_robot.io.tables import csv_text, read_table, table_of
from pouring_robot.io.units import UNITS, to_inner
from pouring_robot.robot.command_table import read_pose_lines


def test_lines_and_cells_of_a_csv_file(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text('\n a_mm ,b\n1,"x\ny"\n\n2\n')
    table = read_table(path, "a_mm")
    assert table.headings == ("a_mm", "b") and table.heading_line == 2
    assert table.lines.tolist() == [4, 6]
    assert table.numbers(0).tolist() == [1.0, 2.0]
    assert table.labels(1) == ("x y", "")
    with pytest.raises(TableError, match="line 4, column b: 'x y' is not a finite number") as caught:
        table.numbers(1)
    assert (caught.value.line, caught.value.column) == (4, "b")
    with pytest.raises(CampaignError, match=r"line 6: 1 cells for 2 columns; is the row cut off\?"):
        read_table(path, "a_mm", CampaignError, short_rows=False)


def refused(table, index, words):
    """Neither reading of a column takes its cells."""
    for sparse in (False, True):
        with pytest.raises(TableError, match=words):
            table.numbers(index, sparse=sparse)


def test_numbers_beyond_any_quantity_are_refused(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text("a_mm,time_s\n1e9,1e9\n-1.1e9,-1.1e9\n")
    table = read_table(path, "a_mm")
    refused(table, 0, r"line 3, column a_mm: -1.1e\+09 is larger than any quantity \(limit 1e\+09\)")
    assert table.numbers(1).tolist() == [1e9, -1.1e9]  # as times since 1970 are


def test_poses_from_parquet(tmp_path):
    frame = pd.DataFrame({"x_mm": [-100.0, 0.0], "y_mm": [20, 0], "z_mm": [-600.0, -500.0], "tilt_deg": [30.0, None]})
    frame.iloc[:1].to_parquet(tmp_path / "one.parquet", index=False)
    (pose,) = read_pose_lines(tmp_path / "one.parquet").values()
    assert pose.to_mm_deg() == pytest.approx((-100.0, 20.0, -600.0, 30.0), abs=1e-12)
    frame.to_parquet(tmp_path / "two.parquet", index=False)
    with pytest.raises(TableError, match=r"line 2, column tilt_deg: '(nan)?' is not a finite number"):
        read_pose_lines(tmp_path / "two.parquet")


def excel(monkeypatch, **sheets):
    """Have any Excel file hold these sheets, rows of cells each; an empty one is "", one with an error NaN."""

    def read_excel(path, sheet_name, header, dtype, keep_default_na=True):
        missing = ["", "NA"] if keep_default_na else []
        return {name: pd.DataFrame(rows, dtype=object).replace(missing, math.nan) for name, rows in sheets.items()}

    monkeypatch.setattr(pd, "read_excel", read_excel)


def test_the_one_sheet_of_an_excel_file_that_is_not_empty(tmp_path, monkeypatch):
    rows = [["x_mm", "y_mm", "z_mm", "tilt_deg"], [-100, 20, -600.0, 30], [""] * 4, [0, 0, "low", 0]]
    excel(monkeypatch, blank=[["", " "]], poses=rows, Sheet3=[])
    table = read_table(tmp_path / "poses.xlsx", "x_mm")
    assert table.lines.tolist() == [2, 4]
    assert table.numbers(0).tolist() == [-100.0, 0.0]
    with pytest.raises(TableError, match="line 4, column z_mm: 'low'"):
        table.numbers(2)


def test_words_and_errors_in_excel_cells_are_not_missing_values(tmp_path, monkeypatch):
    excel(monkeypatch, poses=[["session", "x_mm", "y_mm"], ["NA", "", "NA"], ["B", math.nan, 1]])
    table = read_table(tmp_path / "poses.xlsx", "x_mm")
    assert table.labels(0) == ("NA", "B")
    with pytest.raises(TableError, match="line 3, column x_mm: 'an error of Excel' is not a usable number"):
        table.numbers(1, sparse=True)
    with pytest.raises(TableError, match="line 2, column y_mm: 'NA' is not a usable number"):
        table.numbers(2, sparse=True)


def test_labels_that_pandas_made_floats_of_are_those_they_were(tmp_path):
    """Of whole numbers and empty cells pandas makes floats, and writes 0.0 for 0."""
    path = tmp_path / "t.csv"
    pd.DataFrame({"sample": [0, 1, 20], "distance_from": [None, 0, 1]}).to_csv(path, index=False)
    assert path.read_text().splitlines()[2] == "1,0.0"
    table = read_table(path, "sample")
    assert table.labels(0) == ("0", "1", "20") and table.labels(1) == ("", "0", "1")
    path.write_text("sample,b\n1.05,v2.0\n")
    assert [read_table(path, "sample").labels(k) for k in (0, 1)] == [("1.05",), ("v2.0",)]


def test_an_excel_file_of_several_sheets_is_refused_and_of_none_is_empty(tmp_path, monkeypatch):
    excel(monkeypatch, readme=[["about"]], one=[["x_mm"], [1]], blank=[])
    with pytest.raises(TableError, match=r"has the sheets 'readme', 'one'; keep the one with the table, or save"):
        read_table(tmp_path / "poses.xlsx", "x_mm")
    excel(monkeypatch, blank=[])
    with pytest.raises(TableError, match="is empty; line 1 must name the columns"):
        read_table(tmp_path / "poses.xlsx", "x_mm")


def test_a_data_frame_holds_numbers_of_any_kind_and_columns_in_its_index(tmp_path):
    frame = pd.DataFrame({"session": ["a", "b"], "x_mm": pd.Series([np.float32(0.5), Decimal("1.5")], dtype=object)})
    table = table_of(frame.set_index("session"), tmp_path)
    assert table.headings == ("session", "x_mm") and table.labels(0) == ("a", "b")
    assert table.numbers(1).tolist() == [0.5, 1.5]


def test_semicolons_and_decimal_commas_are_told(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text("x_mm;y_mm\n1,5;2,5\n")
    with pytest.raises(TableError, match=r"line 2: 3 cells for 1 columns \(columns must be parted by commas, and the"):
        read_table(path, "x_mm")
    path.write_text('x_mm,y_mm\n"-2658,2581","1,2,3"\n')
    table = read_table(path, "x_mm")
    refused(table, 0, r"column x_mm: '-2658,2581' is not a number: the decimal mark must be a point")
    refused(table, 1, r"column y_mm: '1,2,3' is not a")


def test_excel_without_its_package_or_damaged_is_one_line(tmp_path):
    path = tmp_path / "poses.xlsx"
    path.write_bytes(b"no workbook")
    with pytest.raises(
        TableError, match=r"(Import openpyxl.* Or save the table as CSV|is not an Excel file, or a damaged one)"
    ) as caught:
        read_pose_lines(path)
    assert "\n" not in str(caught.value)


def test_every_unit_is_known_once_and_the_first_is_the_inner_one():
    names = [unit for units in UNITS.values() for unit in units]
    assert len(set(names)) == len(names)
    for units in UNITS.values():
        assert not units or next(iter(units.values())) == (1.0, 0.0)
    assert to_inner(np.array([1.5]), "min").tolist() == pytest.approx([90.0], rel=1e-15)
    assert to_inner(np.array([300.0]), "K").tolist() == pytest.approx([26.85], abs=1e-12)


def test_quantities_that_come_all_or_none(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text("u_mm,mine\n1,2\n")
    pair = [Quantity(name, "length", part_of="a point") for name in ("u", "v")]
    with pytest.raises(TableError, match="line 1, column v_m: the column is missing; a point needs u and v"):
        read_quantities(path, pair, "u_mm")
    path.write_text("u_mm,v_m,mine\n1,,2\n")
    read = read_quantities(path, pair, "u_mm")
    assert read.unknown == ("mine",) and read.headings == {"u": "u_mm", "v": "v_m"}
    assert read.numbers["u"].tolist() == [0.001] and np.isnan(read.numbers["v"]).all()


def test_what_is_written_is_read_again(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text(csv_text(["a", "b"], [['x, "y"', 1.5], [None, 2]]), encoding="utf-8")
    table = read_table(path, "a")
    assert table.labels(0) == ('x, "y"', "") and table.numbers(1).tolist() == [1.5, 2.0]
