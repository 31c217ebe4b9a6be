"""The gap between model and measurement, before and after, against the noise floor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pouring_robot.diagnosis.rows import WhitenedRows
from pouring_robot.estimation.instruments import component_name
from pouring_robot.mechanism.arrays import FloatArray, rms
from pouring_robot.mechanism.poses import MM, MRAD


def component_unit(component: int) -> float:
    """Return what makes m and rad of a component in the unit it is shown in: mm, mrad for rotations."""
    return MRAD if 3 <= component < 6 else MM


def table_of(seen: WhitenedRows, whitened: FloatArray, rows: int) -> FloatArray:
    """Return what is whitened, (m,), as a table (rows, K) in the tracker's axes, in m and rad; NaN where unmeasured."""
    table = np.full((rows, max(6, int(seen.component.max()) + 1)), np.nan)
    table[seen.row, seen.component] = whitened * seen.tracker
    return table


def in_base(table: FloatArray, axes: FloatArray) -> FloatArray:
    """Return a table (n, K) in the tracker's axes turned into those of the base, (3, 3); NaN where one is missing."""
    return np.hstack([table[:, :3] @ axes, table[:, 3:6] @ axes, table[:, 6:]])


@dataclass(frozen=True, eq=False)
class Gap:
    """Root mean squares of the residual of some rows, per component; NaN where nothing was measured."""

    rows: int  # number of rows
    before: FloatArray  # with the given model and its frames fitted, shape (K,), in m and rad
    after: FloatArray  # with the amended model, shape (K,), in m and rad
    floor: FloatArray  # the noise, shape (K,), in m and rad

    @classmethod
    def between(cls, before: WhitenedRows, after: WhitenedRows, rows: NDArray[np.bool_], sigma: FloatArray) -> Gap:
        """Return the gap of some rows, by a mask (n,), from residuals of all; sigma (K,) is the noise, in m and rad."""
        size = len(sigma)
        was, left = (_by_component(seen.of(rows), size) for seen in (before, after))
        return cls(int(rows.sum()), was, left, np.asarray(sigma, float))

    def position(self, which: str) -> float:
        """Return ``before``, ``after`` or ``floor`` over x, y and z, in m; without places, over the rest."""
        part = slice(0, 3) if np.isfinite(self.before[:3]).any() else slice(6, None)
        return rms(np.where(np.isfinite(self.before), getattr(self, which), np.nan)[part])

    def rotation(self, which: str) -> float:
        """Return ``before``, ``after`` or ``floor`` over the rotation components, in rad; NaN for positions only."""
        values = getattr(self, which)[3:6]
        return rms(values if np.isfinite(self.before[3:6]).any() else np.full(3, np.nan))

    @property
    def closed(self) -> float:
        """Return how much of the position's gap is gone: (before - after) / (before - floor); NaN without a gap."""
        gap = self.position("before") - self.position("floor")
        return (self.position("before") - self.position("after")) / gap if gap > 0.0 else float("nan")

    def metrics(self) -> dict[str, Any]:
        """Return the gap's metrics, in mm and mrad, and each component's."""
        kinds, seen = ("before", "after", "floor"), np.flatnonzero(np.isfinite(self.before)).tolist()
        sizes = {f"{which}_rms_mm": self.position(which) / MM for which in kinds}
        sizes |= {f"{which}_rms_mrad": self.rotation(which) / MRAD for which in kinds}
        components = {
            component_name(k): {which: float(getattr(self, which)[k] / component_unit(k)) for which in kinds}
            for k in seen
        }
        return {"rows": self.rows, **sizes, "components": components}


def _by_component(seen: WhitenedRows, size: int) -> FloatArray:
    values = seen.residual * seen.tracker
    return np.array([rms(values[seen.component == k]) for k in range(size)])
