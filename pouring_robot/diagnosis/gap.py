"""The gap between model and measurement, before and after, against the noise floor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pouring_robot.diagnosis.rows import LinearRows
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.poses import MM, MRAD

COMPONENTS = ("x", "y", "z", "rx", "ry", "rz")


def table_of(linear: LinearRows, whitened: FloatArray, rows: int) -> FloatArray:
    """Return what is whitened, (m,), as a table (rows, 6) in the tracker's axes, in m and rad; NaN where unmeasured."""
    table = np.full((rows, 6), np.nan)
    table[linear.row, linear.component] = whitened * linear.tracker
    return table


def in_base(table: FloatArray, axes: FloatArray) -> FloatArray:
    """Return a table (n, 6) turned into the axes of the base; NaN where a component is missing.

    Args:
        table: in the tracker's axes.
        axes: axes of the base in the tracker's frame, (3, 3).
    """
    return np.hstack([table[:, :3] @ axes, table[:, 3:] @ axes])


@dataclass(frozen=True, eq=False)
class Gap:
    """Root mean squares of the residual of some rows, per component; NaN where nothing was measured.

    Attributes:
        rows: number of rows.
        before: with the given model and its frames fitted, shape (6,), in m and rad.
        after: with the amended model, shape (6,), in m and rad.
        floor: the noise, shape (6,), in m and rad.
    """

    rows: int
    before: FloatArray
    after: FloatArray
    floor: FloatArray

    @classmethod
    def between(cls, before: LinearRows, after: LinearRows, rows: NDArray[np.bool_], sigma: FloatArray) -> Gap:
        """Return the gap of some rows.

        Args:
            before: residuals of the given model, all rows.
            after: residuals of the amended model, all rows.
            rows: which rows, a mask (n,).
            sigma: noise of the six components, in m and rad.
        """
        return cls(int(rows.sum()), _rms(before.of(rows)), _rms(after.of(rows)), np.asarray(sigma, dtype=float))

    def position(self, which: str) -> float:
        """Return ``before``, ``after`` or ``floor`` over x, y and z, in m."""
        return _over(getattr(self, which)[:3])

    def rotation(self, which: str) -> float:
        """Return ``before``, ``after`` or ``floor`` over the rotation components, in rad; NaN for positions only."""
        values = getattr(self, which)[3:]
        return _over(values if np.isfinite(self.before[3:]).any() else np.full(3, np.nan))

    @property
    def closed(self) -> float:
        """Return how much of the position's gap is gone: (before - after) / (before - floor); NaN without a gap."""
        gap = self.position("before") - self.position("floor")
        return (self.position("before") - self.position("after")) / gap if gap > 0.0 else float("nan")

    def metrics(self) -> dict[str, float | int | dict[str, dict[str, float]] | None]:
        """Return the gap's metrics, in mm and mrad, and each component's."""
        found: dict[str, float | int | dict[str, dict[str, float]] | None] = {"rows": self.rows}
        for which in ("before", "after", "floor"):
            found[f"{which}_rms_mm"] = _number(self.position(which) / MM)
        for which in ("before", "after", "floor"):
            found[f"{which}_rms_mrad"] = _number(self.rotation(which) / MRAD)
        found["components"] = {
            name: {
                which: float(getattr(self, which)[k] / (MM if k < 3 else MRAD))
                for which in ("before", "after", "floor")
            }
            for k, name in enumerate(COMPONENTS)
            if np.isfinite(self.before[k])
        }
        return found


def _rms(linear: LinearRows) -> FloatArray:
    found = np.full(6, np.nan)
    for k in range(6):
        values = (linear.residual * linear.tracker)[linear.component == k]
        if values.size:
            found[k] = np.sqrt((values**2).mean())
    return found


def _over(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(np.sqrt((known**2).mean())) if known.size else float("nan")


def _number(value: float) -> float | None:
    return value if np.isfinite(value) else None
