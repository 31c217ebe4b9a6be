"""What a plan is to determine: local parameters by name or pattern, and what only two sides, loads or heat show.

Beside the local parameters there are simple columns for what depends on how a pose is visited:

- ``backlash.<drive>`` (m or rad): the whole lost motion. A drive approached rising stands half of it below its
  command, falling half of it above.
- ``compliance.<drive>`` (m/N or rad/Nm): a drive yields by this times the load on it. With J the drive's column of G
  at the ladle's centre of mass, the load is JᵀF of the weight F of ladle and melt (virtual work); to first order this
  is the yielding drive of ``energy.Loads``. The passive leg carries nothing along its axis.
- ``expansion.<drive>`` (1/K): a driven leg is longer by this times its length times its warmth above the reference.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Literal

from pouring_robot.mechanism.parameters import GeometricParameter
from pouring_robot.robot.description.definition import RobotDefinition
from pouring_robot.robot.parameters import ParameterCatalogue, all_parameters
from pouring_robot.robot.tolerances import Tolerances

Condition = Literal["backlash", "compliance", "expansion"]
DEFAULT_SETS = ("centres",)
"""Drives and U-joint centres: the errors that close exactly."""

# Unit inside: unit shown, and how many of the shown make one inside.
SHOWN_UNITS: dict[str, tuple[str, float]] = {
    "m": ("mm", 1e3),
    "rad": ("mrad", 1e3),
    "m/N": ("µm/kN", 1e9),
    "rad/Nm": ("mrad/kNm", 1e6),
    "1/K": ("1e-6/K", 1e6),
}
# Unit and order of size, by the drive's unit: a worn screw; a leg of 1e8 N/m, a tilt drive of 1e6 Nm/rad; steel.
_CONDITIONS: dict[Condition, dict[str, tuple[str, float]]] = {
    "backlash": {"m": ("m", 1e-4), "rad": ("rad", 2e-4)},
    "compliance": {"m": ("m/N", 1e-8), "rad": ("rad/Nm", 1e-6)},
    "expansion": {"m": ("1/K", 1.2e-5)},
}


@dataclass(frozen=True)
class PlannedParameter:
    """One number that a plan is to determine."""

    name: str  # of the catalogue, or ``<condition>.<drive>``
    unit: str  # ``m``, ``rad``, ``m/N``, ``rad/Nm`` or ``1/K``
    kind: Literal["local"] | Condition  # which column it has: ``local``, or the condition that shows it
    local: GeometricParameter  # the local parameter; of the other kinds, the drive

    @property
    def shown_unit(self) -> str:
        """Unit at the user's edge."""
        return SHOWN_UNITS[self.unit][0]

    @property
    def shown_factor(self) -> float:
        """How many of the shown units make one inside."""
        return SHOWN_UNITS[self.unit][1]


def planned_parameters(
    catalogue: ParameterCatalogue, wanted: Sequence[str], conditions: Collection[Condition] = ()
) -> tuple[PlannedParameter, ...]:
    """Return the parameters of sets, groups and name patterns, then those that only conditions show; see the module.

    Raises:
        BadInputError: a name or pattern matches nothing.
    """
    local = [PlannedParameter(p.name, p.unit, "local", p) for p in all_parameters(catalogue.groups(wanted))]
    shown = [
        PlannedParameter(f"{condition}.{drive.joint}", units[drive.unit][0], condition, drive)
        for condition, units in _CONDITIONS.items()
        for drive in catalogue.drives
        if condition in conditions and drive.unit in units
    ]
    return (*local, *shown)


def expected_size(parameter: PlannedParameter, robot: RobotDefinition, tolerances: Tolerances) -> float:
    """Return how large a parameter may be, in its own unit: its tolerance; of a condition's, an order of size."""
    if parameter.kind == "local":
        return float(tolerances.std([parameter.local], robot)[0])
    return _CONDITIONS[parameter.kind][parameter.local.unit][1]
