"""What is asked of a plan."""

import math
from dataclasses import dataclass

from pouring_robot.estimation.identifiability import CRITERIA, Criterion
from pouring_robot.estimation.noise_level import NoiseLevel
from pouring_robot.exceptions import BadInputError
from pouring_robot.robot.tolerances import Tolerances

_MOST_POSES = 500
_HOTTEST_DEGC = 800.0
_TRACKER = NoiseLevel.stated(5e-5, 5e-5)


@dataclass(frozen=True)
class PlanRequest:
    """What is asked of a plan; figures out of range raise BadInputError."""

    poses: int = 30  # number of poses n
    # sets, groups, names and patterns as calibration knows them; empty: drives and U-joint centres, reduced
    parameters: tuple[str, ...] = ()
    criterion: Criterion = "D"  # what the plan is best in
    noise: NoiseLevel = _TRACKER
    target_m: tuple[float, float, float] = (0.0, 0.0, 0.0)  # place of the target on the moving platform
    priors: Tolerances | None = None  # tolerances that count as known beforehand (MAP); None: nothing is known
    both_sides: int = 0  # how many of the poses are visited from both sides; each gives one more row
    loads_kg: tuple[float, ...] = ()  # melt to choose from; with any, drives' compliances are determined too
    # leg temperatures to choose from; with any, the legs' expansions are to be determined too
    leg_degC: tuple[float, ...] = ()  # noqa: N815 - the unit is spelt as in the campaign files
    reduce: bool = False  # leave out parameters of which poses tell less than tolerances, instead of refusing
    candidates: int = 2000  # about how many poses to choose from
    starts: int = 4  # how many random first plans
    seed: int = 0

    def __post_init__(self) -> None:
        if self.criterion not in CRITERIA:
            raise BadInputError(f"unknown criterion '{self.criterion}'; known: {', '.join(CRITERIA)}")
        for name, count, least, most in (
            ("number of poses", self.poses, 1, _MOST_POSES),
            ("number of poses visited from both sides", self.both_sides, 0, self.poses),
            ("number of candidates", self.candidates, 1, 20_000),
            ("number of starts", self.starts, 1, 1000),
            ("seed", self.seed, 0, 2**63),
        ):
            if not least <= count <= most:
                raise BadInputError(f"the {name} must be {least} to {most}, not {count}")
        for name, value, unit in (
            ("noise of a position", self.noise.position_m, "m"),
            ("noise of a rotation", self.noise.rotation_rad, "rad"),
        ):
            if not (math.isfinite(value) and 0.0 < value <= 1.0):
                raise BadInputError(f"the {name} must be above 0 and at most 1 {unit}, not {value:g} {unit}")
        if not all(math.isfinite(value) and abs(value) <= 10.0 for value in self.target_m):
            raise BadInputError("the place of the target must be three figures of at most 10 m")
        for name, values, least_value, most_value in (
            ("load in kg", self.loads_kg, 0.0, 1e4),
            ("leg temperature in °C", self.leg_degC, -100.0, _HOTTEST_DEGC),
        ):
            if not all(math.isfinite(value) and least_value <= value <= most_value for value in values):
                raise BadInputError(f"a {name} must be {least_value:g} to {most_value:g}, not {values}")
            if len(set(values)) < len(values) or len(values) == 1:
                raise BadInputError(f"give two different figures of the {name}, or none")

    @property
    def reduced(self) -> bool:
        """Whether parameters may be left out."""
        return self.reduce or not self.parameters
