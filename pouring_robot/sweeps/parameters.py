"""The parameters of a sweep: names and patterns resolved against the robot, and what their values do to its joints.

A parameter is a number of the DH table (``alpha_e1_56``), a component of a joint's placement error (``leg1_s1.tx``), or
the error of a drive (``drive.leg1_s3``). All of them act on top of the robot as it is: DH errors first, exactly as
:meth:`~pouring_robot.robot.pouring.dh.table.DHTable.placement_errors` has them, then placement errors.
"""

from __future__ import annotations

import fnmatch
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from pouring_robot.exceptions import closest
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.parameters import COMPONENTS, DriveParameter, LocalParameter, placement_parameters
from pouring_robot.robot.pouring.dh.chain import SEAT, SITES, SYMBOLS, TRANSFORMS, DHChain, dh_transform, inverse
from pouring_robot.robot.pouring.dh.table import DHTable
from pouring_robot.sweeps.config import ErrorEntry, SweepConfig

DRIVE_PREFIX = "drive."


@dataclass(frozen=True)
class SweepParameter:
    """One number that may be wrong.

    Attributes:
        name: as in the sweep file.
        unit: ``m`` or ``rad``.
        kind: what it is.
        chain: number of the chain it lies in.
        part: the part of the machine it is measured on; errors of one part may be correlated.
        joint: the URDF joint it displaces, or the drive.
        place: (transform, symbol) of a DH number; (component, 0) of a placement error; (drive, 0) of a drive.
        local: the same as a local parameter, for the error-transfer matrix.
        entry: which of the sweep file's ``errors`` it comes from.
    """

    name: str
    unit: str
    kind: Literal["dh", "placement", "drive"]
    chain: int
    part: str
    joint: str
    place: tuple[int, int]
    local: LocalParameter
    entry: int = 0


class ParameterCatalogue:
    """Everything that can be wrong with a robot.

    Args:
        nominal: the mechanism of the drawing.
    """

    def __init__(self, nominal: ClosedChainMechanism) -> None:
        """List every parameter by name."""
        self.table = DHTable.from_mechanism(nominal)
        self.drives = nominal.loops.drives
        chain_of = {joint: n for n, chain in self.table.chains.items() for joint in chain.joints}
        known: dict[str, SweepParameter] = {}
        for p in self.table.parameters:
            place = TRANSFORMS.index(p.transform), SYMBOLS.index(p.symbol)
            part = f"chain {p.chain} {p.meaning.split(':')[0]}"
            known[p.name] = SweepParameter(p.name, p.unit, "dh", p.chain, part, p.joint, place, p.local)
        for q in placement_parameters(self.table.joints):
            place = COMPONENTS.index(q.name.rpartition(".")[2]), 0
            known[q.name] = SweepParameter(q.name, q.unit, "placement", chain_of[q.joint], q.joint, q.joint, place, q)
        limits = {p.moves_with: p.unit for p in self.table.parameters if p.moves_with}
        for k, joint in enumerate(self.drives):
            d = DriveParameter(joint, limits[joint])
            known[d.name] = SweepParameter(d.name, d.unit, "drive", chain_of[joint], d.name, joint, (k, 0), d)
        self._known = known
        # A pattern means the errors of the machine; what drops out must be asked for by its full name.
        dropped = {p.name for p in self.table.parameters if p.drops_out}
        self._matched = [name for name in known if name not in dropped]

    def match(self, pattern: str) -> list[SweepParameter]:
        """Return the parameters of a name or pattern, in the catalogue's order; empty if there is none."""
        if pattern in self._known:
            return [self._known[pattern]]
        return [self._known[name] for name in self._matched if fnmatch.fnmatchcase(name, pattern)]

    def hint(self, pattern: str) -> str:
        """Return what to write instead of a name that matches nothing."""
        near = closest(pattern, self._known)
        return near if near.startswith("; did") else "; names are like alpha_e1_56, leg1_s1.tx, drive.leg1_s3"

    def select(self, config: SweepConfig) -> tuple[SweepParameter, ...]:
        """Return the parameters of a sweep in the order of its ``errors``.

        Raises:
            BadInputError: a name matches nothing, a parameter is given twice or has no size of its unit.
        """
        chosen: dict[str, SweepParameter] = {}
        for number, entry in enumerate(config.errors):
            own: dict[str, SweepParameter] = {}
            for pattern in entry.parameters:
                matches = self.match(pattern)
                if not matches:
                    raise config.problem(f"the robot has no parameter '{pattern}'{self.hint(pattern)}", number)
                own |= {p.name: replace(p, entry=number) for p in matches}
            twice = [name for name in own if name in chosen]
            if twice:
                first = chosen[twice[0]].entry
                raise config.problem(f"'{twice[0]}' is given twice: here and in errors.{first}", number)
            _refuse_sizeless(config, number, entry, own.values())
            chosen |= own
        return tuple(chosen.values())


