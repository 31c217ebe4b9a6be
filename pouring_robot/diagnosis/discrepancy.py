"""The discrepancy that is left: what it depends on, how large it is, a step and when. Descriptions, not causes."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from pouring_robot.diagnosis.findings import Findings
from pouring_robot.diagnosis.gap import table_of
from pouring_robot.estimation.instruments import component_name
from pouring_robot.inference.discrepancy import Summand
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.mechanism.poses import shown_in

_IN_TIME = ("time", "order", "session")
_STEP_SHARE, _FEWEST_BESIDE = 0.8, 4


@dataclass(frozen=True, eq=False)
class Discrepancy:
    """Structure that the best known effects leave."""

    structure: Summand  # as the search found it
    component: str  # in which component it is largest
    rms: float  # of its part there, in m or rad
    # the line of the file after which it jumps, in order of time; None where it is no step
    step_after: int | None = None
    step: float = math.nan  # by how much it jumps there, in m or rad

    @property
    def _in_unit(self) -> tuple[str, float]:
        return shown_in("rad" if self.component.startswith("r") else "m")

    @property
    def sentence(self) -> str:
        """It in words."""
        unit, scale = self._in_unit
        words, axis = self.structure.process.words, "the tracker's " if self.component[-1] in "xyz" else ""
        text = (
            f"{words}: {self.structure.size:.1f} times the noise, mostly in {axis}"
            f"{self.component} ({self.rms / scale:.3f} {unit} rms)"
        )
        if self.step_after is not None:
            text += f"; it is a step of {self.step / scale:+.2f} {unit} after line {self.step_after}"
        return text

    def as_json(self) -> dict[str, Any]:
        """Return it as ``diagnosis.json`` holds it."""
        unit, scale = self._in_unit
        out: dict[str, Any] = {
            "where": self.structure.process.where,
            "by": self.structure.process.by,
            "log_evidence_nats": self.structure.evidence,
            "size_in_noise": self.structure.size,
            "component": self.component,
            f"rms_{unit}": self.rms / scale,
            "sentence": self.sentence,
        }
        if self.step_after is not None:
            out["step"] = {"after_line": self.step_after, f"size_{unit}": self.step / scale}
        return out


def discrepancies(diagnosis: Findings) -> list[Discrepancy]:
    """Return the structure that is left, largest first; nothing where none counts."""
    return [_described(diagnosis, structure) for structure in diagnosis.judgement.remainder]


def parts_by_row(diagnosis: Findings, structure: Summand) -> FloatArray:
    """Return what a structure adds to the fitted rows, (n, K) in the tracker's axes, in m and rad; NaN elsewhere."""
    return table_of(diagnosis.after.fitted_rows, structure.part, len(diagnosis.rows))


def _described(diagnosis: Findings, structure: Summand) -> Discrepancy:
    table = parts_by_row(diagnosis, structure)
    sigma = np.asarray(diagnosis.rows.measured.sigma)[: table.shape[1]]
    known = np.isfinite(table)
    measured = np.asarray(known.any(axis=0))
    rms = np.sqrt((np.where(known, table, 0.0) ** 2).sum(axis=0) / np.maximum(known.sum(axis=0), 1))
    worst = int(np.argmax(np.where(measured, rms / np.where(sigma > 0.0, sigma, np.inf), 0.0)))
    step_after, step = None, math.nan
    if structure.process.by in _IN_TIME:
        step_after, step = _step(diagnosis, table[:, worst])
    return Discrepancy(structure, component_name(worst), float(rms[worst]), step_after, step)


def _step(diagnosis: Findings, values: FloatArray) -> tuple[int | None, float]:
    """Return the line after which values in order of time jump, and by how much; None where they do not."""
    order = np.argsort(diagnosis.rows.conditions.time_s, kind="stable")
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
