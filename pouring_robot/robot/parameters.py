"""The catalogue of a robot: every local parameter of its chains by name, and the sets in which people ask for them.

A parameter is the offset of a drive (``drive.<joint>``), a component of a joint's placement error (``<joint>.tx``), or
an error of the DH table (``alpha_e1_56``). Calibration, planning, sweeps and diagnosis choose from this one list.

    [p.name for p in robot.parameters.match("centres")]        # a set, a group, a name or a shell pattern
"""

from __future__ import annotations

import fnmatch
from collections.abc import Sequence
from dataclasses import dataclass

from pouring_robot.exceptions import BadInputError, closest
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.parameters import GeometricParameter, drive_parameters, placement_parameters
from pouring_robot.robot.pouring.dh.parameters import DHParameter
from pouring_robot.robot.pouring.dh.table import DHTable
from pouring_robot.robot.tolerances import Kind, kind_of

GROUPS: dict[str, tuple[str, tuple[str, ...]]] = {
    "drives": ("zero offsets of the drives", ("drive.*",)),
    "fixed_centres": ("places of the upper U joints on the fixed platform", ("*_s1.t?",)),
    "moving_centres": ("places of the lower U joints on the moving platform", ("*_seat_mount.t?",)),
    "fixed_axes": ("axes of the upper U joints", ("*_s1.r?", "*_s2.r?")),
    "moving_axes": ("axes of the lower U joints", ("*_s4.r?", "*_s5.r?", "*_seat_mount.r?")),
    "leg_axes": ("directions of the legs in their rods", ("*_s3.r?",)),
    "leg_offsets": ("distances inside the legs and U joints", ("*_s2.t?", "*_s3.t?", "*_s4.t?", "*_s5.t?")),
    "dh_fixed_platform": ("fixed-platform installation, DH table", ("theta_e?_0",)),
    "dh_upper_joints": ("upper U joints, DH table", ("*_e?_01", "*_e?_12", "*_e?_1", "d_e?_2")),
    "dh_rods": ("fixed and moving rods, DH table", ("*_e?_23", "*_e?_34", "d_e?_3", "theta_e?_4")),
    "dh_lower_joints": ("lower U joints, DH table", ("*_e?_45", "*_e?_56", "d_e?_5", "d_e?_6")),
    "dh_moving_platform": ("moving-platform installation, DH table", ("*_e?_6o", "*_e?_o")),
}
"""What one physical cause moves together: its meaning on the machine, and the patterns of its parameters."""
SETS: dict[str, tuple[str, ...]] = {
    "geometry": ("drives", "fixed_centres", "moving_centres", "fixed_axes", "moving_axes"),
    "centres": ("drives", "fixed_centres", "moving_centres"),
    "axes": ("fixed_axes", "moving_axes"),
    "all": ("drives", "fixed_centres", "moving_centres", "fixed_axes", "moving_axes", "leg_axes", "leg_offsets"),
    "dh": ("drives", "dh_fixed_platform", "dh_upper_joints", "dh_rods", "dh_lower_joints", "dh_moving_platform"),
}
"""Named sets of groups. ``centres`` are the errors that close exactly."""


@dataclass(frozen=True)
class Parameter:
    """One number that may be wrong.

    Attributes:
        name: as in files and on the command line.
        chain: number of the chain it lies in.
        part: the part of the machine it is measured on.
        local: the same as a local parameter, for the error-transfer matrix.
        dh: the number of the DH table that it is an error of, if it is one.
    """

    name: str
    chain: int
    part: str
    local: GeometricParameter
    dh: DHParameter | None = None

    @property
    def unit(self) -> str:
        """``m`` or ``rad``."""
        return self.local.unit

    @property
    def kind(self) -> Kind:
        """Which tolerance it has."""
        return kind_of(self.local)

    @property
    def hidden_by(self) -> str:
        """Why measurements cannot show it as an error of its own; empty if they can."""
        if self.dh is None:
            return ""
        return self.dh.reason or (f"it is drive.{self.dh.moves_with}" if self.dh.role == "drive" else "")


@dataclass(frozen=True)
class ParameterGroup:
    """Parameters that one physical cause moves together: kept or dropped together by calibration.

    Attributes:
        name: short.
        meaning: what it is on the machine.
        parameters: its parameters.
    """

    name: str
    meaning: str
    parameters: tuple[GeometricParameter, ...]


class ParameterCatalogue:
    """Everything that can be wrong with the geometry of a robot, by name: DH table, joint placements, drives.

    Args:
        nominal: the mechanism of the drawing.

    Raises:
        NotUPUError: it has chains for which there is no DH table.
    """

    def __init__(self, nominal: ClosedChainMechanism) -> None:
        """List every parameter by name."""
        self.table = DHTable.from_mechanism(nominal)
        self.drives = drive_parameters(nominal)
        self.placements = placement_parameters(self.table.joints)
        chain_of = {joint: n for n, chain in self.table.chains.items() for joint in chain.joints}
        parameters = (
            *(Parameter(p.name, p.chain, f"chain {p.chain} {p.part}", p.local, p) for p in self.table.parameters),
            *(Parameter(p.name, chain_of[p.joint], p.joint, p) for p in self.placements),
            *(Parameter(p.name, chain_of[p.joint], p.name, p) for p in self.drives),
        )
        self.parameters = {p.name: p for p in parameters}

    def match(self, name: str) -> tuple[Parameter, ...]:
        """Return the parameters of a set, a group, a name or a shell pattern.

        A pattern means the errors of the machine: DH numbers that drop out must be asked for by their full names.

        Raises:
            BadInputError: there is none.
        """
        if name in self.parameters:
            return (self.parameters[name],)
        patterns = [pattern for group in SETS.get(name, (name,)) for pattern in GROUPS.get(group, ("", (group,)))[1]]
        errors = [p for p in self.parameters.values() if p.dh is None or not p.dh.drops_out]
        found = {p.name: p for pattern in patterns for p in errors if fnmatch.fnmatchcase(p.name, pattern)}
        if not found:
            near = closest(name, {*SETS, *GROUPS, *self.parameters})
            some = f"alpha_e1_56, {self.placements[0].name}, {self.drives[0].name}"
            hint = f"; names are like {some}; or give a set ({', '.join(SETS)}) or a group ({', '.join(GROUPS)})"
            raise BadInputError(f"no parameter is called '{name}'{near if near.startswith('; did') else hint}")
        return tuple(found.values())

    def groups(self, wanted: Sequence[str] = ("geometry",)) -> tuple[ParameterGroup, ...]:
        """Return what is to be identified: groups of sets, groups and patterns, each parameter in the first only.

        Raises:
            BadInputError: a name matches nothing that measurements can show, or nothing is wanted.
        """
        taken: set[str] = set()
        groups = []
        for name in dict.fromkeys(group for asked in wanted for group in SETS.get(asked, (asked,))):
            found = self.match(name)
            seen = [p for p in found if not p.hidden_by]
            if not seen:
                raise BadInputError(f"'{name}' cannot be identified: {found[0].hidden_by}")
            fresh = tuple(p.local for p in seen if p.name not in taken)
            taken |= {p.name for p in fresh}
            if fresh:
                groups.append(ParameterGroup(name, GROUPS.get(name, ("as given",))[0], fresh))
        if not groups:
            raise BadInputError(f"name the parameters to identify: a set ({', '.join(SETS)}) or patterns")
        return tuple(groups)


def all_parameters(groups: Sequence[ParameterGroup]) -> tuple[GeometricParameter, ...]:
    """Return the parameters of groups, in order."""
    return tuple(p for group in groups for p in group.parameters)
