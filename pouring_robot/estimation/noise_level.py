"""How noisy each kind of instrument is, and where that figure comes from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from pouring_robot.estimation.instruments import KINDS, LENGTHS, Kind
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.poses import MM, MRAD

Source = Literal["stated", "repeats", "residuals", "none"]
FIRST_GUESS = 1e-3
LEAST_NOISE = 1e-9  # m or rad


@dataclass(frozen=True)
class Noise:
    """The noise of one kind of instrument."""

    sigma: float = FIRST_GUESS  # standard deviation of a component, in m or rad
    source: Source = "none"  # where the figure comes from; ``none``: nothing of the kind was measured
    freedoms: float = float("inf")  # of a figure from repeats, infinite for any other: see :attr:`NoiseLevel.freedoms`


@dataclass(frozen=True)
class NoiseLevel:
    """The noise of every kind."""

    kinds: Mapping[Kind, Noise]  # a kind that is left out was not measured

    @classmethod
    def stated(cls, position_m: float, rotation_rad: float | None) -> NoiseLevel:
        """Return the noise of a device; None: it measures positions only."""
        rotation = Noise() if rotation_rad is None else Noise(rotation_rad, "stated")
        return cls({"position": Noise(position_m, "stated"), "rotation": rotation})

    def __getitem__(self, kind: Kind) -> Noise:
        """Return the noise of a kind."""
        return self.kinds.get(kind, Noise())

    @property
    def position_m(self) -> float:
        """Standard deviation of a coordinate, in m."""
        return self["position"].sigma

    @property
    def rotation_rad(self) -> float:
        """Standard deviation of a rotation component, in rad."""
        return self["rotation"].sigma

    def times(self, factors: Mapping[Kind, float]) -> NoiseLevel:
        """Return other sizes; exact data have none, but a noise must be positive."""
        changed = {k: replace(self[k], sigma=max(self[k].sigma * f, LEAST_NOISE)) for k, f in factors.items()}
        return NoiseLevel({**self.kinds, **changed})

    @property
    def open_kinds(self) -> tuple[Kind, ...]:
        """The kinds whose noise is what a fit leaves over."""
        return tuple(kind for kind in KINDS if self[kind].source == "residuals")

    @property
    def length_kind(self) -> Kind:
        """What counts as length: positions, or what was measured in their stead."""
        return next((kind for kind in LENGTHS if self[kind].source != "none"), "position")

    @property
    def length_m(self) -> float:
        """Standard deviation of that, in m."""
        return self[self.length_kind].sigma

    def figures(self) -> dict[str, float | str | None]:
        """Return sizes and sources as results hold them, in mm and mrad; None: nothing of the kind was measured."""
        found: dict[str, float | str | None] = {}
        for kind in KINDS:
            unit, si = ("mrad", MRAD) if kind == "rotation" else ("mm", MM)
            source = self[kind].source
            if source != "none" or kind in ("position", "rotation"):
                found |= {
                    f"{kind}_{unit}": self[kind].sigma / si if source != "none" else None,
                    f"{kind}_source": source,
                }
        return found

    @property
    def turned(self) -> bool:
        """Whether rotations were measured."""
        return self["rotation"].source != "none"

    @property
    def sigma(self) -> FloatArray:
        """Standard deviation of each measured component of a pose, shape (6,) or (3,), in m and rad."""
        return np.repeat([self.position_m, self.rotation_rad] if self.turned else [self.position_m], 3)

    @property
    def freedoms(self) -> float:
        """Degrees of freedom behind the less well known figure, to judge a sum of squares by; infinite where stated.

        A noise that k repeats gave is itself uncertain, by 1 / sqrt(2 k): a sum of n squared residuals over its square
        follows n F(n, k), not chi-square(n). With fewer than about 100 freedoms chi-square takes chance for a gap.
        """
        return min(noise.freedoms for noise in self.kinds.values())

    @property
    def from_residuals(self) -> bool:
        """Whether a figure is what the fit left over, so that it cannot serve to judge the fit."""
        return bool(self.open_kinds)
