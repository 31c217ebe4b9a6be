"""Residuals in which to find where model and data disagree, and single findings: a record, a sentence, an entry."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np

from pouring_robot.estimation.kinds import are, kinds_of
from pouring_robot.estimation.noise import LEAST_NOISE, NoiseLevel, noise_ratio, p_value
from pouring_robot.exceptions import BadInputError
from pouring_robot.inference.gaussian_processes.processes import Channel
from pouring_robot.inference.problem import Nuisance
from pouring_robot.io.figures import two_digits
from pouring_robot.io.units import MM, MRAD, shown_in
from pouring_robot.mechanism.arrays import BoolArray, FloatArray, Indices


@dataclass(frozen=True, eq=False)
class FreeResiduals:
    """Residuals of a model with only its two frames fitted.

    Raises:
        BadInputError: there are no more equations than the frames absorb, or shapes do not fit.
    """

    residual: FloatArray  # measured minus predicted, divided by the noise, shape (m,)
    row: Indices  # row of each equation, (m,)
    component: Indices  # component of each equation in the tracker's axes, (m,)
    sigma: FloatArray  # noise of each equation, (m,), in m or rad
    nuisance: Nuisance  # what the frames can explain
    axes: FloatArray  # axes of the base in the tracker's frame, (3, 3)
    drives: tuple[Channel, ...]  # of a m or rad of each drive
    noise: NoiseLevel = field(default_factory=lambda: NoiseLevel({}))  # source of ``sigma``; empty: it is stated

    def __post_init__(self) -> None:
        m = self.residual.size
        if not self.row.size == self.component.size == self.sigma.size == len(self.nuisance.axes) == m:
            raise BadInputError(f"residuals, rows, components, noise and nuisance columns must each have {m} entries")
        if m <= self.nuisance.dof:
            said = f"{m} measured values show no more than the {self.nuisance.dof} unknowns of the frames"
            raise BadInputError(said)

    @property
    def noise_known(self) -> bool:
        """Whether ``sigma`` was neither guessed nor estimated from these residuals."""
        return not self.noise.from_residuals

    @cached_property
    def cleared(self) -> FloatArray:
        """The residual with the frames projected out, (m,)."""
        return self.nuisance.cleared(self.residual)

    def p_value(self, squares: float, dof: float) -> float:
        """Return the probability that noise alone makes as large a sum of squares, with ``dof`` degrees of freedom."""
        return p_value(squares, dof, self.noise.dof)

    @cached_property
    def turning(self) -> BoolArray:
        """Which equations are of rotations, (m,)."""
        return are("rotation", self.component)

    def scaled(self, left: FloatArray) -> FreeResiduals:
        """Return the same with the scatter of residuals ``left``, (m,), of each kind of reading, as its noise.

        At least :data:`LEAST_NOISE`: what the frames explain exactly, such as a single rotation, leaves rounding only.
        """
        factor, freedom = LEAST_NOISE / self.sigma, 1.0 - np.square(self.nuisance.axes).sum(axis=1)
        for kind in kinds_of(self.component):
            own = are(kind, self.component)
            factor[own] = np.maximum(factor[own], noise_ratio(left[own], freedom[own], fewest=0.0))
        return replace(
            self,
            residual=self.residual / factor,
            sigma=self.sigma * factor,
            nuisance=Nuisance.of(self.nuisance.axes / factor[:, None]),
            drives=tuple(replace(one, column=one.column / factor) for one in self.drives),
        )


@dataclass(frozen=True)
class Finding:
    """One finding about the disagreement."""

    what: Literal["lack of fit", "repeats", "component", "condition", "region"]
    sentence: str  # in words
    size: float  # root mean square, in m or rad
    p_value: float | None  # probability that noise alone makes as much anywhere; None where the noise is unknown
    component: str = ""  # component in which it is largest; "" for all together
    turning: bool = False  # whether its unit is rad
    condition: str = ""  # condition or region; "" for none
    rivals: tuple[str, ...] = ()  # conditions that varied with it and would explain it as well
    share: float = 1.0  # share of the sum of squares that this condition explains

    def figures(self) -> dict[str, object]:
        """Return it as ``diagnosis.json`` holds it."""
        size = {"size_mrad": self.size / MRAD} if self.turning else {"size_mm": self.size / MM}
        out = {"what": self.what, "component": self.component, "condition": self.condition, **size}
        out |= {"p_value": self.p_value, "sentence": self.sentence}
        return out | ({"or": list(self.rivals)} if self.rivals else {})


def size_text(size: float, turning: bool = False) -> str:
    """Return a size in m or rad as mm or mrad, two figures."""
    unit, si = shown_in("rad" if turning else "m")
    return f"{size / si:.{two_digits(size / si, fewest=1)}f} {unit}"
