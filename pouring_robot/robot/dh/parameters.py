"""The parameters of the DH table one by one: names, units, what they are on the machine, which drop out."""

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import Literal

from pouring_robot.exceptions import BadInputError, closest
from pouring_robot.mechanism.parameters import PlacementParameter, Twist
from pouring_robot.robot.dh.chain import ALPHA, SITES, SYMBOLS, TRANSFORMS, VARIABLES, A, D, DHChain

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
    """A DH parameter was named that the table does not hold."""

    def __init__(self, name: str, known: Iterable[str]) -> None:
        self.name, self.known = name, tuple(known)
        near = closest(name, self.known)
        hint = near if near.startswith("; did") else "; names are like 'alpha_e1_56' (m or rad)"
        super().__init__(f"the DH table has no parameter '{name}'{hint}")


@dataclass(frozen=True)
class DHParameter:
    """One number of the DH table."""

    name: str  # ``alpha_e1_56``: symbol, chain, transform (a, alpha) or the frame it leads to (d, theta)
    chain: int  # 1 to 4
    transform: Transform  # the transform it belongs to
    symbol: Symbol  # which of the transform's four numbers it is
    unit: Literal["m", "rad"]  # ``m`` or ``rad``; of the nominal value, of errors, and below the line of ``twist``
    nominal: float  # value on the drawing; of a joint variable, with the URDF joint at zero
    meaning: str  # what it is on the machine
    role: Role  # ``geometric``; ``drive`` or ``joint variable``, to which a joint's value is added; ``convention``
    moves_with: str | None  # the URDF joint whose value is added to it, if any
    reason: str  # why it drops out of the study of errors; empty if it does not
    joint: str  # the URDF joint whose placement an error of it displaces
    # displacement of that placement per unit of error, (linear, angular) in the joint's nominal placement frame; m or
    # rad per unit
    twist: Twist

    @property
    def part(self) -> str:
        """The part of the chain it is measured on."""
        return _PARTS[self.transform]

    @property
    def place(self) -> tuple[int, int]:
        """Its row and column in the chain's arrays (8, 4)."""
        return TRANSFORMS.index(self.transform), SYMBOLS.index(self.symbol)

    @property
    def drops_out(self) -> bool:
        """Whether the paper (its section 4.2) leaves it out: an error of it would be no error of the machine."""
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
        return ("drive", "") if joint in drives else ("joint variable", f"passive joint '{joint}' takes it up")
    if transform == 0 and symbol in _CONVENTION:
        return "convention", "S_0 is by definition Z of the fixed platform, with the same origin"
    return "geometric", ""
