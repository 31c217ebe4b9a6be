"""Thermometers that came off, got stuck or were hardly read are found, and cooling or warming raises no alarm."""

import dataclasses

import numpy as np
import pytest

from pouring_robot.checks.thermometers import check_thermometers

PARTS = ("leg1", "leg2", "leg3", "leg4", "platform")
HALL = 20.0


@pytest.fixture
def campaign(clean):
    """Sixty rows on a machine that is 60 K and more above the hall."""
    random, count = np.random.default_rng(0), len(clean.campaign)
    read = {name: 80.0 + 10.0 * k + random.normal(0.0, 0.3, count) for k, name in enumerate(PARTS)}
    return clean.campaign.with_conditions(ambient=HALL + random.normal(0.0, 0.1, count), **read)


def told(campaign):
    return [(str(flag.code), flag.rows) for flag in check_thermometers(campaign)]


def in_the_air(campaign, name, rows):
    values = np.array(campaign.conditions[name])
    values[rows] = HALL + np.random.default_rng(1).normal(0.0, 0.3, values.size)[rows]
    return campaign.with_conditions(**{name: values})


@pytest.mark.parametrize("first, last", [(40, 60), (0, 20), (30, 33)])
@pytest.mark.parametrize("name", ["leg2", "platform"])
def test_a_sensor_that_hangs_in_the_air_is_reported_with_its_rows(campaign, name, first, last):
    """It came off, was put on late, or both; this includes the hottest one."""
    broken = in_the_air(campaign, name, slice(first, last))
    assert told(broken) == [("column_jump", tuple(range(first, last)))]
    lost = np.array(broken.conditions[name])
    lost[[max(first - 1, 0), last - 1]] = np.nan  # empty cells next to it do not hide it
    rows = tuple(row for row in range(first, last) if np.isfinite(lost[row]))
    assert told(broken.with_conditions(**{name: lost})) == [("column_jump", rows)]


def test_two_of_five_sensors_that_came_off_at_once_are_both_found(campaign):
    both = in_the_air(in_the_air(campaign, "leg2", slice(40, None)), "leg3", slice(40, None))
    assert told(both) == [("column_jump", tuple(range(40, 60)))] * 2


def test_a_machine_that_cools_raises_no_alarm(campaign):
    assert told(campaign) == []
    read = {name: np.array(campaign.conditions[name]) for name in PARTS}
    # A night between two rows: slender parts are cold, thick ones still warm.
    for name, left in zip(PARTS, (0.02, 0.02, 0.4, 0.4, 0.5), strict=True):
        read[name][30:] = HALL + left * (read[name][30:] - HALL)
    assert told(campaign.with_conditions(**read)) == []
    # The ladle is lifted off: the sensor of the melt hangs in the air, and nothing else has changed.
    melt = 1500.0 + np.random.default_rng(2).normal(0.0, 3.0, len(campaign))
    assert told(in_the_air(campaign.with_conditions(melt=melt), "melt", slice(30, None))) == []
    # A single part was heated, in a pause.
    cold = {name: HALL + (read[name] - read[name].mean()) * 0.01 for name in PARTS}
    cold["leg2"][30:] += 60.0
    assert told(campaign.with_conditions(**cold)) == []


@pytest.mark.parametrize("every, hung", [(60, False), (2, False), (1, True)])
def test_a_sensor_that_was_hardly_read_is_not_stuck(campaign, every, hung):
    """Where it was read in half of the rows or fewer, its other values are unknown."""
    warming = {name: campaign.conditions[name] + np.linspace(0.0, 20.0, 60) for name in PARTS}
    one = np.where(np.arange(60) % every == 0, 95.0, np.nan)
    flags = list(check_thermometers(campaign.with_conditions(**warming | {"leg1": one})))
    assert [str(flag.code) for flag in flags] == ["stuck_column"] * hung
    assert all("is 95 in every reading, while 4 other" in flag.message for flag in flags)


def elsewhere(campaign, change):
    """Return the campaign with the temperatures of hall and parts changed."""
    return campaign.with_conditions(**{name: change(campaign.conditions[name]) for name in ("ambient", *PARTS)})


def headed_in_kelvin(campaign, name):
    return dataclasses.replace(campaign, headings={**campaign.headings, name: f"{name}_K"})


def units(campaign):
    flags = [flag for flag in check_thermometers(campaign) if flag.code == "condition_unit"]
    return [(str(flag.severity), *flag.columns) for flag in flags]


@pytest.mark.parametrize("hall_degC, odd", [(50.0, False), (60.0, True), (100.0, True)])
def test_a_hall_temperature_near_a_furnace_is_a_warning_and_not_refused(campaign, hall_degC, odd):
    """It cannot be distinguished from °F where no part is colder; in kelvin its unit is beyond doubt."""
    hot = elsewhere(campaign, lambda values: values + hall_degC - HALL)
    assert units(hot) == [("warning", "ambient_degC")] * odd
    assert all("ambient_K" in flag.remedy for flag in check_thermometers(hot))
    assert told(headed_in_kelvin(hot, "ambient")) == []


def test_a_hall_in_fahrenheit_is_refused_where_parts_are_colder(campaign):
    """Nothing cools the parts below the hall."""
    cooled = {name: 0.1 * (campaign.conditions[name] - HALL) + HALL for name in PARTS}
    fahrenheit = 1.8 * campaign.conditions["ambient"] + 32.0
    assert units(campaign.with_conditions(ambient=fahrenheit, **cooled)) == [("error", "ambient_degC")]


