"""The effect stack of a model file: effects found by diagnosis, with their parameters and standard deviations."""

import pydantic

from pouring_robot.io.typed_yaml import StrictModel


class ParameterEntry(StrictModel):
    """One parameter of an effect.

    Attributes:
        value: in ``unit``.
        std: standard deviation, in ``unit``.
        unit: the effect's own.
    """

    value: float
    std: float = pydantic.Field(default=0.0, ge=0.0)
    unit: str


class LearnedCampaign(StrictModel):
    """The campaign that effects were learned in: what their shapes count from, and over what. SI units and °C.

    Attributes:
        ranges: least and largest value of each drive and condition that the campaign has, by heading in inner units.
        seen_rad: arcs of a turn in which each turning drive stood, by joint; of one that is left out the whole turn.
        sessions: how many rows each session has.
        mean_span_m: mean distance of the joints at both ends of each drive, or value of one that turns.
        mean_force: mean of the absolute force or moment on each drive, in N and Nm; empty: not known.
        mean_rise_k: mean temperature above the reference, by thermometer.
        reference_temperature_degC: temperature at which the drawing holds.
        screw_pitch_m: travel of a leg a turn of its screw.
        truss_span_m: length of the rails.
        ladle_tare_kg: mass of the empty ladle.
        ladle_centre_of_mass_m: centre of mass of the ladle in the moving platform's frame.
    """

    ranges: dict[str, tuple[float, float]] = pydantic.Field(default_factory=dict)
    seen_rad: dict[str, list[tuple[float, float]]] = pydantic.Field(default_factory=dict)
    sessions: dict[str, pydantic.PositiveInt] = pydantic.Field(min_length=1)
    mean_span_m: list[float]
    mean_force: list[float] = pydantic.Field(default_factory=list)
    mean_rise_k: dict[str, float] = pydantic.Field(default_factory=dict)
    reference_temperature_degC: float  # noqa: N815 - the unit is spelt as in the campaign files
    screw_pitch_m: float | None = None
    truss_span_m: float | None = None
    ladle_tare_kg: float | None = None
    ladle_centre_of_mass_m: tuple[float, float, float] | None = None

    @property
    def timed(self) -> bool:
        """Whether times are known; without a time column the number of the row stood for it."""
        return "time_s" in self.ranges

    @property
    def time_s(self) -> tuple[float, float]:
        """First and last time, or number of a row."""
        return self.ranges.get("time_s", (0.0, sum(self.sessions.values()) - 1.0))


class EffectEntry(StrictModel):
    """One effect in one of its forms.

    Attributes:
        effect: its id.
        form: which form.
        learned: name of the campaign, under ``learned`` of the model file, that its shape counts from.
        placed: whether it is already in ``joint_placements`` and ``drive_offsets``: what does not depend on conditions
            is put there. The entry then only says where they come from.
        parameters: by name; those left out are zero.
    """

    effect: str
    form: str
    learned: str = ""
    placed: bool = False
    parameters: dict[str, ParameterEntry] = pydantic.Field(default_factory=dict)
