"""The DH table: 32 geometric parameters per chain, as the paper counts them, linked to the joints of the URDF.

    table = DHTable.from_mechanism(RobotModel().definition.mechanism())
    placements = table.placement_errors({"alpha_e1_56": 4e-3, "a_e2_01": 2e-4})   # rad, m
    urdf = perturb_urdf(urdf, placements)                                         # the same robot, exactly
    table.errors_from_placements(placements)                                      # and back

Conventions, and why a DH error is a displaced joint placement: see :mod:`~pouring_robot.robot.dh.chain`.
"""

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, Self

import numpy as np
import pinocchio as pin

from pouring_robot.exceptions import BadInputError, UnknownJointError, closest
from pouring_robot.mechanism.arrays import FloatArray, locked
from pouring_robot.mechanism.closed_chain import ClosedChainMechanism
from pouring_robot.mechanism.local_parameters import PlacementParameter, Twist
from pouring_robot.robot.dh.chain import ALPHA, SITES, SYMBOLS, TRANSFORMS, VARIABLES, A, D, DHChain, dh_chain
from pouring_robot.robot.dh.fit import fit_errors

Transform = Literal["O0", "01", "12", "23", "34", "45", "56", "6o"]
Symbol = Literal["a", "alpha", "d", "theta"]
Role = Literal["geometric", "drive", "joint variable", "convention"]

_PARTS = {
    "O0": "fixed-platform installation",
    "01": "upper U joint",
    "12": "upper U joint",
    "23": "fixed rod",
    "34": "moving rod",
    "45": "lower U joint",
    "56": "lower U joint",
    "6o": "moving-platform installation",
}
_MEANINGS = {
    "a": "distance between axes S_{0} and S_{1}",
    "alpha": "angle between axes S_{0} and S_{1}",
    "d": "distance along S_{1} between its common normals",
    "theta": "angle about S_{1} between its common normals",
}
_CONVENTION = (A, ALPHA, D)  # of O→0: S_0 is Z of the fixed platform, same origin


class UnknownParameterError(BadInputError):
    """A DH parameter was named that is not in the table."""

    def __init__(self, name: str, known: Iterable[str]) -> None:
        self.name, self.known = name, tuple(known)
        near = closest(name, self.known)
        hint = near if near.startswith("; did") else "; names are like 'alpha_e1_56' (m or rad)"
        super().__init__(f"the DH table has no parameter '{name}'{hint}")


@dataclass(frozen=True)
class DHParameter:
    """One parameter of the DH table."""

    name: str  # ``alpha_e1_56``: symbol, chain, transform (a, alpha) or the frame it leads to (d, theta)
    chain: int  # 1 to 4
    transform: Transform  # the transform it belongs to
    symbol: Symbol  # which of the transform's four numbers it is
    unit: Literal["m", "rad"]  # ``m`` or ``rad``: of the nominal value and of errors; ``twist`` is per this unit
    nominal: float  # value in the drawing; of a joint variable, with the URDF joint at zero
    meaning: str  # what it is on the machine
    role: Role  # ``geometric``; ``drive`` or ``joint variable``, to which a joint's value is added; ``convention``
    moves_with: str | None  # the URDF joint whose value is added to it, if any
    reason: str  # why it drops out of the error analysis; empty if it does not
    joint: str  # the URDF joint whose placement an error of it displaces
    # displacement of that placement per unit of error, (linear, angular) in the joint's nominal placement frame; m or
    # rad per unit
    twist: Twist

    @property
    def part(self) -> str:
        """The part of the chain on which it is measured."""
        return _PARTS[self.transform]

    @property
    def place(self) -> tuple[int, int]:
        """Its row and column in the chain's arrays (8, 4)."""
        return TRANSFORMS.index(self.transform), SYMBOLS.index(self.symbol)

    @property
    def drops_out(self) -> bool:
        """Whether the paper (its section 4.2) leaves it out: an error in it would not be an error of the machine."""
        return bool(self.reason)

    @property
    def local(self) -> PlacementParameter:
        """The same as a local parameter of the mechanism, for the error-transfer matrix; first order at the nominal."""
        return PlacementParameter(self.name, self.unit, self.joint, self.twist)


def chain_parameters(chain: DHChain, drives: Collection[str]) -> Iterable[DHParameter]:
    """Yield the 32 parameters of a chain, in order: transform by transform, a, α, d, θ."""
    twists = chain.placement_twists() + 0.0
    variables = {place: chain.joints[k] for k, place in enumerate(VARIABLES)}
    for t, transform in enumerate(TRANSFORMS):
        for s, symbol in enumerate(SYMBOLS):
            joint = variables.get((t, s))
            x, y, z, rx, ry, rz = (float(component) for component in twists[t, s])
            role, reason = _role(t, s, joint, drives)
            yield DHParameter(
                name=f"{symbol}_e{chain.number}_{transform if s in (A, ALPHA) else transform[1]}",
                chain=chain.number,
                transform=transform,  # type: ignore[arg-type]  # mypy widens the elements of a tuple of literals
                symbol=symbol,  # type: ignore[arg-type]
                unit="m" if s in (A, D) else "rad",
                nominal=float(chain.nominal[t, s]),
                meaning=f"{_PARTS[transform]}: {_MEANINGS[symbol].format(*transform)}",
                role=role,
                moves_with=joint,
                reason=reason,
                joint=chain.joints[SITES[t]],
                twist=(x, y, z, rx, ry, rz),
            )


