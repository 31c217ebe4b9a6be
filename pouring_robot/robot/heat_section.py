"""How warm a robot is: the section ``heat`` of a model file, and how the command line overrides it.

Temperatures are in °C and times in minutes, as people write them. Properties are in the units of ``thermal.yaml``.
"""

import functools
from typing import Annotated, Any, Self

import pydantic

from pouring_robot.exceptions import BadInputError, closest
from pouring_robot.io.temperatures import IRON_IN_KELVIN, ZERO_CELSIUS_K, temperature_fault
from pouring_robot.io.typed_yaml import StrictModel
from pouring_robot.robot.pouring.thermal_properties import PARTS, ThermalProperties, load_thermal_properties

LONGEST_MIN = 60.0 * 24.0 * 30.0
"""A month: every part has reached its steady temperature long before."""


def _temperature(value: float, *, surroundings: bool = False) -> float:
    if fault := temperature_fault(value, surroundings=surroundings):
        raise ValueError(fault)
    return value


def _melt(value: float) -> float:
    """Refuse an impossible melt temperature, and a ladle colder than any possible surroundings."""
    return _temperature(value, surroundings=value < 0.0)


def _minutes(value: float) -> float:
    if not 0.0 < value <= LONGEST_MIN:
        raise ValueError(f"{value:g} min since the melt came is impossible; give more than 0, at most {LONGEST_MIN:g}")
    return value


Celsius = Annotated[float, pydantic.AfterValidator(_temperature)]
Melt = Annotated[float, pydantic.AfterValidator(_melt)]
Surroundings = Annotated[float, pydantic.AfterValidator(functools.partial(_temperature, surroundings=True))]
Minutes = Annotated[float, pydantic.AfterValidator(_minutes)]


class HeatSection(StrictModel):
    """What makes a robot warm."""

    melt_degC: Melt | None = None  # temperature of the melt; left out: that in the properties
    ambient_degC: Surroundings | None = None  # temperature of the surroundings; left out: that in the properties
    # how long the melt has been there: before, everything was at the temperature of the surroundings, and the pose is
    # held; left out: the steady state
    after_min: Minutes | None = None
    # measured mean temperature of parts (``leg1`` … ``leg4``, ``platform``, ``fixed_platform``); it replaces the
    # computed one, but not in a shift or at another time than the section's, as it holds for one moment
    measured_degC: dict[str, Celsius] = pydantic.Field(default_factory=dict)
    # values that replace those of the shipped ``thermal.yaml``, by section and name, in its units.
    properties: dict[str, dict[str, float]] = pydantic.Field(default_factory=dict)

    @pydantic.model_validator(mode="after")
    def _known_names(self) -> Self:
        for part in self.measured_degC:
            if part not in PARTS:
                raise ValueError(f"measured_degC: there is no part '{part}'{closest(part, PARTS)}")
        if self.properties:
            self.thermal_properties()
        return self

    def thermal_properties(self) -> ThermalProperties:
        """Return the shipped properties with this section's values; raises ValueError for a wrong name or value."""
        shipped = load_thermal_properties()
        content = shipped.model_dump()
        for section, values in self.properties.items():
            if section not in content:
                raise ValueError(f"properties: there is no section '{section}'{closest(section, content)}")
            for name, value in values.items():
                if name not in content[section]:
                    raise ValueError(
                        f"properties: '{section}' has no property '{name}'{closest(name, content[section])}"
                    )
                content[section][name] |= {"value": value, "source": "assumed", "note": "from the model file"}
        try:
            return ThermalProperties.model_validate(content)
        except pydantic.ValidationError as problem:
            section, name = (str(part) for part in problem.errors()[0]["loc"][:2])
            entry = content[section][name]
            unit = "" if entry["unit"] == "1" else f" {entry['unit']}"
            raise ValueError(
                f"properties: {section}.{name} = {entry['value']:g}{unit}: {_first_words(problem)}"
            ) from problem

    @property
    def temperatures_degC(self) -> tuple[float, float]:
        """Temperatures of melt and surroundings; one that is not given is that in the properties."""
        properties = self.thermal_properties()
        melt = properties.melt.temperature.value if self.melt_degC is None else self.melt_degC
        return melt, properties.ambient.temperature.value if self.ambient_degC is None else self.ambient_degC

    @property
    def cautions(self) -> tuple[str, ...]:
        """Warnings about an implausible but possible melt temperature, a line each."""
        melt, hall = self.temperatures_degC
        if melt > IRON_IN_KELVIN:
            odd = f"probably one at {melt - ZERO_CELSIUS_K:g} degC, given in kelvin; check the unit"
        elif melt < hall:
            odd = f"colder than the surroundings at {hall:g} degC, and cools the robot; check both"
        else:
            return ()
        return (f"a melt at {melt:g} degC is {odd}",)

    def with_values(self, **values: Any) -> Self:
        """Return the section with some values replaced; raises BadInputError that names an impossible value.

        Measured temperatures hold for one moment and are dropped at another time.
        """
        try:
            changed = type(self).model_validate(self.model_dump() | values)
        except pydantic.ValidationError as problem:
            where = ".".join(str(part) for part in problem.errors()[0]["loc"])
            raise BadInputError(f"{where}: {_first_words(problem)}") from problem
        if changed.after_min == self.after_min or "measured_degC" in values:
            return changed
        return changed.model_copy(update={"measured_degC": {}})


def _first_words(problem: pydantic.ValidationError) -> str:
    return str(problem.errors()[0]["msg"]).removeprefix("Value error, ")
