"""How noisy each kind of instrument is, and where that figure comes from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from pouring_robot.estimation.instruments import KINDS, LENGTHS, Kind
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.poses import MM, MRAD

Source = Literal["stated", "repeats", "residuals", "none"]
FIRST_GUESS_M, FIRST_GUESS_RAD = 1e-3, 1e-3
LEAST_NOISE = 1e-9  # m or rad


@dataclass(frozen=True)
class NoiseLevel:
    """Standard deviations of one measured component."""

    position_m: float  # of a coordinate, in m
    rotation_rad: float  # of a rotation component, in rad
    position_source: Source  # where the figure comes from; ``none``: nothing of it was measured
    rotation_source: Source  # the same for rotations
    position_freedoms: float = float("inf")  # of a figure from repeats, infinite for any other: see :attr:`freedoms`
    rotation_freedoms: float = float("inf")  # the same for rotations
    distance_m: float = FIRST_GUESS_M  # of a distance, in m; ``closure_m`` of what redundant drives disagree by
    closure_m: float = FIRST_GUESS_M
    distance_source: Source = "none"  # where that comes from; ``closure_source`` likewise
    closure_source: Source = "none"

    @classmethod
    def stated(cls, position_m: float, rotation_rad: float | None) -> NoiseLevel:
        """Return the noise of a device; None: it measures positions only."""
        if rotation_rad is None:
            return cls(position_m, FIRST_GUESS_RAD, "stated", "none")
        return cls(position_m, rotation_rad, "stated", "stated")

    def of(self, kind: Kind) -> float:
        """Return the standard deviation of a component of a kind, in m or rad."""
        return float(getattr(self, field_of(kind)))

    def source(self, kind: Kind) -> Source:
        """Return where that comes from; ``none``: nothing of the kind was measured."""
        source: Source = getattr(self, f"{kind}_source")
        return source

    def times(self, factors: Mapping[Kind, float]) -> NoiseLevel:
        """Return other sizes; exact data have none, but a noise must be positive."""
        changed: dict[str, Any] = {field_of(kind): max(self.of(kind) * f, LEAST_NOISE) for kind, f in factors.items()}
        return replace(self, **changed)

    @property
    def open_kinds(self) -> tuple[Kind, ...]:
        """The kinds whose noise is what a fit leaves over."""
        return tuple(kind for kind in KINDS if self.source(kind) == "residuals")

    @property
    def length_kind(self) -> Kind:
        """What counts as length: positions, or what was measured in their stead."""
        return next((kind for kind in LENGTHS if self.source(kind) != "none"), "position")

    @property
    def length_m(self) -> float:
        """Standard deviation of that, in m."""
        return self.of(self.length_kind)

    def figures(self) -> dict[str, float | str | None]:
        """Return sizes and sources as results hold them, in mm and mrad; None: nothing of the kind was measured."""
        found: dict[str, float | str | None] = {}
        for kind in KINDS:
            unit, si = ("mrad", MRAD) if kind == "rotation" else ("mm", MM)
            source = self.source(kind)
            if source != "none" or kind in ("position", "rotation"):
                found |= {f"{kind}_{unit}": self.of(kind) / si if source != "none" else None, f"{kind}_source": source}
        return found

    @property
    def turned(self) -> bool:
        """Whether rotations were measured."""
        return self.rotation_source != "none"

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
        return min(self.position_freedoms, self.rotation_freedoms)

    @property
    def from_residuals(self) -> bool:
        """Whether a figure is what the fit left over, so that it cannot serve to judge the fit."""
        return bool(self.open_kinds)


def field_of(kind: Kind) -> str:
    """Return the attribute of :class:`NoiseLevel` that holds a kind's standard deviation."""
    return "rotation_rad" if kind == "rotation" else f"{kind}_m"
