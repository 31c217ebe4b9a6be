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
    unit: str  # the one the effect uses


class LearnedCampaign(StrictModel):
    """The campaign that effects were learned from: reference values and ranges of their shapes. SI units and °C."""

    # smallest and largest value of each drive and condition in the campaign, by heading in internal units
    ranges: dict[str, Range] = pydantic.Field(default_factory=dict)
    # arcs of a turn that each rotary drive covered, by joint; a drive that is left out covered the whole turn
    seen_rad: dict[str, list[Range]] = pydantic.Field(default_factory=dict)
    sessions: dict[str, pydantic.PositiveInt] = pydantic.Field(min_length=1)  # number of rows in each session
    # of each drive, mean absolute distance between the joints at its ends; of a rotary drive, mean absolute value
    mean_span_m: list[float]
    # mean of the absolute force or moment on each drive, in N and Nm; empty: unknown
    mean_force: list[pydantic.NonNegativeFloat] = pydantic.Field(default_factory=list)
    # whether the model learned here had a larger held-out error than the one before: then it is not to be used
    worse: bool = False
    # mean temperature above the reference, by thermometer; one that is left out counts from the reference
    mean_rise_k: dict[str, float] = pydantic.Field(default_factory=dict)
    # temperature at which the drawing holds
    reference_temperature_degC: Surroundings
    screw_pitch_m: Size | None = None  # travel of a sliding drive per turn of its screw
    truss_span_m: Size | None = None  # length of the rails
    ladle_tare_kg: Size | None = None  # mass of the empty ladle
    # the ladle's centre of mass in the moving platform's frame
    ladle_centre_of_mass_m: tuple[float, float, float] | None = None

    def check(self, robot: RobotDefinition, where: str) -> None:
        """Raise BadInputError, beginning with ``where``, unless all entries fit the robot's drives and conditions."""
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
        """Whether times are known; without a time column row numbers were used instead."""
        return "time_s" in self.ranges

    @property
    def time_s(self) -> tuple[float, float]:
        """First and last time, or row number."""
        return self.ranges.get("time_s", (0.0, sum(self.sessions.values()) - 1.0))


class EffectEntry(StrictModel):
    """One effect in one of its forms."""

    effect: str  # its id
    form: str  # which form
    learned: str = ""  # name of the campaign, under ``learned`` of the model file, that its shape refers to
    # whether it is already included in ``joint_placements`` and ``drive_offsets``, as effects that do not depend on
    # conditions are. The entry then only records where those values come from.
    placed: bool = False
    parameters: dict[str, ParameterEntry] = pydantic.Field(default_factory=dict)  # by name; those left out are zero
