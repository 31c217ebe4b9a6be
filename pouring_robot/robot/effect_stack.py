"""The effect stack of a model file: effects found by diagnosis, with their parameters and standard deviations."""

import pydantic

from pouring_robot.exceptions import BadInputError, closest
from pouring_robot.io.typed_yaml import Range, Size, StrictModel
from pouring_robot.robot.description.definition import RobotDefinition
from pouring_robot.robot.heat_section import Surroundings


class ParameterEntry(StrictModel):
    """One parameter of an effect."""

    value: float  # in ``unit``
    std: float = pydantic.Field(default=0.0, ge=0.0)  # standard deviation, in ``unit``
    unit: str  # the effect's own


class LearnedCampaign(StrictModel):
    """The campaign that effects were learned in: what their shapes count from, and over what. SI units and °C."""

    # least and largest value of each drive and condition that the campaign has, by heading in inner units
    ranges: dict[str, Range] = pydantic.Field(default_factory=dict)
    # arcs of a turn in which each turning drive stood, by joint; of one that is left out the whole turn
    seen_rad: dict[str, list[Range]] = pydantic.Field(default_factory=dict)
    sessions: dict[str, pydantic.PositiveInt] = pydantic.Field(min_length=1)  # how many rows each session has
    # mean distance of the joints at both ends of each drive, or value of one that turns, without their signs
    mean_span_m: list[float]
    # mean of the absolute force or moment on each drive, in N and Nm; empty: not known
    mean_force: list[pydantic.NonNegativeFloat] = pydantic.Field(default_factory=list)
    # whether the model that was learned here was further from the held-out rows than the one before: not to be used
    worse: bool = False
    # mean temperature above the reference, by thermometer; left out: counted from the reference
    mean_rise_k: dict[str, float] = pydantic.Field(default_factory=dict)
    # temperature at which the drawing holds
    reference_temperature_degC: Surroundings
    screw_pitch_m: Size | None = None  # travel of a sliding drive a turn of its screw
    truss_span_m: Size | None = None  # length of the rails
    ladle_tare_kg: Size | None = None  # mass of the empty ladle
    # centre of mass of the ladle in the moving platform's frame
    ladle_centre_of_mass_m: tuple[float, float, float] | None = None

    def check(self, robot: RobotDefinition, where: str) -> None:
        """Raise BadInputError, which begins with ``where``, unless all this is of a robot's drives and conditions."""
        known = {
            "ranges": [quantity.canonical for quantity in robot.ranged_columns],
            "seen_rad": [drive.joint for drive in robot.drives if drive.unit == "rad"],
            "mean_rise_k": [quantity.name for quantity in robot.ranged_columns if quantity.kind == "temperature"],
        }
        for key, names in known.items():
            for name in getattr(self, key):
                if name not in names:
                    raise BadInputError(f"{where}.{key}: unknown key '{name}'{closest(name, names)}")
        joints = [drive.joint for drive in robot.drives]
        for key, means in (("mean_span_m", self.mean_span_m), ("mean_force", self.mean_force or joints)):
            if len(means) != len(joints):
                each = f"one for each of {', '.join(joints)}"
                raise BadInputError(f"{where}.{key}: it needs {len(joints)} numbers, {each}, not {len(means)}")

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
