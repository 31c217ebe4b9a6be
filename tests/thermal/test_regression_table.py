"""Tables of error sets: units, and one line for every possible error in one."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pouring_robot.exceptions import BadInputError, TableError
from pouring_robot.thermal.regression.table import ErrorTable

GOOD = "melt_degC,P1_mm,P2_mm\n600,1,2\n700,1.5,2.5\n800,2.5,2.75\n"
WRITTEN = "errors.csv"


@pytest.mark.parametrize(
    "content",
    [
        GOOD,
        "P1_um,melt_K, P2_m \n1000,873.15,0.002\n\n1500,973.15,0.0025\n2500,1073.15,0.00275\n,,\n",
        b"\xef\xbb\xbf" + GOOD.replace("\n", "\r\n").encode(),
    ],
    ids=["plain", "other units, order and empty lines", "byte order mark and CRLF"],
)
def test_units_ride_on_the_names(written, content):
    table = ErrorTable.read_csv(written(content))
    assert table.names == ("P1", "P2") and table.kind == "length"
    np.testing.assert_allclose(table.temperatures_K, [873.15, 973.15, 1073.15], rtol=1e-15)
    np.testing.assert_allclose(table.errors, [[1e-3, 2e-3], [1.5e-3, 2.5e-3], [2.5e-3, 2.75e-3]], rtol=1e-15)


def test_angles_and_a_second_temperature(written):
    path = written("melt_degC,ambient_degC,P1_mrad,P2_deg\n600,20,1,2\n700,20,2,3\n800,20,4,5\n")
    table = ErrorTable.read_csv(path, temperature_column="melt_degC")
    assert table.kind == "angle"
    np.testing.assert_allclose(table.errors[0], [1e-3, np.radians(2.0)], rtol=1e-15)
    with pytest.raises(TableError, match="found: melt_degC, ambient_degC"):
        ErrorTable.read_csv(path)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("", "is empty"),
        ("melt_degC,P1_mm\n", "holds 0 temperatures"),
        ("melt_degC,P1_mm\n600,1\n700,2\n", "holds 2 temperatures; 3 or more"),
        (GOOD + "900,3\n", "line 5, column P2_mm: the cell is missing"),
        (GOOD + "900,,3\n", "line 5, column P1_mm: the cell is missing"),
        (GOOD + "\n900,3,x\n", "line 6, column P2_mm: 'x' is not a finite number"),
        (GOOD + "hot,3,3\n", "line 5, column melt_degC: 'hot'"),
        (GOOD + "900,3,inf\n", "line 5, column P2_mm: 'inf'"),
        (GOOD + "900,3,-1e200\n", "column P2_mm: -1e+200 is larger than any quantity (limit 1e+09); check the unit"),
        (GOOD + "900,3,4,5\n", "line 5: 4 cells for 3 columns"),
        (GOOD + "700,3,4\n", "lines 3 and 5 have the same temperature, 700 degC"),
        (GOOD + "-300,3,4\n", "temperature -300 degC is below 0 K"),
        ("melt_degC,P1_mm,P2_mm\n600,1,2\n700,1,3\n800,1,4\n", "column P1 is constant"),
        ("melt_degC,P1,P2_mm\n600,1,2\n", "line 1: column 'P1' has no unit"),
        ("melt_degC,P1_kg\n600,1\n", "line 1: column 'P1_kg' has no unit"),
        ("melt_degC,_mm\n600,1\n", "line 1: column '_mm' has no unit"),
        ("melt_degC,P1_mm,P1_mm\n600,1,2\n", "line 1: column 'P1_mm' occurs twice"),
        ("melt_degC,P1_mm,P1_m\n600,1,2\n", "line 1: error set P1 occurs twice"),
        ("melt_degC,P1_mm,P2_mrad\n600,1,2\n", "P1_mm is a length, P2_mrad an angle"),
        ("P1_mm,P2_mm\n1,2\n", "found: none"),
        ("melt_degC\n600\n", "names no error set"),
        (b"\xff\xfe\x00", "is not a CSV file"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(written, content, words):
    path = written(content)
    with pytest.raises(TableError) as caught:
        ErrorTable.read_csv(path)
    assert words in str(caught.value) and "\n" not in str(caught.value)
    assert str(caught.value).startswith(str(path)) and caught.value.exit_code == 2


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(TableError, match="cannot be read"):
        ErrorTable.read_csv(tmp_path / "none.csv")


@given(content=st.one_of(st.text(max_size=80), st.text('0123456789.,-\n"_mKPe', max_size=60).map(lambda s: GOOD + s)))
@settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_any_text_is_read_or_refused(written, content):
    try:
        table = ErrorTable.read_csv(written(content.encode("utf-8", "replace")))
    except BadInputError as error:
        assert "\n" not in str(error)
    else:
        assert np.isfinite(table.errors).all()


def test_round_trips_and_selection(written):
    table = ErrorTable.read_csv(written(GOOD))
    again = ErrorTable.read_csv(written(table.csv().encode()))
    np.testing.assert_allclose(again.errors, table.errors, rtol=1e-15)
    np.testing.assert_allclose(again.temperatures_K, table.temperatures_K, rtol=1e-15)
    framed = table.frame()
    np.testing.assert_array_equal(framed.to_numpy(), table.errors)
    np.testing.assert_array_equal(framed.index, table.temperatures_K)
    assert table.select(["P2"]).names == table.without(["P1"]).names == ("P2",)
    with pytest.raises(TableError, match="no error set 'P9'; it has P1, P2"):
        table.select(["P9"])
    with pytest.raises(ValueError, match="read-only"):
        table.errors[0, 0] = 1.0


@pytest.mark.parametrize(
    ("temperatures", "errors", "names", "kind", "words"),
    [
        ([1.0, 2.0], [[1.0], [2.0]], ("a",), "length", "too few"),
        ([1.0, 2.0, 3.0], [[1.0], [2.0]], ("a",), "length", "shapes do not fit"),
        ([1.0, 2.0, 3.0], [[1.0], [2.0], [np.nan]], ("a",), "length", "finite"),
        ([1.0, 2.0, 2.0], [[1.0], [2.0], [4.0]], ("a",), "length", "rows 2 and 3"),
        ([1.0, 2.0, 3.0], [[1.0, 1.0], [2.0, 2.0], [4.0, 3.0]], ("a", "a"), "length", "a name of its own"),
        ([1.0, 2.0, 3.0], [[1.0], [2.0], [4.0]], ("a",), "mass", "kind 'mass'"),
        ([1.0, 2.0, 3.0], [[1.0], [1.0 + 1e-15], [1.0]], ("a",), "length", "constant"),
    ],
)
def test_arrays_are_checked_too(temperatures, errors, names, kind, words):
    with pytest.raises(TableError, match=words):
        ErrorTable(np.array(temperatures), np.array(errors), names, kind)
