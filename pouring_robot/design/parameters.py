"""What a plan is to determine: local parameters by name or pattern, and what only two sides, loads or heat show.

Beside the local parameters there are simple columns for what depends on how a pose is visited:

- ``backlash.<drive>`` (m or rad): the whole lost motion. A drive approached rising stands half of it below its
  command, falling half of it above.
- ``compliance.<drive>`` (m/N or rad/Nm): a drive yields by this times the load on it. With J the drive's column of G
  at the ladle's centre of mass, the load is JᵀF of the weight F of ladle and melt (virtual work); to first order this
  is the yielding drive of ``energy.Loads``. The passive leg carries nothing along its axis.
- ``expansion.<drive>`` (1/K): a driven leg is longer by this times its length times its warmth above the reference.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.parameters import GeometricParameter, drive_parameters
from pouring_robot.robot.parameters import ParameterCatalogue, all_parameters
from pouring_robot.robot.tolerances import Tolerances

Kind = Literal["local", "backlash", "compliance", "expansion"]
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


# Backlash of a worn screw; a leg of 1e8 N/m and a tilt drive of 1e6 Nm/rad; steel.
_USUAL: dict[tuple[Kind, str], float] = {
    ("backlash", "m"): 1e-4,
    ("backlash", "rad"): 2e-4,
    ("compliance", "m/N"): 1e-8,
    ("compliance", "rad/Nm"): 1e-6,
    ("expansion", "1/K"): 1.2e-5,
}


@dataclass(frozen=True)
class PlannedParameter:
    """One number that a plan is to determine.

    Attributes:
        name: such as ``leg1_s1.tx``, ``alpha_e1_56``, ``drive.leg1_s3``, ``backlash.leg1_s3``.
        unit: ``m``, ``rad``, ``m/N``, ``rad/Nm`` or ``1/K``.
        kind: which column it has.
        local: the local parameter; of the other kinds, the drive.
    """

    name: str
    unit: str
    kind: Kind
    local: GeometricParameter

    @property
    def shown_unit(self) -> str:
        """Unit at the user's edge."""
        return SHOWN_UNITS[self.unit][0]

    @property
    def shown_factor(self) -> float:
        """How many of the shown units make one inside."""
        return SHOWN_UNITS[self.unit][1]


def local_parameters(nominal: ClosedChainMechanism, wanted: Sequence[str]) -> tuple[PlannedParameter, ...]:
    """Return the local parameters of sets, groups and name patterns, as calibration knows them.

    Raises:
        BadInputError: a name or pattern matches nothing.
    """
    chosen = all_parameters(ParameterCatalogue(nominal).groups(wanted))
    return tuple(PlannedParameter(p.name, p.unit, "local", p) for p in chosen)


def usual_size(parameter: PlannedParameter, tolerances: Tolerances) -> float:
    """Return how large a parameter usually is, in its own unit: its tolerance; of a condition's, an order of size."""
    if parameter.kind == "local":
        return float(tolerances.std([parameter.local])[0])
    return _USUAL[parameter.kind, parameter.unit]


def condition_parameters(
    nominal: ClosedChainMechanism, *, backlash: bool, compliance: bool, expansion: bool
) -> tuple[PlannedParameter, ...]:
    """Return the parameters that only show from both sides, under load or with heat; see the module."""
    drives = drive_parameters(nominal)
    chosen: list[PlannedParameter] = []
    if backlash:
        chosen += [PlannedParameter(f"backlash.{d.joint}", d.unit, "backlash", d) for d in drives]
    if compliance:
        units = {"m": "m/N", "rad": "rad/Nm"}
        chosen += [PlannedParameter(f"compliance.{d.joint}", units[d.unit], "compliance", d) for d in drives]
    if expansion:
        legs = [d for d in drives if d.unit == "m"]
        chosen += [PlannedParameter(f"expansion.{d.joint}", "1/K", "expansion", d) for d in legs]
    return tuple(chosen)
