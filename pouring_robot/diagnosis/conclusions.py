"""What follows from the findings: where the gap is, what is left, the amended model, the next measurements."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
import pinocchio as pin

from pouring_robot.diagnosis.amend import amended as amended_model
from pouring_robot.diagnosis.findings import Findings
from pouring_robot.diagnosis.gap import Gap, component_unit, table_of
from pouring_robot.diagnosis.state import FoundParameter
from pouring_robot.diagnosis.suggest.suggest import Suggestion, suggest_measurements
from pouring_robot.diagnosis.where.where import Where, disagreements
from pouring_robot.estimation.frames.outer import OuterFrames
from pouring_robot.estimation.kinds import component_name
from pouring_robot.estimation.splits import WORSE
from pouring_robot.exceptions import CalibrationError, PouringRobotError
from pouring_robot.inference.discrepancy import Summand
from pouring_robot.mechanism.arrays import FloatArray, rms
from pouring_robot.robot.model import RobotModel

_IN_TIME = ("time", "order", "session")
_STEP_SHARE, _FEWEST_BESIDE = 0.8, 4


@dataclass(frozen=True, eq=False)
class Remainder:
    """Structure that the best known effects leave, in the rows that were fitted: a description, not a cause."""

    structure: Summand  # as the search found it
    size: float  # root mean square of what would be left without it, in noise standard deviations
    missed: FloatArray  # that of each row, (n, K) in the tracker's axes, in m and rad; NaN elsewhere
    worst: int  # the component in which it is largest
    # the line of the file after which it jumps, in order of time; None where it is no step
    step_after: int | None
    step: float  # by how much it jumps there, in m or rad

    @classmethod
    def of(cls, diagnosis: Findings, structure: Summand) -> Self:
        """Look at a structure row by row."""
        rows, fitted = len(diagnosis.rows), diagnosis.after.fitted_rows
        missed, parts = (table_of(fitted, values, rows) for values in (structure.missed, structure.part))
        in_noise = missed / diagnosis.rows.measured.sigma[: missed.shape[1]]
        worst = int(np.nanargmax([rms(column) for column in in_noise.T]))
        # What the others would take up of a step is no step any more.
        step = _step(diagnosis, parts[:, worst]) if structure.process.by in _IN_TIME else (None, math.nan)
        return cls(structure, rms(structure.missed), missed, worst, *step)

    @property
    def component(self) -> str:
        """That component by name."""
        return component_name(self.worst)

    @property
    def sentence(self) -> str:
        """It in words."""
        unit, scale = component_unit(self.worst)
        words, axis = self.structure.process.words, "the tracker's " if self.worst < 6 else ""
        text = (
            f"{words}: {self.size:.1f} times the noise, mostly in {axis}"
            f"{self.component} ({rms(self.missed[:, self.worst]) / scale:.3f} {unit} rms)"
        )
        if self.step_after is not None:
            text += f"; it is a step of {self.step / scale:+.2f} {unit} after line {self.step_after}"
        return text

    def figures(self) -> dict[str, Any]:
        """Return it as ``diagnosis.json`` holds it."""
        unit, scale = component_unit(self.worst)
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


class Conclusions(Findings):
    """Findings and what follows from them, each worked out once, when it is asked for."""

    @cached_property
    def where(self) -> Where:
        """Where the given model and the data disagree."""
        rate = self.diagnoser.thresholds.false_names
        return disagreements(self.free_residuals, self.rows.conditions, rate)

    @cached_property
    def moved(self) -> dict[str, FloatArray]:
        """By how much each effect moves the tool, (n, 3) in m, in the axes of the base, by effect.

        Loops are closed exactly with everything found and again without its parameters: to show, not to judge by. A
        constant part counts here, though the frames absorb it in the campaign.
        """
        rows, after = self.rows, self.after
        frames = OuterFrames(pin.SE3.Identity(), self.model.definition.mechanism().T_end_tool)

        def tool(without: Sequence[FoundParameter]) -> FloatArray:
            out = {found.parameter for found in without}
            kept = np.array([p not in out for p in after.parameters])
            return rows.predicted(rows.changes(after.parameters, kept * after.values), frames).position_m

        everything = tool(())
        return {e.cause.effect: everything - tool(e.parameters) for e in self.effects}

    def farthest_m(self, effect: str) -> float:
        """Return how far an effect moves the tool in these rows at most, in m; NaN where no row says it."""
        return float(np.fmax.reduce(np.linalg.norm(self.moved[effect], axis=1)))

    @cached_property
    def remainder(self) -> tuple[Remainder, ...]:
        """The structure that is left, largest first; nothing where none counts."""
        found = (Remainder.of(self, structure) for structure in self.judgement.remainder)
        return tuple(sorted(found, key=lambda one: -one.size))

    @cached_property
    def suggestion(self) -> Suggestion:
        """What to measure next; where there is nothing it says why: the diagnosis stands without."""
        try:
            return suggest_measurements(self, self.next_count)
        except PouringRobotError as problem:
            return Suggestion((), (), 0.0, failed=f"no measurements could be suggested: {problem}")

    @cached_property
    def _amended(self) -> tuple[RobotModel, str]:
        if self.train.position("after") > WORSE * self.train.position("before"):
            return self.model, "what was found does not bring the fitted rows closer, so the model stays as given"
        try:
            return amended_model(self), ""
        except CalibrationError as problem:
            return self.model, f"what was found is no credible robot ({problem.problem}), so the model stays as given"

    @property
    def amended(self) -> RobotModel:
        """The amended model; the given one where :attr:`refused` says why. Held-out rows play no part in this."""
        return self._amended[0]

    @property
    def refused(self) -> str:
        """Why the model was left as it was given; "" where it was amended or nothing was found."""
        return self._amended[1]

    @property
    def changed(self) -> bool:
        """Whether the amended model differs from the given one."""
        return bool(self.effects) and not self.refused

    @property
    def gaps(self) -> dict[str, Gap]:
        """The gap by kind of rows; of a model that was not amended nothing changes."""
        found = {"held_out": self.held_out, "train": self.train}
        kept = {name: gap for name, gap in found.items() if gap is not None}
        return {name: replace(gap, after=gap.before) for name, gap in kept.items()} if self.refused else kept

    @property
    def shown_gap(self) -> tuple[str, Gap]:
        """The gap that counts, with the name of its rows: held-out rows where there are any."""
        gaps = self.gaps
        return ("held-out rows", gaps["held_out"]) if "held_out" in gaps else ("fitted rows", gaps["train"])

    @property
    def worse(self) -> bool:
        """Whether the amended model is further from the held-out rows than the given one."""
        return self.overfitted and not self.refused
