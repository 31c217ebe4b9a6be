"""Reading campaigns: units, missing cells, Parquet, and errors that name file, line and column."""

import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from pouring_robot.campaign.data import Campaign
from pouring_robot.exceptions import BadInputError, CampaignError, DescriptionError
from tests.campaign.simulated import write_text

HEADER = "sample,session,time_s,q1_mm,q2_mm,q3_mm,q4_rad,x_mm,y_mm,z_mm"
ROW = "a,1,5.0,550.5,553.7,706.2,-0.0859,1.5,2.5,3.5"


def test_reads_si_units_missing_cells_and_lines(tmp_path):
    path = write_text(tmp_path, HEADER, [ROW, "", "b,2,,550.5,553.7,706.2,-0.0859,1.5,,nan"])
    campaign = Campaign.read(path)
    assert len(campaign) == 2
    assert campaign.lines.tolist() == [2, 4]
    assert campaign.samples == ("a", "b")
    assert campaign.sessions == ("1", "2")
    np.testing.assert_allclose(campaign.drives[0], [0.5505, 0.5537, 0.7062, -0.0859], rtol=1e-15)
    np.testing.assert_allclose(campaign.position_m[0], [0.0015, 0.0025, 0.0035], rtol=1e-15)
    assert campaign.position_measured.tolist() == [[True] * 3, [True, False, False]]
    assert not campaign.full_pose
    assert not campaign.rotation_measured.any()
    assert np.isnan(campaign.time_s[1])
    assert campaign.payload_kg is None
    assert campaign.usable.all()
    assert campaign.metadata.sigma_position_m == 5e-5
    assert "payload_kg" in campaign.missing_conditions()
    assert "leg1_degC" in campaign.missing_conditions()
    assert "time_s" not in campaign.missing_conditions()


def test_is_immutable(clean):
    with pytest.raises(ValueError, match="read-only"):
        clean.campaign.drives[0, 0] = 1.0
    with pytest.raises(AttributeError):
        clean.campaign.drives = None


UNITS = {
    "q1": (0.5505, {"m": 1.0, "mm": 1e3}),
    "q4": (-0.0859, {"rad": 1.0, "mrad": 1e3, "deg": 180 / np.pi}),
    "truss_travel": (2.5, {"m": 1.0, "mm": 1e3}),
    "x": (0.125, {"m": 1.0, "mm": 1e3, "um": 1e6, "in": 1.0 / 0.0254}),
    "rx": (0.01, {"rad": 1.0, "mrad": 1e3, "deg": 180 / np.pi}),
}
BASE = {
    "q1_m": 0.5505,
    "q2_m": 0.5537,
    "q3_m": 0.7062,
    "q4_rad": -0.0859,
    "truss_travel_m": 2.5,
    "leg1_degC": 80.0,
    "x_m": 0.125,
    "y_m": 0.2,
    "z_m": 0.3,
    "rx_rad": 0.01,
    "ry_rad": 0.02,
    "rz_rad": 0.03,
}


@pytest.mark.parametrize(("name", "unit"), [(name, unit) for name, (_, units) in UNITS.items() for unit in units])
def test_every_unit_gives_the_same_si_value(tmp_path, name, unit):
    value, units = UNITS[name]
    cells = {key: number for key, number in BASE.items() if key.rpartition("_")[0] != name}
    cells[f"{name}_{unit}"] = value * units[unit]
    campaign = Campaign.read(write_text(tmp_path, ",".join(cells), [",".join(map(repr, map(float, cells.values())))]))
    assert campaign.quantity(name)[0] == pytest.approx(value, rel=1e-15)
    assert campaign.heading(name) == f"{name}_{unit}"


def test_temperatures_in_kelvin(tmp_path):
    cells = {key: value for key, value in BASE.items() if key != "leg1_degC"} | {"leg1_K": 353.15}
    campaign = Campaign.read(write_text(tmp_path, ",".join(cells), [",".join(map(str, cells.values()))]))
    assert campaign.conditions["leg1"][0] == pytest.approx(80.0, abs=1e-12)
    assert not {"leg2", "leg3", "leg4"} & set(campaign.conditions)


