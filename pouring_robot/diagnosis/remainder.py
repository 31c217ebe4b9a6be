"""What the best known effects leave unexplained, row by row: a description, not a cause."""

import math
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from pouring_robot.diagnosis.discrepancy_processes import CYCLES, TARGET
from pouring_robot.diagnosis.findings import Findings
from pouring_robot.diagnosis.gap import table_of
from pouring_robot.estimation.kinds import component_name, component_shown_in
from pouring_robot.inference.gaussian_processes.discrepancy import Summand
from pouring_robot.mechanism.arrays import FloatArray, rms

_IN_TIME = ("time", "order", "session")
_STEP_SHARE, _FEWEST_BESIDE = 0.8, 4


@dataclass(frozen=True, eq=False)
class Remainder:
    """Structure that the best known effects leave, in the rows that were fitted: a description, not a cause."""

    structure: Summand  # as the search found it
    size: float  # root mean square of what would be left without it, in noise standard deviations
    missed: FloatArray  # the same for each row, (n, K) in the tracker's axes, in m and rad; NaN elsewhere
    worst: int  # the component in which it is largest
    # the line of the file after which it jumps, in order of time; None where it is no step
    step_after: int | None
    step: float  # size of that jump, in m or rad

    @classmethod
    def of(cls, diagnosis: Findings, structure: Summand) -> Self:
        """Return the remainder of a structure, row by row."""
        rows, fitted = len(diagnosis.rows), diagnosis.after.fitted_rows
        missed, parts = (table_of(fitted, values, rows) for values in (structure.missed, structure.part))
        in_noise = missed / diagnosis.rows.measured.sigma[: missed.shape[1]]
        worst = int(np.nanargmax([rms(column) for column in in_noise.T]))
        # The whole part, as the others would distort a step by absorbing some of it.
        step = _step(diagnosis, parts[:, worst]) if structure.process.by in _IN_TIME else (None, math.nan)
        return cls(structure, rms(structure.missed), missed, worst, *step)

    @property
    def component(self) -> str:
        """Name of the component in which it is largest."""
        return component_name(self.worst)

    @property
    def by(self) -> str:
        """What it depends on, in words."""
        process = self.structure.process
        return f"{process.by} of {self.structure.length}" if process.by == CYCLES else process.by

    @property
    def slipped(self) -> bool:
        """Whether it is the target that moved."""
        return self.structure.process.where == TARGET

    @property
    def sentence(self) -> str:
        """The remainder in words."""
        unit, scale = component_shown_in(self.worst)
        words, axis = replace(self.structure.process, by=self.by).words, "the tracker's " if self.worst < 6 else ""
        text = (
            f"{words}: {self.size:.1f} times the noise, mostly in {axis}"
            f"{self.component} ({rms(self.missed[:, self.worst]) / scale:.3f} {unit} rms)"
        )
        if self.step_after is not None:
            text += f"; it is a step of {self.step / scale:+z.2f} {unit} after line {self.step_after}"
        return text

    def figures(self) -> dict[str, Any]:
        """Return it as ``diagnosis.json`` holds it."""
        unit, scale = component_shown_in(self.worst)
        out: dict[str, Any] = {
            "where": self.structure.process.where,
            "by": self.structure.process.by,
            "log_evidence_nats": self.structure.evidence,
            "size_in_noise": self.size,
            "component": self.component,
            f"rms_{unit}": rms(self.missed[:, self.worst]) / scale,
            "sentence": self.sentence,
        }
        if self.step_after is not None:
            out["step"] = {"after_line": self.step_after, f"size_{unit}": self.step / scale}
        return out


def _step(diagnosis: Findings, values: FloatArray) -> tuple[int | None, float]:
    """Return the line after which values in order of time jump, and by how much; None where they do not."""
    order = np.concatenate(diagnosis.rows.conditions.runs)
    order = order[np.isfinite(values[order])]
    series = values[order] - values[order].mean()
    n = series.size
    if n < 2 * _FEWEST_BESIDE or not series.any():
        return None, math.nan
    before = np.arange(_FEWEST_BESIDE, n - _FEWEST_BESIDE + 1)
    sums = np.cumsum(series)[before - 1]
    explained = sums**2 / before + sums**2 / (n - before)
    best = int(np.argmax(explained))
    if explained[best] < _STEP_SHARE * float(series @ series):
        return None, math.nan
    k = int(before[best])
    line = int(diagnosis.rows.campaign.lines[order[k - 1]])
    return line, float(series[k:].mean() - series[:k].mean())
