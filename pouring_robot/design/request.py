"""The request for a plan: local parameters by name or pattern, and what only two sides, loads or heat show.

Besides the local parameters there are simple columns for what depends on how a pose is visited:

- ``backlash.<drive>`` (m or rad): the whole lost motion. A drive that was rising stops half of it below its command,
  one that was falling half of it above.
- ``compliance.<drive>`` (m/N or rad/Nm): a drive yields by this times the load on it, which is the one that effects
  use (:func:`~pouring_robot.effects.nominal_rows.loads_on`); to first order this is the yielding drive of
  ``energy.Loads``. What is not driven carries nothing.
- ``expansion.<drive>`` (1/K): a sliding drive with a thermometer is longer by this times its length times its
  temperature above the reference.
"""

from collections.abc import Collection
from dataclasses import dataclass
from typing import Literal

from pouring_robot.effects.default_causes import causes_of
from pouring_robot.effects.families.growth import STEEL_PPM
from pouring_robot.estimation.identifiability import CRITERIA, Criterion
from pouring_robot.estimation.noise import NoiseLevel
from pouring_robot.exceptions import BadInputError
from pouring_robot.io import usual_noise
from pouring_robot.io.argument_checks import Options, as_tuple, expect, whole
from pouring_robot.io.quantity_columns import LIMITS
from pouring_robot.io.units import MM, MRAD, shown_in
from pouring_robot.mechanism.arrays import finite
from pouring_robot.mechanism.local_parameters import GeometricParameter
from pouring_robot.robot.description.definition import RobotDefinition
from pouring_robot.robot.parameter_catalogue import all_parameters
from pouring_robot.robot.robot import Robot
from pouring_robot.robot.tolerances import Tolerances

Condition = Literal["backlash", "compliance", "expansion"]
DEFAULT_SETS = ("centres",)
"""Drives and U-joint centres: the errors that close exactly."""

# Unit and order of magnitude, by the drive's unit: a worn screw; expected size of causes at their usual load; steel.
_CONDITIONS: dict[Condition, dict[str, tuple[str, float]]] = {
    "backlash": {"m": ("m", 1e-4), "rad": ("rad", 2e-4)},
    "compliance": {"m": ("m/N", MM), "rad": ("rad/Nm", MRAD)},
    "expansion": {"m": ("1/K", 1e-6 * STEEL_PPM)},
}
_MOST_POSES = 500
_HOTTEST_DEGC = 800.0
_TRACKER = NoiseLevel.stated(usual_noise.SIGMA, usual_noise.SIGMA)


@dataclass(frozen=True)
class PlannedParameter:
    """One number that a plan is to determine."""

    name: str  # of the catalogue, or ``<condition>.<drive>``
    unit: str  # ``m``, ``rad``, ``m/N``, ``rad/Nm`` or ``1/K``
    kind: Literal["local"] | Condition  # which column it has: ``local``, or the condition that reveals it
    local: GeometricParameter  # the local parameter; for the other kinds, the drive

    @property
    def shown_in(self) -> tuple[str, float]:
        """Unit shown to users, and its size in the parameter's own."""
        return shown_in(self.unit)


def expected_size(parameter: PlannedParameter, robot: RobotDefinition, tolerances: Tolerances) -> float:
    """Return the expected size of a parameter, in its own unit: its tolerance, or a condition's order of magnitude."""
    if parameter.kind == "local":
        return float(tolerances.std([parameter.local], robot)[0])
    size = _CONDITIONS[parameter.kind][parameter.local.unit][1]
    if parameter.kind != "compliance":
        return size
    yielding = (entry.options for entry in causes_of(robot).entries if entry.family in ("stretch", "spring"))
    return size / next(float(own["load"]) for own in yielding if parameter.local.joint in own["drives"])


@dataclass(frozen=True)
class PlanRequest(Options):
    """The request for a plan; figures that are out of range, or are no figures, raise BadInputError."""

    poses: int = 30  # number of poses n
    # sets, groups, names and patterns as in a calibration; empty: drives and U-joint centres, reduced
    parameters: tuple[str, ...] = ()
    criterion: Criterion = "D"  # by which the plan is the best
    noise: NoiseLevel = _TRACKER
    target_m: tuple[float, float, float] = (0.0, 0.0, 0.0)  # position of the target on the moving platform
    priors: Tolerances | None = None  # tolerances that count as priors (MAP); None: without priors
    both_sides: int = 0  # how many of the poses are visited from both sides; each gives one more row
    loads_kg: tuple[float, ...] = ()  # payloads to choose from; with any, drives' compliances are determined too
    # temperatures of sliding drives to choose from; with any, expansions of those with a thermometer are determined too
    drive_degC: tuple[float, ...] = ()
    reduce: bool = False  # leave out parameters that poses determine less well than tolerances, instead of refusing
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
            whole(count, least, f"the {name} must be {least} to {most}", most)
        expect(self.noise, NoiseLevel, "the noise of a plan is a NoiseLevel, such as NoiseLevel.stated(5e-5, 5e-5)")
        expect(self.priors, Tolerances | None, "priors of a plan are Tolerances, such as Tolerances.load reads")
        said = "the place of the target must be three figures of at most 10 m"
        target = tuple(finite(self.target_m, (3,), said).tolist())
        if max(map(abs, target)) > 10.0:
            raise BadInputError(said)
        plain = {"target_m": target, "parameters": as_tuple(self.parameters)}
        for key, name, least_value, most_value in (
            ("loads_kg", "load in kg", *LIMITS["mass"]),
            ("drive_degC", "drive temperature in °C", -100.0, _HOTTEST_DEGC),
        ):
            said = f"a {name} must be {least_value:g} to {most_value:g}, not {getattr(self, key)}"
            plain[key] = values = tuple(finite(as_tuple(getattr(self, key)), (None,), said).tolist())
            if not all(least_value <= value <= most_value for value in values):
                raise BadInputError(said)
            if len(set(values)) < len(values) or len(values) == 1:
                raise BadInputError(f"give two different figures of the {name}, or none")
        for key, found in plain.items():
            object.__setattr__(self, key, found)
        super().__post_init__()

    @property
    def reduced(self) -> bool:
        """Whether parameters may be left out."""
        return self.reduce or not self.parameters


def planned_parameters(robot: Robot, request: PlanRequest) -> tuple[PlannedParameter, ...]:
    """Return the parameters of sets, groups and name patterns, then those that only conditions show; see the module.

    A name or pattern that matches nothing raises BadInputError, and so do temperatures of a robot whose drives have no
    thermometer.
    """
    catalogue, warmed = robot.parameters, causes_of(robot.model.definition).drive_thermometers
    if request.drive_degC and not warmed:
        raise BadInputError("no sliding drive has a thermometer, so temperatures tell nothing about them; plan without")
    wanted = all_parameters(catalogue.groups(request.parameters or DEFAULT_SETS))
    every = {drive.joint for drive in catalogue.drives}
    planned: dict[Condition, Collection[str]] = {
        "backlash": every if request.both_sides else (),
        "compliance": every if request.loads_kg else (),
        "expansion": warmed if request.drive_degC else (),
    }
    shown = [
        PlannedParameter(f"{condition}.{drive.joint}", units[drive.unit][0], condition, drive)
        for condition, units in _CONDITIONS.items()
        for drive in catalogue.drives
        if drive.joint in planned[condition] and drive.unit in units
    ]
    return (*(PlannedParameter(p.name, p.unit, "local", p) for p in wanted), *shown)