@pytest.mark.parametrize(
    ("header", "row", "words"),
    [
        (HEADER.replace("q1_mm", "q1_kg"), ROW, ["line 1", "'q1_kg'", "q1_m or q1_mm"]),
        (HEADER.replace("q1_mm", "q1"), ROW, ["line 1", "'q1'", "no unit"]),
        (HEADER.replace("q1_mm,", ""), ROW.replace("550.5,", ""), ["'q1_m'", "missing"]),
        (
            HEADER.replace("q1", "l1") + ",leg1_K",
            ROW + ",300",
            ["'q1_m'", "add q1_m or q1_mm or q1_um or q1_in, or rename 'l1_mm'"],
        ),
        (
            HEADER.replace("x_mm", "operator"),
            ROW,
            ["'x_m'", "add x_m or x_mm or x_um or x_in or distance_m or distance_mm"],
        ),
        (HEADER + ",q1_m", ROW + ",0.5", ["'q1_m'", "is already given as 'q1_mm'"]),
        (HEADER + ",q1_mm", ROW + ",0.5", ["'q1_mm'", "twice"]),
        (HEADER + ",payload_kgs", ROW + ",5", ["'payload_kgs'", "payload_kg"]),
        (HEADER + ",Leg1_degc", ROW + ",5", ["'Leg1_degc'", "did you mean 'leg1_degC'"]),
        (HEADER + ",rx_rad,ry_rad", ROW + ",5,5", ["'rz_rad'", "missing"]),
        (HEADER, ROW.replace("553.7", "55x"), ["line 2", "'q2_mm'", "'55x'"]),
        (HEADER, ROW.replace("553.7", "inf"), ["line 2", "'q2_mm'", "'inf'"]),
        (HEADER, ROW.replace("553.7", "1_000"), ["line 2", "'q2_mm'"]),
        (HEADER, ROW.replace("553.7", "1e300"), ["line 2", "'q2_mm'", "1e+300 is larger", "check the unit"]),
        (HEADER, ROW + ",7", ["line 2", "11 cells"]),
        (HEADER, "a,1,5.0,550", ["line 2", "cut off"]),
        (HEADER, ROW.replace("a,1,", "a,,"), ["line 2", "'session'"]),
        (HEADER + ",leg1_K", ROW + ",-5", ["line 2", "'leg1_K'", "absolute zero"]),
        (HEADER + ",leg1_degC", ROW + ",9999", ["line 2", "'leg1_degC'", "hotter than any melt", "leave the cell"]),
        (
            HEADER + ",payload_kg",
            ROW + ",-9999",
            ["line 2", "'payload_kg'", "-9999 kg is not a possible load", "0 to 10000 kg"],
        ),
        (
            HEADER + ",payload_kg",
            ROW + ",1e6",
            ["line 2", "'payload_kg'", "1e+06 kg is not a possible load", "check value"],
        ),
        (HEADER, "", ["holds no row"]),
        ("", "", ["empty"]),
        (HEADER.replace(",", ";"), ROW.replace(",", ";"), ["line 1", "commas"]),
        (HEADER, '"a' + ROW, ["not valid CSV"]),
        ("# made by hand", ROW, ["line 2", "begins with # is not a comment", "delete it"]),
        ("# q1_mm," + HEADER.replace("q1_mm,", ""), ROW, ["line 1", "'q1_m'", "or only the # in front of headings"]),
        (HEADER, "# a, second block", ["line 2", "begins with # is not a comment", "delete it"]),
        (HEADER, ROW.replace("5.0", "2026-03-01T10:00:00"), ["line 2", "'time_s'", "is a date", "total_seconds()"]),
        (
            HEADER.replace("time_s", "time_h"),
            ROW.replace("5.0", "10:00:30"),
            ["line 2", "'time_h'", "time of day", "since the first row"],
        ),
        (HEADER + ",payload_kg", ROW + ",10:00:30", ["line 2", "'payload_kg'", "is not a usable number"]),
    ],
)
def test_names_file_line_and_column(tmp_path, header, row, words):
    path = write_text(tmp_path, header, [row] if row else [])
    with pytest.raises(CampaignError) as caught:
        Campaign.read(path)
    message = str(caught.value)
    assert "c.csv" in message
    assert "\n" not in message
    assert caught.value.exit_code == 2
    for word in words:
        assert word in message


@pytest.mark.parametrize("days", [("31.03.2026", "01.04.2026"), ("2026-03-31 10:00", "2026-04-01 10:00")])
def test_what_is_said_of_dates_makes_times_of_them(tmp_path, days):
    """Day first, pandas otherwise takes 01.04. for the 4th of January."""
    with pytest.raises(CampaignError, match="is a date") as caught:
        Campaign.read(write_text(tmp_path, HEADER, [ROW.replace("5.0", days[1])]))
    first, then = re.search(r"in s: t = (.*?); (.*?\(\))", str(caught.value)).groups()
    t = eval(first, {"pandas": pd, "t": pd.Series([days[1], days[0]])})
    assert list(eval(then, {"t": t})) == [0.0, -86400.0]
    assert ("dayfirst" in first) == ("if the month comes first" in str(caught.value)) == ("." in days[0])


