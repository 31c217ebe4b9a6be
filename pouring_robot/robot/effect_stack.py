"""The effect stack of a model file: effects found by diagnosis, with their parameters and standard deviations."""

import pydantic

from pouring_robot.io.typed_yaml import StrictModel


class ParameterEntry(StrictModel):
    """One parameter of an effect."""

    value: float  # in ``unit``
    std: float = pydantic.Field(default=0.0, ge=0.0)  # standard deviation, in ``unit``
    unit: str  # the effect's own


class LearnedCampaign(StrictModel):
    """The campaign that effects were learned in: what their shapes count from, and over what. SI units and °C."""

    # least and largest value of each drive and condition that the campaign has, by heading in inner units
    ranges: dict[str, tuple[float, float]] = pydantic.Field(default_factory=dict)
    # arcs of a turn in which each turning drive stood, by joint; of one that is left out the whole turn
    seen_rad: dict[str, list[tuple[float, float]]] = pydantic.Field(default_factory=dict)
    sessions: dict[str, pydantic.PositiveInt] = pydantic.Field(min_length=1)  # how many rows each session has
    mean_span_m: list[float]  # mean distance of the joints at both ends of each drive, or value of one that turns
    # mean of the absolute force or moment on each drive, in N and Nm; empty: not known
    mean_force: list[float] = pydantic.Field(default_factory=list)
    # mean temperature above the reference, by thermometer
    mean_rise_k: dict[str, float] = pydantic.Field(default_factory=dict)
    # temperature at which the drawing holds
    reference_temperature_degC: float  # noqa: N815 - the unit is spelt as in the campaign files
    screw_pitch_m: pydantic.PositiveFloat | None = None  # travel of a leg a turn of its screw
    truss_span_m: pydantic.PositiveFloat | None = None  # length of the rails
    ladle_tare_kg: pydantic.PositiveFloat | None = None  # mass of the empty ladle
    # centre of mass of the ladle in the moving platform's frame
    ladle_centre_of_mass_m: tuple[float, float, float] | None = None

    @pydantic.field_validator("ranges")
    @classmethod
    def _run_upwards(cls, ranges: dict[str, tuple[float, float]]) -> dict[str, tuple[float, float]]:
        for heading, (low, high) in ranges.items():
            if low > high:
                raise ValueError(f"the range of '{heading}' runs down, from {low:g} to {high:g}")
        return ranges

    @property
    def timed(self) -> bool:
        """Whether times are known; without a time column the number of the row stood for it."""
        return "time_s" in self.ranges

    @property
    def time_s(self) -> tuple[float, float]:
        """First and last time, or number of a row."""
        return self.ranges.get("time_s", (0.0, sum(self.sessions.values()) - 1.0))


class EffectEntry(StrictModel):
    """One effect in one of its forms."""

    effect: str  # its id
    form: str  # which form
    learned: str = ""  # name of the campaign, under ``learned`` of the model file, that its shape counts from
    # whether it is already in ``joint_placements`` and ``drive_offsets``: what does not depend on conditions is put
    # there. The entry then only says where they come from.
    placed: bool = False
    parameters: dict[str, ParameterEntry] = pydantic.Field(default_factory=dict)  # by name; those left out are zero