def _refuse_sizeless(config: SweepConfig, number: int, entry: ErrorEntry, own: Iterable[SweepParameter]) -> None:
    size = "half_width" if entry.distribution == "uniform" else "std"
    for p in own:
        if entry.size_si(size, p.unit) is None:
            unit = "mm" if p.unit == "m" else "mrad"
            raise config.problem(f"'{p.name}' needs {size}_{unit}", number)


class ErrorMap:
    """Turns arrays of parameter values into placement errors and drive errors.

    Args:
        catalogue: of the robot.
        parameters: columns of the values.
    """

    def __init__(self, catalogue: ParameterCatalogue, parameters: Sequence[SweepParameter]) -> None:
        """Sort the columns by what they do."""
        self.joints = catalogue.table.joints
        self._drive_count = len(catalogue.drives)
        self._drives = [(k, p.place[0]) for k, p in enumerate(parameters) if p.kind == "drive"]
        site = {joint: k for k, joint in enumerate(self.joints)}
        self._placements = [(k, site[p.joint], p.place[0]) for k, p in enumerate(parameters) if p.kind == "placement"]
        self._dh: list[tuple[DHChain, list[tuple[int, tuple[int, int]]], list[tuple[int, int]]]] = []
        for number, chain in catalogue.table.chains.items():
            columns = [(k, p.place) for k, p in enumerate(parameters) if p.kind == "dh" and p.chain == number]
            if columns:
                touched = sorted({SITES[place[0]] for _, place in columns})
                self._dh.append((chain, columns, [(own, site[chain.joints[own]]) for own in touched]))

    def drive_errors(self, values: FloatArray) -> FloatArray:
        """Return the errors of the drives in m and rad, shape (n, drives), for values (n, parameters)."""
        errors = np.zeros((len(values), self._drive_count))
        for column, drive in self._drives:
            errors[:, drive] += values[:, column]
        return errors

    def placement_errors(self, values: FloatArray) -> FloatArray:
        """Return the displacement of every joint of :attr:`joints`.

        Args:
            values: parameter values in m and rad, shape (n, parameters).

        Returns:
            Translation in m and rotation vector in rad in the joint's placement frame, shape (n, joints, 6).
        """
        errors = np.zeros((len(values), len(self.joints), 6))
        for column, site, component in self._placements:
            errors[:, site, component] = values[:, column]
        displaced_too = {site for _, site, _ in self._placements}
        for chain, columns, touched in self._dh:
            numbers = np.zeros((len(values), len(TRANSFORMS), len(SYMBOLS)))
            for column, place in columns:
                numbers[:, place[0], place[1]] = values[:, column]
            for own, site in touched:
                transforms = [k for k, k_site in enumerate(SITES) if k_site == own]
                rows = numbers[:, transforms].any(axis=(1, 2))  # without errors the joint stays exactly where it is
                moved = site_displacement(chain, own, numbers[rows])
                if site in displaced_too:
                    moved = moved @ homogeneous(errors[rows, site])
                errors[rows, site, :3] = moved[:, :3, 3]
                errors[rows, site, 3:] = Rotation.from_matrix(moved[:, :3, :3]).as_rotvec()
        return errors


def site_displacement(chain: DHChain, site: int, numbers: FloatArray) -> FloatArray:
    """Return the exact displacement of one joint of a chain, for arrays of DH errors.

    Args:
        chain: the chain; its module says why a DH error is a displaced placement.
        site: which of its six joints.
        numbers: errors of its DH numbers, shape (n, 8, 4), in m and rad.

    Returns:
        Homogeneous matrices, shape (n, 4, 4).
    """
    first, *others = [k for k, own in enumerate(SITES) if own == site]
    product = dh_transform(chain.nominal[first] + numbers[:, first])
    for k in others:
        product = product @ dh_transform(chain.nominal[k] + numbers[:, k])
    if site == SEAT:
        product = inverse(product)
    return np.asarray(chain.before[site] @ product @ chain.after[site])


def homogeneous(errors: FloatArray) -> FloatArray:
    """Return placement errors (n, 6), translation (m) and rotation vector (rad), as matrices (n, 4, 4)."""
    matrix = np.zeros((len(errors), 4, 4))
    matrix[:, :3, :3] = Rotation.from_rotvec(errors[:, 3:]).as_matrix()
    matrix[:, :3, 3] = errors[:, :3]
    matrix[:, 3, 3] = 1.0
    return matrix
