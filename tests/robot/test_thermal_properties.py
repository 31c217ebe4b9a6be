"""The file of thermal properties."""

import pytest

from pouring_robot.exceptions import DescriptionError, TemperatureError
from pouring_robot.io.temperatures import REFERENCE_DEGC, kelvin
from pouring_robot.robot.description.urdf import description_folder
from pouring_robot.robot.pouring.layout import load_layout
from pouring_robot.robot.pouring.thermal_properties import ThermalProperties, load_thermal_properties
from pouring_robot.thermal.network.thermal_network import ThermalNetwork

PAPER = {
    "melt.temperature": 1700.0,
    "ambient.temperature": 20.0,
    "ambient.film_coefficient": 12.5,
    "steel.conductivity": 60.0,
    "steel.expansion": 1.2e-5,
    "insulation.conductivity": 0.055,
    "insulation.expansion": 2e-6,
    "steel.emissivity": 0.8,
}


def test_shipped_file_holds_the_papers_figures():
    properties = load_thermal_properties().model_dump()
    for key, value in PAPER.items():
        section, name = key.split(".")
        entry = properties[section][name]
        assert entry["value"] == value
        assert entry["source"] in ("paper", "inferred")


def test_every_assumption_is_explained():
    for section in load_thermal_properties().model_dump().values():
        for entry in section.values():
            assert entry["source"] == "paper" or entry["note"]


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("emissivity: {value: 0.8", "emissivity: {value: 1.2", "melt.emissivity"),
        ("temperature: {value: 1700", "temperature: {value: -300", "melt.temperature"),
        ("conductivity: {value: 60", "conductivity: {value: 0", "steel.conductivity"),
        ("conductivity: {value: 60", "conductivty: {value: 60", "did you mean 'conductivity'"),
        ("unit: W/m2K", "unit: W/mK", "ambient.film_coefficient.unit"),
        ("value: 12.5", 'value: "12.5"', "ambient.film_coefficient.value"),
    ],
)
def test_a_wrong_file_is_refused_in_one_line(tmp_path, old, new, says):
    path = tmp_path / "thermal.yaml"
    text = (description_folder() / "config" / "thermal.yaml").read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(DescriptionError) as caught:
        load_thermal_properties(path)
    message = str(caught.value)
    assert says in message
    assert "line " in message
    assert "\n" not in message


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(DescriptionError, match=r"nothing\.yaml"):
        load_thermal_properties(tmp_path / "nothing.yaml")


@pytest.mark.parametrize("value", [-273.16, float("nan"), float("inf")])
def test_impossible_temperatures(value):
    with pytest.raises(TemperatureError, match="melt"):
        kelvin(value, "melt")
    assert kelvin(-273.15) == 0.0


def test_a_shell_as_thick_as_the_wall_is_refused(drawing):
    content = load_thermal_properties().model_dump()
    wall = load_layout().ladle.wall.metres
    content["ladle"]["shell_thickness"]["value"] = wall * 1e3
    with pytest.raises(Exception, match="shell_thickness of 50 mm"):
        ThermalNetwork(drawing, ThermalProperties.model_validate(content))


def test_drawing_campaigns_and_plans_have_the_same_reference_temperature():
    assert load_thermal_properties().expansion.reference_temperature.value == REFERENCE_DEGC
