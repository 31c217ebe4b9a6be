"""What follows from the findings: the remainder, the amended model, the next measurements."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
import pinocchio as pin

from pouring_robot.diagnosis.amend import amended as amended_model
from pouring_robot.diagnosis.disagreement import where_of
from pouring_robot.diagnosis.findings import Findings
from pouring_robot.diagnosis.gap import Gap
from pouring_robot.diagnosis.named_effects import FoundParameter
from pouring_robot.diagnosis.remainder import Remainder
from pouring_robot.diagnosis.suggest.next_measurements import Suggestion, suggest_measurements
from pouring_robot.diagnosis.where.where import Where
from pouring_robot.estimation.frames.outer import OuterFrames
from pouring_robot.exceptions import CalibrationError, PouringRobotError
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.robot.model import RobotModel


class Conclusions(Findings):
    """Findings and what follows from them, each computed once, on request."""

    @cached_property
    def where(self) -> Where:
        """Where the given model and the data disagree."""
        return where_of(self.diagnoser)

    @cached_property
    def moved(self) -> dict[str, FloatArray]:
        """Displacement of the tool by each effect, (n, 3) in m, in the axes of the base, by effect.

        Loops are closed exactly with everything found, and again without the effect's parameters. It is for display,
        not for decisions: a constant part counts here, though the frames absorb it in the campaign.
        """
        rows, after = self.rows, self.final.state
        frames = OuterFrames(pin.SE3.Identity(), self.model.definition.mechanism().T_end_tool)

        def tool(without: Sequence[FoundParameter]) -> FloatArray:
            out = {found.parameter for found in without}
            kept = np.array([p not in out for p in after.parameters])
            return rows.predicted(rows.changes(after.parameters, kept * after.values), frames).position_m

        everything = tool(())
        return {e.cause.effect: everything - tool(e.parameters) for e in self.effects}

    def farthest_m(self, effect: str) -> float:
        """Return how far an effect moves the tool in these rows at most, in m; NaN where no row has a pose."""
        return float(np.fmax.reduce(np.linalg.norm(self.moved[effect], axis=1)))

    @cached_property
    def remainder(self) -> tuple[Remainder, ...]:
        """The structure left in the residual, largest first; none where none counts."""
        found = (Remainder.of(self, structure) for structure in self.judgement.remainder)
        return tuple(sorted(found, key=lambda one: -one.size))

    @cached_property
    def suggestion(self) -> Suggestion:
        """What to measure next, or why nothing is suggested: the diagnosis does not depend on it."""
        try:
            return suggest_measurements(self, self.next_count)
        except PouringRobotError as problem:
            return Suggestion((), (), 0.0, failed=f"no measurements could be suggested: {problem}")

    @cached_property
    def _amended(self) -> tuple[RobotModel, str]:
        if self.train.worse:
            return (
                self.model,
                "what was found does not reduce the errors of the fitted rows, so the model stays as given",
            )
        try:
            return amended_model(self), ""
        except CalibrationError as problem:
            return (
                self.model,
                f"what was found makes no credible robot ({problem.problem}), so the model stays as given",
            )

    @property
    def amended(self) -> RobotModel:
        """The amended model; the given one where :attr:`refused` says why."""
        return self._amended[0]

    @property
    def refused(self) -> str:
        """Why the model was left as given; "" where it was amended or nothing was found."""
        return self._amended[1]

    @property
    def changed(self) -> bool:
        """Whether the amended model differs from the given one."""
        return bool(self.effects) and not self.refused

    @property
    def gaps(self) -> dict[str, Gap]:
        """The gap by kind of rows; unchanged where the model was not amended."""
        found = {"held_out": self.held_out, "train": self.train}
        kept = {name: gap for name, gap in found.items() if gap is not None}
        return {name: replace(gap, after=gap.before) for name, gap in kept.items()} if self.refused else kept

    @property
    def shown_gap(self) -> tuple[str, Gap]:
        """The gap that counts, with the name of its rows: held-out rows if there are any."""
        gaps = self.gaps
        return ("held-out rows", gaps["held_out"]) if "held_out" in gaps else ("fitted rows", gaps["train"])

    @property
    def worse(self) -> bool:
        """Whether the amended model is further from the held-out rows than the given one."""
        return self.overfitted and not self.refused
