"""The section `heat` of a model file: it survives a round trip, and impossible values are reported in one line."""

import pytest

from pouring_robot.exceptions import BadInputError, DescriptionError
from pouring_robot.robot.heat_section import HeatSection
from pouring_robot.robot.model import RobotModel
from pouring_robot.robot.pouring.thermal_properties import load_thermal_properties

FULL = """format: pouring_robot/model/1
heat:
  melt_degC: 1650.5
  ambient_degC: 25
  after_min: 45
  measured_degC: {leg1: 210.25, platform: 90}
  properties:
    steel: {emissivity: 0.6}
    moving_platform: {cladding_thickness: 15}
"""
WRITTEN = "robot.yaml"


def test_it_survives_a_round_trip(written, tmp_path):
    model = RobotModel.load(written(FULL))
    assert model.heat == HeatSection(
        melt_degC=1650.5,
        ambient_degC=25.0,
        after_min=45.0,
        measured_degC={"leg1": 210.25, "platform": 90.0},
        properties={"steel": {"emissivity": 0.6}, "moving_platform": {"cladding_thickness": 15.0}},
    )
    copy = RobotModel.load(model.save(tmp_path / "copy.yaml"))
    assert copy == model
    assert copy.save(tmp_path / "again.yaml").read_bytes() == (tmp_path / "copy.yaml").read_bytes()


def test_an_empty_section_is_warm_and_none_is_cold(written, tmp_path):
    warm = RobotModel.load(written("format: pouring_robot/model/1\nheat: {}\n"))
    assert warm.heat == HeatSection()
    assert RobotModel.load(warm.save(tmp_path / "copy.yaml")).heat == HeatSection()
    assert RobotModel.load(written("format: pouring_robot/model/1\n")).heat is None
    assert warm != RobotModel()


def test_properties_override_the_shipped_ones():
    shipped = load_thermal_properties()
    found = HeatSection(properties={"steel": {"emissivity": 0.6}}).thermal_properties()
    assert found.steel.emissivity.value == 0.6
    assert (found.steel.emissivity.source, found.steel.emissivity.unit) == ("assumed", "1")
    assert found.steel.conductivity == shipped.steel.conductivity
    assert HeatSection().thermal_properties() == shipped


def test_flags_replace_single_values():
    section = HeatSection(melt_degC=1650.0, after_min=45.0)
    assert section.with_values(melt_degC=1700.0, after_min=None) == HeatSection(melt_degC=1700.0)


def test_measured_temperatures_belong_to_one_moment():
    section = HeatSection(melt_degC=1650.0, after_min=45.0, measured_degC={"leg1": 100.0})
    for same in ({}, {"after_min": 45.0}, {"ambient_degC": 25.0}, {"melt_degC": 1700.0}):
        assert section.with_values(**same).measured_degC == {"leg1": 100.0}
    for other in ({"after_min": 30.0}, {"after_min": None}):
        assert section.with_values(**other) == HeatSection(melt_degC=1650.0, **other)
    assert section.with_values(after_min=30.0, measured_degC={"leg2": 90.0}).measured_degC == {"leg2": 90.0}


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("emissivity: 0.6", "emissivity: 1.6", "steel.emissivity = 1.6: Input should be less than or equal to 1"),
        ("emissivity: 0.6", "emissivity: 0", "steel.emissivity = 0: Input should be greater than 0"),
        ("emissivity: 0.6", "emisivity: 0.6", "no property 'emisivity'; did you mean 'emissivity'?"),
        ("steel:", "steal:", "no section 'steal'; did you mean 'steel'?"),
        ("thickness: 15", "thickness: -1", "moving_platform.cladding_thickness = -1 mm"),
        ("melt_degC: 1650.5", "melt_degC: -300", "-300 degC lies below absolute zero"),
        ("melt_degC: 1650.5", "melt_degC: 1.0e+9", "hotter than any melt"),
        ("melt_degC: 1650.5", "melt_degC: .nan", "finite number"),
        ("melt_degC:", "melt:", "unknown key 'heat.melt': it has no unit; write melt_degC"),
        ("after_min: 45", "after_min: 0", "0 min since the melt came is impossible"),
        ("leg1: 210.25", "leg9: 210.25", "there is no part 'leg9'"),
        ("leg1: 210.25", "leg1: -274", "-274 degC lies below absolute zero"),
        ("leg1: 210.25", "leg1: hot", "valid number"),
    ],
)
def test_mistakes_are_reported_in_one_line(written, old, new, says):
    path = written(FULL.replace(old, new))
    with pytest.raises(DescriptionError) as caught:
        RobotModel.load(path)
    message = str(caught.value)
    assert says in message and message.startswith(f"{path}: line ") and "\n" not in message


def test_impossible_flags_are_named():
    for values, says in (
        ({"melt_degC": -300.0}, "melt_degC: -300 degC lies below absolute zero"),
        ({"ambient_degC": float("inf")}, "ambient_degC"),
        ({"after_min": -5.0}, "after_min: -5 min since the melt came is impossible"),
    ):
        with pytest.raises(BadInputError, match=says):
            HeatSection().with_values(**values)
