"""The parameter catalogue of a robot: every local parameter of its chains by name, and named sets of parameters.

A parameter is the offset of a drive (``drive.<joint>``), a component of a joint's placement error (``<joint>.tx``), or
an error of the DH table (``alpha_e1_56``). Calibration, planning, sweeps and diagnosis all choose from this list.

    [p.name for p in robot.parameters.match("centres")]        # a set, a group, a name or a shell pattern
"""

import fnmatch
from collections.abc import Sequence
from dataclasses import dataclass

from pouring_robot.batch import engine_for
from pouring_robot.exceptions import BadInputError, closest
from pouring_robot.io.argument_checks import as_tuple, expect
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.local_parameters import GeometricParameter, drive_parameters, placement_parameters
from pouring_robot.robot.description.definition import RobotDefinition
from pouring_robot.robot.dh.table import DHParameter


@dataclass(frozen=True)
class Parameter:
    """One geometric parameter that may have an error."""

    name: str  # as in files and on the command line
    chain: int  # number of its chain; 0 in a robot whose chains have no numbers
    part: str  # the part of the machine it is measured on
    local: GeometricParameter  # the same as a local parameter, for the error-transfer matrix
    dh: DHParameter | None = None  # the DH parameter that it is an error of, if any

    @property
    def unit(self) -> str:
        """``m`` or ``rad``."""
        return self.local.unit

    @property
    def hidden_by(self) -> str:
        """Why measurements cannot identify it as a separate error; empty if they can."""
        if self.dh is None:
            return ""
        return self.dh.reason or (f"it is drive.{self.dh.moves_with}" if self.dh.role == "drive" else "")


@dataclass(frozen=True)
class ParameterGroup:
    """Parameters that one physical cause changes together; calibration keeps or drops them together."""

    name: str  # short name
    meaning: str  # what it is on the machine
    parameters: tuple[GeometricParameter, ...]  # members of the group


class ParameterCatalogue:
    """All possible errors of a robot's geometry, by name: DH table, joint placements, drives."""

    def __init__(self, definition: RobotDefinition, nominal: ClosedChainMechanism | None = None) -> None:
        nominal = nominal or definition.drawing().mechanism
        self._sets, self._groups = definition.parameter_sets, definition.parameter_groups
        self.drives = drive_parameters(nominal)
        self.table = definition.dh_table(nominal)
        self.joints = self.table.joints if self.table else engine_for(nominal).structure.placed_joints
        definition.check_displaced(self.joints)
        self.placements = placement_parameters(self.joints)
        chains = self.table.chains.items() if self.table else ()
        chain_of = {joint: n for n, chain in chains for joint in chain.joints}
        errors = self.table.parameters if self.table else ()
        parameters = (
            *(Parameter(p.name, p.chain, f"chain {p.chain} {p.part}", p.local, p) for p in errors),
            *(Parameter(p.name, chain_of.get(p.joint, 0), p.joint, p) for p in self.placements),
            *(Parameter(p.name, chain_of.get(p.joint, 0), p.name, p) for p in self.drives),
        )
        self.parameters = {p.name: p for p in parameters}

    def match(self, name: str) -> tuple[Parameter, ...]:
        """Return the parameters of a set, a group, a name or a shell pattern; raises BadInputError where there is none.

        A pattern matches errors of the machine only: DH parameters that drop out must be named in full.
        """
        expect(name, str, "parameters are asked for by name")
        if name in self.parameters:
            return (self.parameters[name],)
        patterns = [
            pattern for group in self._sets.get(name, (name,)) for pattern in self._groups.get(group, ("", (group,)))[1]
        ]
        errors = [p for p in self.parameters.values() if p.dh is None or not p.dh.drops_out]
        found = {p.name: p for pattern in patterns for p in errors if fnmatch.fnmatchcase(p.name, pattern)}
        if not found:
            near = closest(name, {*self._sets, *self._groups, *self.parameters})
            shown = [kind[0].name for kind in (self.placements, self.drives) if kind]
            some = ", ".join(["alpha_e1_56", *shown] if self.table else shown)
            sets, groups = ", ".join(self._sets), ", ".join(self._groups)
            hint = f"; names are like {some}; or give a set ({sets}) or a group ({groups})"
            raise BadInputError(f"no parameter is called '{name}'{near if near.startswith('; did') else hint}")
        return tuple(found.values())

    def groups(self, wanted: Sequence[str] = ("geometry",)) -> tuple[ParameterGroup, ...]:
        """Return the groups to identify, from sets, groups and patterns; a parameter is in the first that matches.

        Raises BadInputError where a name matches nothing that measurements can identify, or no name is given.
        """
        taken: set[str] = set()
        groups = []
        for name in dict.fromkeys(group for asked in as_tuple(wanted) for group in self._sets.get(asked, (asked,))):
            found = self.match(name)
            identifiable = [p for p in found if not p.hidden_by]
            if not identifiable:
                raise BadInputError(f"'{name}' cannot be identified: {found[0].hidden_by}")
            fresh = tuple(p.local for p in identifiable if p.name not in taken)
            taken |= {p.name for p in fresh}
            if fresh:
                groups.append(ParameterGroup(name, self._groups.get(name, ("as given",))[0], fresh))
        if not groups:
            raise BadInputError(f"name the parameters to identify: a set ({', '.join(self._sets)}) or patterns")
        return tuple(groups)


def all_parameters(groups: Sequence[ParameterGroup]) -> tuple[GeometricParameter, ...]:
    """Return the parameters of all groups, in order."""
    return tuple(p for group in groups for p in group.parameters)