def _role(transform: int, symbol: int, joint: str | None, drives: Collection[str]) -> tuple[Role, str]:
    """Return what a parameter is, and why it drops out if it does (the paper's section 4.2)."""
    if joint is not None:
        return ("drive", "") if joint in drives else ("joint variable", f"passive joint '{joint}' compensates for it")
    if transform == 0 and symbol in _CONVENTION:
        return "convention", "S_0 is by definition Z of the fixed platform, with the same origin"
    return "geometric", ""


class DHTable:
    """The DH parameters of all chains, in order: chain by chain, transform by transform, a, α, d, θ.

    Unknown names raise UnknownParameterError; invalid errors, joint values and chains raise BadInputError.

    Attributes:
        parameters: All of them: 128 for four chains.
        joints: All joints whose placements they displace, chain by chain: S1 to S5 and the seat.
        chains: The numeric description of each chain by its number.
    """

    def __init__(self, chains: Sequence[DHChain], drives: Collection[str]) -> None:
        self.chains: Mapping[int, DHChain] = locked({chain.number: chain for chain in chains})
        self.parameters = tuple(p for chain in chains for p in chain_parameters(chain, drives))
        self._by_name = {p.name: p for p in self.parameters}
        self._sites = {joint: (chain, k) for chain in chains for k, joint in enumerate(chain.joints)}
        self.joints = tuple(self._sites)

    @classmethod
    def from_mechanism(cls, mechanism: ClosedChainMechanism) -> Self:
        """Derive the table from a loaded nominal robot; raises NotUPUError where a chain is not a UPU chain."""
        chains = [dh_chain(mechanism, index) for index in range(len(mechanism.anchors))]
        return cls(chains, mechanism.loops.drives)

    def __getitem__(self, name: str) -> DHParameter:
        """Return a parameter by name; raises UnknownParameterError where it does not exist."""
        if name not in self._by_name:
            raise UnknownParameterError(name, self._by_name)
        return self._by_name[name]

    def selection(self, *, chain: int | None = None) -> tuple[DHParameter, ...]:
        """Return the parameters that do not drop out, of one chain or of all, in order."""
        return tuple(p for p in self.parameters if not p.drops_out and chain in (None, p.chain))

    def chain_poses(
        self, chain: int, joint_values: Sequence[float] | FloatArray, errors: Mapping[str, float] | None = None
    ) -> FloatArray:
        """Return the poses (..., 4, 4) of the moving platform o in the fixed platform O at joint values of one chain.

        Joint values (..., 5) are those of its URDF joints in order, in m and rad. Errors are by parameter name, in m
        and rad; those of other chains are ignored.
        """
        values = np.asarray(joint_values, dtype=float)
        if values.shape[-1:] != (5,) or not np.isfinite(values).all():
            raise BadInputError(
                f"chain {chain} has five joints: give finite values of shape (..., 5), not {values.shape}"
            )
        if chain not in self.chains:
            raise BadInputError(f"there is no chain {chain}; the robot has {', '.join(map(str, self.chains))}")
        return self.chains[chain].poses(values, self._error_arrays(errors)[chain])

    def placement_errors(self, errors: Mapping[str, float]) -> dict[str, pin.SE3]:
        """Return the displaced joint placements equivalent to DH errors (m, rad), exactly and for all joint values.

        An error of a joint variable or drive is included: it displaces the joint along or about its own axis.
        """
        arrays = self._error_arrays(errors)
        touched = {self[name].joint for name, value in errors.items() if value != 0.0}
        moved = {number: chain.displacements(arrays[number]) for number, chain in self.chains.items()}
        return {joint: pin.SE3(moved[chain.number][k]) for joint, (chain, k) in self._sites.items() if joint in touched}

    def errors_from_placements(self, placements: Mapping[str, pin.SE3]) -> dict[str, float]:
        """Return the DH errors (m, rad; in table order) of every chain with a displaced joint.

        A chain has more parameters than its pose can determine. Returned is the smallest solution, each error measured
        in units of its size in the paper (0.2 mm, 4 mrad). It gives the same pose for all joint values, to 1e-12; for
        this, passive joint variables have errors too. The convention's parameters are not listed.

        Raises:
            UnknownJointError: a joint is not part of a chain.
            NoSolutionError: the displacements are too large to be errors.
        """
        for joint in placements:
            if joint not in self._sites:
                raise UnknownJointError(joint, self._sites)
        result, none = dict[str, float](), pin.SE3.Identity()
        for number in sorted({self._sites[joint][0].number for joint in placements}):
            chain = self.chains[number]
            moved = np.stack([placements.get(joint, none).homogeneous for joint in chain.joints])
            parameters = [p for p in self.parameters if p.chain == number]
            fitted = np.array([p.role != "convention" for p in parameters]).reshape(8, 4)
            found = fit_errors(chain, moved, fitted)[fitted]
            names = (p.name for p in parameters if p.role != "convention")
            result |= dict(zip(names, found.tolist(), strict=True))
        return result

    def _error_arrays(self, errors: Mapping[str, float] | None) -> dict[int, FloatArray]:
        """Return the errors of each chain as an array (8, 4)."""
        arrays = {number: np.zeros((8, 4)) for number in self.chains}
        for name, value in (errors or {}).items():
            parameter = self[name]
            if not math.isfinite(value):
                raise BadInputError(f"the error of '{name}' must be a finite number, not {value}")
            arrays[parameter.chain][parameter.place] = value
        return arrays
