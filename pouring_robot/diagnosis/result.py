"""A diagnosis: what was found, and what follows from it for the model, for the next measurements and for people."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pouring_robot.campaign.data import Campaign
from pouring_robot.checks.flags import DataFlag
from pouring_robot.diagnosis.gap import Gap
from pouring_robot.diagnosis.parameters import FoundParameter, NamedEffect
from pouring_robot.diagnosis.rows import CampaignRows
from pouring_robot.diagnosis.state import Diagnoser, State
from pouring_robot.effects.drives import CHANNELS
from pouring_robot.estimation.noise import NoiseLevel
from pouring_robot.estimation.splits import WORSE
from pouring_robot.exceptions import CalibrationError, PouringRobotError
from pouring_robot.inference.decision import Judgement, Verdict
from pouring_robot.inference.hypotheses import Hypothesis
from pouring_robot.inference.nuisance import Nuisance
from pouring_robot.io.threads import one_blas_thread
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.report.result import Result
from pouring_robot.robot.model import RobotModel

if TYPE_CHECKING:
    import pandas as pd

    from pouring_robot.diagnosis.discrepancy import Discrepancy
    from pouring_robot.diagnosis.suggest.suggest import Suggestion
    from pouring_robot.diagnosis.where.terms import FreeResiduals
    from pouring_robot.diagnosis.where.where import Where


@dataclass(frozen=True, eq=False, repr=False)
class Diagnosis(Result):
    """What was found.

    Attributes:
        campaign: all rows of the file.
        model: the given model.
        rows: the inliers against it.
        inliers: index in the campaign of each of them, (n,).
        outliers: rows left out as gross errors, by index in the campaign.
        flags: what the checks found in the data.
        noise: of the measurements.
        fitted: which inliers were fitted, (n,); the others are held out.
        held_out_name: which block is held out, in words; empty where there are too few rows to hold any out.
        diagnoser: the search.
        before: the given model, only its frames fitted.
        after: the amended model.
        hypothesis: what explains best.
        judgement: what may be said of it.
        effects: the named effects with their parameters.
        untestable: effects that the campaign cannot test, with the conditions it lacks.
        train: gap of the fitted rows.
        held_out: gap of the held-out rows; None where there are none.
        notes: what limits the answer, one line each.
    """

    campaign: Campaign
    model: RobotModel
    rows: CampaignRows
    inliers: NDArray[np.intp]
    outliers: NDArray[np.intp]
    flags: tuple[DataFlag, ...]
    noise: NoiseLevel
    fitted: NDArray[np.bool_]
    held_out_name: str
    diagnoser: Diagnoser
    before: State
    after: State
    hypothesis: Hypothesis
    judgement: Judgement
    effects: tuple[NamedEffect, ...]
    untestable: dict[str, tuple[str, ...]]
    train: Gap
    held_out: Gap | None
    notes: tuple[str, ...]

    @property
    def verdict(self) -> Verdict:
        """``no_gap``, ``named``, ``group`` or ``unknown``."""
        return self.judgement.verdict

    @property
    def headline(self) -> str:
        """The verdict in one sentence."""
        from pouring_robot.diagnosis.report.sentences import headline

        return headline(self)

    @property
    def firm(self) -> tuple[NamedEffect, ...]:
        """Effects that nothing explains better."""
        return tuple(e for e in self.effects if e.cause.effect not in self.judgement.beaten)

    @property
    def nearest(self) -> tuple[NamedEffect, ...]:
        """Effects that are only the nearest to something unknown: a description without a cause explains better."""
        return tuple(e for e in self.effects if e.cause.effect in self.judgement.beaten)

    @property
    def free_residuals(self) -> FreeResiduals:
        """The residuals of the given model, only its frames fitted, of all inliers."""
        from pouring_robot.diagnosis.where.terms import FreeResiduals

        linear = self.before.every_row
        return FreeResiduals(
            linear.residual,
            linear.row,
            linear.component,
            linear.tracker,
            Nuisance.of(linear.free),
            self.before.frames.T_tracker_base.rotation,
            np.column_stack([self.rows.channel(name, linear) for name in CHANNELS]),
            noise_known=not self.noise.from_residuals,
            noise_freedoms=self.noise.freedoms,
        )

    @cached_property
    def where(self) -> Where:
        """Where the given model and the data disagree."""
        from pouring_robot.diagnosis.where.where import disagreements

        return disagreements(self.free_residuals, self.rows.conditions)

    @cached_property
    def moved(self) -> dict[str, FloatArray]:
        """By how much each effect moves the pouring lip, (n, 3) in m, by effect."""
        from pouring_robot.diagnosis.lip import moved_at_lip

        return {e.cause.effect: moved_at_lip(self, [p.parameter for p in e.parameters]) for e in self.effects}

    @cached_property
    def discrepancies(self) -> tuple[Discrepancy, ...]:
        """The clearest structure that is left."""
        from pouring_robot.diagnosis.discrepancy import discrepancies

        return tuple(discrepancies(self))

    @cached_property
    def _suggested(self) -> tuple[Suggestion, str]:
        from pouring_robot.diagnosis.suggest.suggest import Suggestion, suggest_measurements

        try:
            return suggest_measurements(self), ""
        except PouringRobotError as problem:
            return Suggestion((), (), 0.0), f"no measurements could be suggested: {problem}"

    @property
    def suggestion(self) -> Suggestion:
        """What to measure next; nothing where :attr:`unsuggested` says why: the diagnosis stands without."""
        return self._suggested[0]

    @property
    def unsuggested(self) -> str:
        """Why there is no suggestion; "" where there is."""
        return self._suggested[1]

    @cached_property
    def _amended(self) -> tuple[RobotModel, str]:
        from pouring_robot.diagnosis.amend import amended

        if self.train.position("after") > WORSE * self.train.position("before"):
            return self.model, "what was found does not bring the fitted rows closer, so the model stays as given"
        try:
            return amended(self), ""
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
    def gaps(self) -> dict[str, Gap]:
        """The gap by kind of rows; of a model that was not amended nothing changes."""
        found = {"held_out": self.held_out, "train": self.train}
        kept = {name: gap for name, gap in found.items() if gap is not None}
        if not self.refused:
            return kept
        return {name: Gap(gap.rows, gap.before, gap.before, gap.floor) for name, gap in kept.items()}

    @property
    def shown_gap(self) -> tuple[str, Gap]:
        """The gap that counts, with the name of its rows: held-out rows where there are any."""
        gaps = self.gaps
        return ("held-out rows", gaps["held_out"]) if "held_out" in gaps else ("fitted rows", gaps["train"])

    @property
    def worse(self) -> bool:
        """Whether the amended model is further from the held-out rows than the given one."""
        gap = self.gaps.get("held_out")
        return gap is not None and gap.position("after") > WORSE * gap.position("before")

    def parameters_of(self, effect: NamedEffect) -> Sequence[tuple[str, FoundParameter]]:
        """Return the parameters of an effect by name; see :meth:`NamedEffect.by_name`."""
        return effect.by_name(self.diagnoser.library.forms)

    def to_frame(self) -> pd.DataFrame:
        """Return a row for each parameter of each effect, with its value and standard deviation in its unit."""
        import pandas as pd

        columns = ["effect", "firm", "probability", "parameter", "value", "std", "unit"]
        rows = [
            (e.cause.effect, e in self.firm, e.cause.probability, name, p.value, p.std, p.parameter.unit)
            for e in self.effects
            for name, p in self.parameters_of(e)
        ]
        return pd.DataFrame(rows, columns=columns)

    @one_blas_thread()
    def save(self, folder: Path | str) -> list[Path]:
        """Write ``diagnosis.json``, ``model.yaml``, ``report.html`` and ``ladles.html``; return the files.

        Raises:
            OutputError: the folder cannot be written to.
        """
        from pouring_robot.diagnosis.report.export import write_diagnosis

        return write_diagnosis(self, folder)
