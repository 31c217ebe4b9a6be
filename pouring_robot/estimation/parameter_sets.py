"""Which parameters to identify: named sets and name patterns, in the groups that are kept or dropped together."""

from __future__ import annotations

import fnmatch
from collections.abc import Sequence
from dataclasses import dataclass

from pouring_robot.estimation.measurement import CalibrationParameter
from pouring_robot.exceptions import BadInputError, closest
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.parameters import DriveParameter, placement_parameters
from pouring_robot.robot.pouring.dh.table import DHTable


@dataclass(frozen=True)
class ParameterGroup:
    """Parameters that one physical cause moves together.

    Attributes:
        name: short.
        meaning: what it is on the machine.
        parameters: its parameters.
    """

    name: str
    meaning: str
    parameters: tuple[CalibrationParameter, ...]


_GROUPS: dict[str, tuple[str, tuple[str, ...]]] = {
    "drives": ("zero offsets of the drives", ("drive.*",)),
    "fixed_centres": ("places of the upper U joints on the fixed platform", ("leg?_s1.t?",)),
    "moving_centres": ("places of the lower U joints on the moving platform", ("leg?_seat_mount.t?",)),
    "fixed_axes": ("axes of the upper U joints", ("leg?_s1.r?", "leg?_s2.r?")),
    "moving_axes": ("axes of the lower U joints", ("leg?_s4.r?", "leg?_s5.r?", "leg?_seat_mount.r?")),
    "leg_axes": ("directions of the legs in their rods", ("leg?_s3.r?",)),
    "leg_offsets": ("distances inside the legs and U joints", ("leg?_s2.t?", "leg?_s3.t?", "leg?_s4.t?", "leg?_s5.t?")),
    "dh_fixed_platform": ("fixed-platform installation, DH table", ("theta_e?_0",)),
    "dh_upper_joints": ("upper U joints, DH table", ("*_e?_01", "*_e?_12", "*_e?_1", "d_e?_2")),
    "dh_rods": ("fixed and moving rods, DH table", ("*_e?_23", "*_e?_34", "d_e?_3", "theta_e?_4")),
    "dh_lower_joints": ("lower U joints, DH table", ("*_e?_45", "*_e?_56", "d_e?_5", "d_e?_6")),
    "dh_moving_platform": ("moving-platform installation, DH table", ("*_e?_6o", "*_e?_o")),
}
SETS: dict[str, tuple[str, ...]] = {
    "geometry": ("drives", "fixed_centres", "moving_centres", "fixed_axes", "moving_axes"),
    "centres": ("drives", "fixed_centres", "moving_centres"),
    "axes": ("fixed_axes", "moving_axes"),
    "all": ("drives", "fixed_centres", "moving_centres", "fixed_axes", "moving_axes", "leg_axes", "leg_offsets"),
    "dh": ("drives", "dh_fixed_platform", "dh_upper_joints", "dh_rods", "dh_lower_joints", "dh_moving_platform"),
}
"""Named sets of groups; ``geometry`` is the default."""


class ParameterCatalogue:
    """Every parameter that can be identified, by name.

    Args:
        nominal: the mechanism of the drawing.
    """

    def __init__(self, nominal: ClosedChainMechanism) -> None:
        """List drives, placement errors and the DH table's errors of the machine."""
        table = DHTable.from_mechanism(nominal)
        drives = [DriveParameter(name, nominal.unit_of(name)) for name in nominal.loops.drives]
        local: list[CalibrationParameter] = [*drives, *placement_parameters(table.joints)]
        self._known: dict[str, CalibrationParameter] = {p.name: p for p in local}
        self._known |= {p.name: p.local for p in table.parameters if not p.drops_out and p.role == "geometric"}

    def match(self, pattern: str) -> tuple[CalibrationParameter, ...]:
        """Return the parameters of a name or shell pattern, in the catalogue's order.

        Raises:
            BadInputError: there is none.
        """
        found = tuple(p for name, p in self._known.items() if fnmatch.fnmatchcase(name, pattern))
        if not found:
            names = {*SETS, *_GROUPS, *self._known}
            near = closest(pattern, names)
            sets = f"; give a set ({', '.join(SETS)}), a group ({', '.join(_GROUPS)}) or names like leg1_s1.tx"
            raise BadInputError(f"no parameter is called '{pattern}'{near if near.startswith('; did') else sets}")
        return found

    def group(self, name: str) -> ParameterGroup:
        """Return a group by name, or the parameters of a pattern as one group.

        Raises:
            BadInputError: there is no such group, and no parameter of the pattern.
        """
        meaning, patterns = _GROUPS.get(name, ("as given", (name,)))
        parameters = {p.name: p for pattern in patterns for p in self.match(pattern)}
        return ParameterGroup(name, meaning, tuple(parameters.values()))

    def groups(self, wanted: Sequence[str] = ("geometry",)) -> tuple[ParameterGroup, ...]:
        """Return the groups of sets, groups and patterns, each parameter in the first that names it.

        Raises:
            BadInputError: a name matches nothing, or nothing is wanted.
        """
        names = [group for name in wanted for group in SETS.get(name, (name,))]
        taken: set[str] = set()
        groups = []
        for name in dict.fromkeys(names):
            group = self.group(name)
            fresh = tuple(p for p in group.parameters if p.name not in taken)
            taken |= {p.name for p in fresh}
            if fresh:
                groups.append(ParameterGroup(name, group.meaning, fresh))
        if not groups:
            raise BadInputError(f"name the parameters to identify: a set ({', '.join(SETS)}) or patterns")
        return tuple(groups)


def all_parameters(groups: Sequence[ParameterGroup]) -> tuple[CalibrationParameter, ...]:
    """Return the parameters of groups, in order."""
    return tuple(p for group in groups for p in group.parameters)
