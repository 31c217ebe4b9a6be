"""Materials, surfaces and contacts of the thermal model: the file ``thermal.yaml`` and its schema.

Every entry is ``{value, unit, source, note}`` as in the dimensions file. Values are SI except sizes (mm or m) and
temperatures (°C for the user, K internally).
"""

from pathlib import Path
from typing import Annotated, Literal, TypeVar

from pydantic import Field, NonNegativeFloat, PositiveFloat

from pouring_robot.io.temperatures import ABSOLUTE_ZERO_DEGC
from pouring_robot.io.typed_yaml import Entries, Entry, StrictModel, read_yaml, validate
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.robot.description.urdf import description_folder
from pouring_robot.robot.pouring.layout_schema import Density, InMetres, Share
from pouring_robot.robot.pouring.names import LEGS

PARTS = (*LEGS, "platform", "fixed_platform")
"""Parts with separate temperatures; legs and platform have the names of campaign columns (``leg1_degC`` …)."""

_Celsius = Annotated[float, Field(ge=ABSOLUTE_ZERO_DEGC)]
_Fraction = Annotated[float, Field(gt=0.0, le=1.0)]
_Expansion = Annotated[float, Field(ge=0.0, le=1e-3)]
Warm = TypeVar("Warm", float, FloatArray)


Temperature = Entry[_Celsius, Literal["degC"]]
Thickness = InMetres[NonNegativeFloat, Literal["mm", "m"]]
"""Zero means that there is none."""
Emissivity = Entry[_Fraction, Literal["1"]]
Conductivity = Entry[PositiveFloat, Literal["W/mK"]]
FilmCoefficient = Entry[PositiveFloat, Literal["W/m2K"]]
"""Heat flow per area and kelvin: of a film of air, or of a contact."""
Conductance = Entry[PositiveFloat, Literal["W/K"]]
HeatCapacity = Entry[PositiveFloat, Literal["J/kgK"]]
Expansion = Entry[_Expansion, Literal["1/K"]]


class MeltProperties(StrictModel):
    """The melt: its temperature unless one is given, and its surface."""

    temperature: Temperature
    emissivity: Emissivity


class AmbientProperties(StrictModel):
    """The surroundings: large, at one temperature."""

    temperature: Temperature
    film_coefficient: FilmCoefficient


class SteelProperties(StrictModel):
    """Steel; its density is in the dimensions file."""

    conductivity: Conductivity
    expansion: Expansion
    heat_capacity: HeatCapacity
    emissivity: Emissivity


class InsulationProperties(StrictModel):
    """The composite insulation of ladle and platform."""

    conductivity: Conductivity
    expansion: Expansion
    density: Density
    heat_capacity: HeatCapacity
    emissivity: Emissivity


class LadleProperties(StrictModel):
    """The ladle's wall: a steel shell; the rest of the layout's wall is lining."""

    shell_thickness: Thickness


class MovingPlatformProperties(StrictModel):
    """Cladding of the moving platform on the faces that see the melt."""

    cladding_thickness: Thickness


class TrussProperties(StrictModel):
    """The truss over the robot: the share of the melt's radiation that reaches it."""

    exposed: Entry[Share, Literal["1"]] = Entry[Share, Literal["1"]](value=1.0, unit="1", source="assumed")


class ContactProperties(StrictModel):
    """Contacts through which heat flows from part to part."""

    nut: FilmCoefficient
    upper_joint: Conductance
    lower_joint: Conductance


class ExpansionProperties(StrictModel):
    """The temperature at which parts have the lengths of the drawing."""

    reference_temperature: Temperature


class ThermalProperties(Entries):
    """All properties of the thermal model, each with unit, source and note."""

    melt: MeltProperties  # heat source
    ambient: AmbientProperties  # heat sink
    steel: SteelProperties  # of legs, platforms and shell
    insulation: InsulationProperties  # of lining and cladding
    ladle: LadleProperties  # its wall
    moving_platform: MovingPlatformProperties  # its cladding
    truss: TrussProperties = TrussProperties()  # its shield
    contact: ContactProperties  # of nut and U joints
    expansion: ExpansionProperties  # reference temperature

    def strain(self, degC: Warm) -> Warm:
        """Return the thermal strain of steel against the drawing, at one or many temperatures, in °C."""
        return self.steel.expansion.value * (degC - self.expansion.reference_temperature.value)


def load_thermal_properties(path: Path | str | None = None) -> ThermalProperties:
    """Read a thermal properties file (default: the shipped one); raises DescriptionError: file, line and key."""
    path = Path(path) if path is not None else description_folder() / "config" / "thermal.yaml"
    return validate(ThermalProperties, read_yaml(path), path)
