"""What the search found in a campaign: data, states, judgement. What follows from it: :mod:`~.conclusions`."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pouring_robot.campaign.data import Campaign
from pouring_robot.checks.flags import DataFlag
from pouring_robot.diagnosis.gap import Gap
from pouring_robot.diagnosis.in_turn import InTurn
from pouring_robot.diagnosis.parameters import FoundParameter, NamedEffect
from pouring_robot.diagnosis.rows import CampaignRows
from pouring_robot.diagnosis.state import Diagnoser, State
from pouring_robot.diagnosis.where.residuals import FreeResiduals
from pouring_robot.estimation.instruments import NoiseLevel
from pouring_robot.inference.decision import Judgement, Verdict
from pouring_robot.inference.hypotheses import Hypothesis
from pouring_robot.robot.model import RobotModel


@dataclass(frozen=True, eq=False, repr=False)
class Findings:
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
        free_residuals: of the given model, only its frames fitted, of all inliers.
        hypothesis: what explains best.
        judgement: what may be said of it.
        misfit: why the answer is unknown whatever explains best: what is left is too large for noise, or what was found
            is no credible robot; "" where neither is.
        effects: the named effects with their parameters.
        untestable: effects that the campaign cannot test, with the conditions it lacks.
        train: gap of the fitted rows.
        held_out: gap of the held-out rows; None where there are none.
        in_turn: gap of every block held out in turn, where the rows held out are few; else None.
        notes: what limits the answer, one line each.
        next_count: how many measurements to suggest.
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
    free_residuals: FreeResiduals
    hypothesis: Hypothesis
    judgement: Judgement
    misfit: str
    effects: tuple[NamedEffect, ...]
    untestable: dict[str, tuple[str, ...]]
    train: Gap
    held_out: Gap | None
    in_turn: InTurn | None
    notes: tuple[str, ...]
    next_count: int

    @property
    def verdict(self) -> Verdict:
        """``no_gap``, ``named``, ``group`` or ``unknown``."""
        return self.judgement.verdict

    @property
    def firm(self) -> tuple[NamedEffect, ...]:
        """Effects that nothing explains better."""
        return tuple(e for e in self.effects if e.cause.effect not in self.judgement.beaten)

    @property
    def nearest(self) -> tuple[NamedEffect, ...]:
        """Effects that are only the nearest to something unknown: a description without a cause explains better."""
        return tuple(e for e in self.effects if e.cause.effect in self.judgement.beaten)

    @property
    def spare(self) -> dict[str, float]:
        """What each effect that was tried and not named would be worth beside what was found, in nats, best form."""
        shown = {
            e
            for e in self.hypothesis.rivals
            if any(i.effect == e and i.columns.any() for i in self.hypothesis.problem.explanations)
        }
        return {effect: worth.evidence for effect, (worth, _) in self.hypothesis.best_forms(shown).items()}

    def parameters_of(self, effect: NamedEffect) -> Sequence[tuple[str, FoundParameter]]:
        """Return the parameters of an effect by name; see :meth:`NamedEffect.by_name`."""
        return effect.by_name(self.diagnoser.library.forms)