def test_a_column_of_ones_own_is_left_out_and_told(tmp_path):
    campaign = Campaign.read(write_text(tmp_path, HEADER + ",operator", [ROW + ",Kim"]))
    assert campaign.ignored_columns == ("operator",)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("metrology: {sigma_position_mm: -1}", ["sigma_position_mm", "line 1"]),
        ("metrology: {sigma_position_mm: 9.0e-6}", ["sigma_position_mm", "greater than or equal to 0.00001 "]),
        ("metrology: {sigma_rotation_rad: 9.0e-9}", ["sigma_rotation_rad", "greater than or equal to 0.00000001 "]),
        ("metrology: {sigma_positon_mm: 1}", ["did you mean 'sigma_position_mm'"]),
        ("metrology: {sigma_position_mm: 0.1, sigma_position_m: 0.1}", ["same thing"]),
        ("reference_temperature_degC: hot", ["reference_temperature_degC"]),
        ("reference_temperature_degC: 293.15", ["reference_temperature_degC", "hotter than any surroundings"]),
        ("reference_temperature_degC: -253.15", ["reference_temperature_degC", "colder than any surroundings"]),
        ("reference_temperature_K: 2000", ["reference_temperature_K", "423.15"]),
        ("reference_temperature_K: 20", ["reference_temperature_K", "183.15"]),
        ("ladle: {centre_of_mass_mm: [1, 2]}", ["centre_of_mass_mm"]),
        ("ladle: {tare_kg: 180000}", ["tare_kg", "10000"]),
        ("[1, 2]", ["mapping"]),
        ("a: [", ["not valid YAML"]),
    ],
)
def test_names_the_fault_of_the_yaml_file(tmp_path, text, words):
    path = write_text(tmp_path, HEADER, [ROW], text)
    with pytest.raises(DescriptionError) as caught:
        Campaign.read(path)
    assert "c.yaml" in str(caught.value)
    assert "\n" not in str(caught.value)
    for word in words:
        assert word in str(caught.value)


def test_yaml_units_give_the_same_metadata(tmp_path):
    first = """
metrology: {sigma_position_mm: 0.25, sigma_rotation_mrad: 0.5}
drives: {screw_pitch_mm: 10}
truss: {span_mm: 6000}
ladle: {tare_kg: 180, centre_of_mass_mm: [50, 0, -250]}
reference_temperature_K: 293.15
"""
    second = """
metrology: {sigma_position_m: 0.00025, sigma_rotation_rad: 0.0005}
drives: {screw_pitch_m: 0.010}
truss: {span_m: 6}
ladle: {tare_kg: 180, centre_of_mass_m: [0.05, 0, -0.25]}
reference_temperature_degC: 20
"""
    one = Campaign.read(write_text(tmp_path, HEADER, [ROW], first, "one")).metadata
    two = Campaign.read(write_text(tmp_path, HEADER, [ROW], second, "two")).metadata
    assert one.model_dump(exclude={"reference_temperature_degC"}) == two.model_dump(
        exclude={"reference_temperature_degC"}
    )
    assert one.reference_temperature_degC == pytest.approx(two.reference_temperature_degC, abs=1e-12)


def test_says_that_the_yaml_is_missing(tmp_path):
    path = write_text(tmp_path, HEADER, [ROW])
    path.with_suffix(".yaml").unlink()
    with pytest.raises(CampaignError, match=r"c\.yaml .* is missing"):
        Campaign.read(path)
    path.with_suffix(".yml").write_text("robot: mine\n")
    assert Campaign.read(path).metadata.robot == "mine"
    path.with_suffix(".yml").write_text("description: whose is not said\n")
    unsaid = Campaign.read(path)
    assert unsaid.metadata.robot is None
    assert "robot" not in unsaid.contents(path)[path.with_suffix(".yaml")].decode()


def test_parquet_equals_csv(tmp_path, real):
    for name in ("a.csv", "b.parquet"):
        real.campaign.save(tmp_path / name)
    one, two = (Campaign.read(tmp_path / name) for name in ("a.csv", "b.parquet"))
    assert one.metadata == two.metadata
    assert one.sessions == two.sessions
    assert one.samples == two.samples
    assert one.to_frame().equals(two.to_frame())


def test_a_frame_of_pandas_is_a_campaign_again(tmp_path, real):
    real.campaign.save(tmp_path / "a.csv")
    first = Campaign.read(tmp_path / "a.csv")
    first.to_frame().to_csv(tmp_path / "b.csv", index=False)
    (tmp_path / "b.yaml").write_bytes((tmp_path / "a.yaml").read_bytes())
    assert Campaign.read(tmp_path / "b.csv").to_frame().equals(first.to_frame())


def test_a_condition_that_no_row_says_is_none(real):
    melt = np.full(len(real.campaign), np.nan)
    melt[:5] = 1600.0
    campaign = replace(real.campaign, conditions={**real.campaign.conditions, "melt": melt})
    assert "melt" in campaign.subset([0, 9]).conditions
    assert campaign.subset([5, 9]).quantity("melt") is None


def test_subset(real):
    campaign = real.campaign
    part = campaign.subset([5, 3])
    assert part.lines.tolist() == [7, 5]
    np.testing.assert_array_equal(part.position_m, campaign.position_m[[5, 3]])
    assert len(campaign.subset(campaign.time_s > campaign.time_s[10])) == len(campaign) - 11
    for wrong in ([], [len(campaign)], [-1], [0, -2], [True, False], [0.5], 3, [[0, 1], [2, 3]]):
        with pytest.raises(BadInputError, match=f"or a mask of all {len(campaign)}"):
            campaign.subset(wrong)