def test_a_hall_that_warms_faster_than_the_parts_is_not_taken_for_exchanged(campaign):
    warming = np.linspace(45.0, 65.0, len(campaign)) + 0.01 * campaign.conditions["ambient"]
    lagging = {name: 0.6 * warming + 10.0 + 0.01 * campaign.conditions[name] for name in PARTS}
    assert {code for code, _ in told(campaign.with_conditions(ambient=warming, **lagging))} <= {"condition_unit"}


@pytest.mark.parametrize(
    ("name", "shift", "in_kelvin", "severity"),
    [
        ("ambient", 273.15, False, "error"),
        ("ambient", -273.15, True, "error"),  # °C under a heading in K
        ("ambient", 480.0, False, "error"),  # in no unit
        ("leg2", -273.15, True, "warning"),
        ("melt", 473.15, False, "warning"),  # steel at 1700 °C
        ("melt", 200.0, False, None),
        ("melt", -1480.0, False, None),  # a ladle that is empty or holds water
    ],
)
def test_temperatures_impossible_for_hall_or_melt_are_in_another_unit(campaign, name, shift, in_kelvin, severity):
    read = campaign.with_conditions(melt=1500.0 + campaign.conditions["ambient"] - HALL)
    wrong = read.with_conditions(**{name: read.conditions[name] + shift})
    heading = f"{name}_{'K' if in_kelvin else 'degC'}"
    assert units(headed_in_kelvin(wrong, name) if in_kelvin else wrong) == [(severity, heading)] * bool(severity)


LIKE = dict(zip(PARTS, (1.0, 0.9, 1.2, 1.1, 0.6), strict=True))  # how warm a part becomes, in proportion


def warming(campaign, begin_K, end_K):
    """Return the campaign of a machine that warms, each part in proportion, by thermometers with 0.3 K of noise."""
    course, random = np.linspace(begin_K, end_K, len(campaign)), np.random.default_rng(3)
    off = {name: random.normal(0.0, 0.3, len(campaign)) for name in PARTS}
    return campaign.with_conditions(**{name: HALL + LIKE[name] * course + off[name] for name in PARTS})


@pytest.mark.parametrize(
    ("scale", "of_degC"), [("degrees Fahrenheit", lambda v: 1.8 * v + 32.0), ("kelvin", lambda v: v + 273.15)]
)
@pytest.mark.parametrize("names", [PARTS[:3], PARTS[:4], PARTS])
def test_several_parts_in_another_unit_are_found_where_the_machine_begins_cold(campaign, names, scale, of_degC):
    """They begin at 68 °F or 293 K, as the hall of 20 °C."""
    cold = warming(campaign, 0.0, 120.0)
    assert units(cold) == []
    wrong = cold.with_conditions(**{name: of_degC(cold.conditions[name]) for name in names})
    assert units(wrong) == [("warning", f"{name}_degC") for name in names]
    assert all(f"hold {scale} under" in flag.message for flag in check_thermometers(wrong))
    gaps = {name: np.where(np.arange(60) % 7 == k, np.nan, wrong.conditions[name]) for k, name in enumerate(PARTS)}
    assert units(wrong.with_conditions(**gaps)) == units(wrong)
    for name in names:
        wrong = headed_in_kelvin(wrong, name)  # its unit is beyond doubt
    assert units(wrong) == []


@pytest.mark.parametrize("begin_K", [0.0, 15.0, 120.0])
@pytest.mark.parametrize("name", PARTS[:4])
@pytest.mark.parametrize("read", [PARTS, PARTS[:3]])
def test_a_leg_in_kelvin_is_found_by_the_others_wherever_the_machine_begins(campaign, name, read, begin_K):
    """In °C it would be 273 K above its place among them."""
    sound = warming(campaign, begin_K, 150.0).with_conditions(**{part: None for part in PARTS if part not in read})
    assert units(sound) == []
    if name in read:
        wrong = sound.with_conditions(**{name: sound.conditions[name] + 273.15})
        assert units(wrong) == units(wrong.with_conditions(ambient=None)) == [("warning", f"{name}_degC")]
        assert all("hold kelvin under" in flag.message for flag in check_thermometers(wrong))


def test_parts_that_begin_at_the_halls_temperature_in_fahrenheit_raise_no_alarm(campaign):
    """A machine that begins 48 K warm, stays so or cools to it, or is soaked at it in every part."""
    for begin_K, end_K in ((48.0, 120.0), (48.0, 48.0), (120.0, 48.0)):
        assert units(warming(campaign, begin_K, end_K)) == []
    soaked = {name: HALL + 48.0 + 0.1 * (campaign.conditions[name] - HALL) for name in PARTS}
    assert units(campaign.with_conditions(**soaked)) == []


def test_at_most_one_in_two_hundred_machines_that_begin_warm_raises_an_alarm(campaign):
    """Legs begin up to 100 K warm and reach 100 to 250 K, different by a tenth; the platform was not read."""
    random, accused = np.random.default_rng(4), 0
    rows, count = campaign.subset(np.arange(12)).with_conditions(platform=None), 1000
    for _ in range(count):
        like, begin_K, end_K = random.normal(1.0, 0.1, 4), random.uniform(0.0, 100.0), random.uniform(100.0, 250.0)
        course = np.linspace(begin_K, end_K, 12)
        read = {name: HALL + part * course for name, part in zip(PARTS, like, strict=False)}
        accused += bool(units(rows.with_conditions(ambient=np.full(12, HALL), **read)))
    assert accused <= count / 200
