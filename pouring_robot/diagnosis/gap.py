"""The gap between model and measurement, before and after, against the noise floor."""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from pouring_robot.diagnosis.rows import WhitenedRows
from pouring_robot.estimation.kinds import LENGTHS, are, component_name, component_shown_in, kinds_of
from pouring_robot.io.units import MM, MRAD
from pouring_robot.mechanism.arrays import BoolArray, FloatArray, Indices, rms

_WORSE = 1.05
"""A held-out error this many times that before is worse; less is chance: the RMS of 60 coordinates scatters by 9 %."""

_NOISE, _HALF = 1.5, 0.5  # times the noise, below which the residual may be noise; share of the gap


def table_of(seen: WhitenedRows, whitened: FloatArray, rows: int) -> FloatArray:
    """Return whitened values, (m,), as a table (rows, K) in the tracker's axes, in m and rad; NaN where unmeasured."""
    table = np.full((rows, max(6, int(seen.component.max()) + 1)), np.nan)
    table[seen.row, seen.component] = whitened * seen.sigma
    return table


def in_base(table: FloatArray, axes: FloatArray) -> FloatArray:
    """Return a table (n, K) in the tracker's axes rotated into those of the base, (3, 3); NaN where one is missing."""
    return np.hstack([table[:, :3] @ axes, table[:, 3:6] @ axes, table[:, 6:]])


@dataclass(frozen=True, eq=False)
class Gap:
    """Root mean squares of the residual of some rows, per component; NaN where nothing was measured."""

    rows: int  # number of rows
    before: FloatArray  # with the given model, only the frames fitted, shape (K,), in m and rad
    after: FloatArray  # with the amended model, shape (K,), in m and rad
    floor: FloatArray  # the noise, shape (K,), in m and rad
    counts: Indices  # number of values, shape (K,)

    @classmethod
    def between(cls, before: WhitenedRows, after: WhitenedRows, rows: BoolArray, sigma: FloatArray) -> Self:
        """Return the gap of some rows, by a mask (n,), from residuals of all; sigma (K,) is the noise, in m and rad."""
        size = len(sigma)
        was, left = (_by_component(state.of(rows), size) for state in (before, after))
        counts = np.bincount(before.of(rows).component, minlength=size)
        return cls(int(rows.sum()), was, left, np.asarray(sigma, float), counts)

    @property
    def seen(self) -> Indices:
        """The measured components."""
        return np.flatnonzero(self.counts)

    def position(self, which: str) -> float:
        """Return ``before``, ``after`` or ``floor`` over all lengths (x, y, z, distances, closures), in m; NaN if none.

        Each value counts once.
        """
        return self._over(which, ~are("rotation", np.arange(self.counts.size)))

    def rotation(self, which: str) -> float:
        """Return ``before``, ``after`` or ``floor`` over the rotation components, in rad; NaN if none was measured."""
        return self._over(which, are("rotation", np.arange(self.counts.size)))

    def _over(self, which: str, chosen: BoolArray) -> float:
        return rms(np.repeat(getattr(self, which)[chosen], self.counts[chosen]))

    @property
    def length(self) -> str:
        """What one value of :meth:`position` is, in a word."""
        lengths = [kind for kind in kinds_of(self.seen) if kind in LENGTHS]
        return {"position": "coordinate"}.get(lengths[0], lengths[0]) if len(lengths) == 1 else "length"

    @property
    def closed(self) -> float:
        """Share of the gap in position that is closed: (before - after) / (before - floor); NaN without a gap."""
        return share_closed(*(self.position(which) for which in ("before", "after", "floor")))

    @property
    def worse(self) -> bool:
        """Whether the amended model has larger errors than the given one: all values together, each over its noise."""
        before, after = self._in_noise
        return after > _WORSE * before

    @property
    def kept(self) -> bool:
        """Whether more than noise and more than half of the gap, in squares, is left: all values over their noise."""
        before, after = self._in_noise
        return after > _NOISE and after**2 - 1.0 > _HALF * (before**2 - 1.0)

    @property
    def _in_noise(self) -> tuple[float, float]:
        before, after = (rms(np.repeat(size / self.floor, self.counts)) for size in (self.before, self.after))
        return before, after

    def figures(self) -> dict[str, Any]:
        """Return the gap's metrics, in mm and mrad, and each component's."""
        kinds = ("before", "after", "floor")
        sizes = {f"{which}_rms_mm": self.position(which) / MM for which in kinds}
        sizes |= {f"{which}_rms_mrad": self.rotation(which) / MRAD for which in kinds}
        components = {
            component_name(k): {which: float(getattr(self, which)[k] / component_shown_in(k)[1]) for which in kinds}
            for k in self.seen.tolist()
        }
        return {"rows": self.rows, **sizes, "components": components}


def share_closed(before: float, after: float, floor: float) -> float:
    """Return the share of a gap that is closed: (before - after) / (before - floor); NaN without a gap."""
    return (before - after) / (before - floor) if before > floor else float("nan")


def _by_component(seen: WhitenedRows, size: int) -> FloatArray:
    values = seen.residual * seen.sigma
    return np.array([rms(values[seen.component == k]) for k in range(size)])
