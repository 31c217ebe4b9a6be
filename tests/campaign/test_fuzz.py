"""Damaged files never lead to a traceback: they are read, or refused in one line."""

import json
import tempfile
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pouring_robot.campaign.data import Campaign
from pouring_robot.campaign.plan import read_plan
from pouring_robot.checks.check import campaign_metrics, examine
from pouring_robot.exceptions import BadInputError

FUZZ = settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
NASTY = (
    b"",
    b",",
    b"\n",
    b"\r",
    b'"',
    b"\x00",
    b"\xff",
    b"nan",
    b"inf",
    b"-",
    b"1e308",
    b"0",
    b":",
    b"{",
    b"&a *a ",
    b"9" * 30,
)


@pytest.fixture(scope="module")
def sound(tmp_path_factory, clean):
    """Return bytes of a sound table, CSV and Parquet, and of its YAML file."""
    folder = tmp_path_factory.mktemp("sound")
    campaign = clean.campaign.subset(range(25))
    campaign.save(folder / "c.csv")
    campaign.save(folder / "p.parquet")
    return {path.suffix: path.read_bytes() for path in folder.iterdir()}


@st.composite
def damages(draw):
    """Return places (shares of the length), lengths and replacements."""
    places = st.floats(0.0, 1.0, allow_nan=False)
    pieces = st.one_of(st.sampled_from(NASTY), st.binary(max_size=6))
    return draw(st.lists(st.tuples(places, st.integers(0, 40), pieces), min_size=1, max_size=4))


def spoil(content, changes):
    for share, length, piece in changes:
        at = int(share * len(content))
        content = content[:at] + piece + content[at + length :]
    return content


def examine_files(drawing, table, metadata, suffix):
    """Read and check; only a BadInputError may come out, in one line."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"c{suffix}"
        path.write_bytes(table)
        path.with_suffix(".yaml").write_bytes(metadata)
        try:
            campaign = Campaign.read(path)
        except BadInputError as error:
            assert "\n" not in str(error)
            assert path.stem in str(error)
            return
        found = examine(campaign, drawing.kinematics)
        json.dumps(campaign_metrics(campaign, found), allow_nan=False)
        assert all("\n" not in str(flag) for flag in found.flags)


@FUZZ
@given(changes=damages())
def test_damaged_csv(drawing, sound, changes):
    examine_files(drawing, spoil(sound[".csv"], changes), sound[".yaml"], ".csv")


@FUZZ
@given(changes=damages())
def test_damaged_yaml(drawing, sound, changes):
    examine_files(drawing, sound[".csv"], spoil(sound[".yaml"], changes), ".csv")


@FUZZ
@given(changes=damages())
def test_damaged_parquet(drawing, sound, changes):
    examine_files(drawing, spoil(sound[".parquet"], changes), sound[".yaml"], ".parquet")


CELLS = st.one_of(
    st.sampled_from(["", "0", "-0", "1e9", "-1e9", "1e-300", "nan", "0.55", "550", "360", "x"]),
    st.floats(-2e3, 2e3, allow_nan=False).map(repr),
)


@FUZZ
@given(rows=st.lists(st.lists(CELLS, min_size=10, max_size=10), min_size=1, max_size=30))
def test_any_numbers(drawing, sound, rows):
    header = "q1_mm,q2_mm,q3_mm,q4_rad,x_mm,y_mm,z_mm,rx_rad,ry_rad,rz_rad"
    table = "\n".join([header, *(",".join(row) for row in rows)])
    examine_files(drawing, table.encode(), sound[".yaml"], ".csv")


@FUZZ
@given(changes=damages())
def test_damaged_plan(drawing, changes):
    plan = b"x_mm,y_mm,z_mm,tilt_deg,payload_kg\n" + b"-100,0,-600,10,300\n" * 5
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "p.csv"
        path.write_bytes(spoil(plan, changes))
        try:
            read_plan(path, drawing)
        except BadInputError as error:
            assert "\n" not in str(error)
