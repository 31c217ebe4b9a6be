"""A diagnosis with everything that is told of it, worked out once for text, figures, report and scene."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pouring_robot.diagnosis.amend import amended
from pouring_robot.diagnosis.diagnose import Diagnosis
from pouring_robot.diagnosis.gap import Gap
from pouring_robot.diagnosis.parameters import FoundParameter, NamedEffect
from pouring_robot.diagnosis.report.left_over import LeftOver, left_over
from pouring_robot.diagnosis.report.signatures import moved_at_lip
from pouring_robot.diagnosis.rows import CampaignRows
from pouring_robot.diagnosis.suggest.suggest import Suggestion, suggest_measurements
from pouring_robot.diagnosis.where.terms import FreeResiduals
from pouring_robot.diagnosis.where.where import Where, disagreements
from pouring_robot.effects.drives import CHANNELS
from pouring_robot.exceptions import CalibrationError, PouringRobotError
from pouring_robot.inference.decision import DEFAULT_THRESHOLDS, Cause
from pouring_robot.inference.remainder import Challenge
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.robot.model import RobotModel

_WORSE = 1.02


@dataclass(frozen=True, eq=False)
class Summary:
    """A diagnosis with everything that is told of it.

    Attributes:
        diagnosis: what was found.
        model: the amended model; the given one where ``refused`` says why.
        refused: why the model was left as it was given; "" where it was amended or nothing was found.
        where: where the given model and the data disagree.
        firm: effects that nothing explains better.
        nearest: effects that are only the nearest to something unknown.
        moved: by how much each effect moves the pouring lip, (n, 3) in m, by effect.
        left: structure that is left.
        suggestion: what to measure next.
        unsuggested: why there is no suggestion; "" where there is.
    """

    diagnosis: Diagnosis
    model: RobotModel
    refused: str
    where: Where
    firm: tuple[NamedEffect, ...]
    nearest: tuple[NamedEffect, ...]
    moved: dict[str, FloatArray]
    left: tuple[LeftOver, ...]
    suggestion: Suggestion
    unsuggested: str

    @classmethod
    def of(cls, diagnosis: Diagnosis) -> Summary:
        """Work out what is told of a diagnosis."""
        suggestion, unsuggested = _suggested(diagnosis)
        model, refused = _amended(diagnosis)
        firm, nearest = _by_firmness(diagnosis)
        moved = {
            e.cause.effect: moved_at_lip(diagnosis, [p.parameter for p in e.parameters]) for e in diagnosis.effects
        }
        data = free_residuals(diagnosis)
        where = disagreements(data, diagnosis.rows.conditions)
        left = tuple(left_over(diagnosis))
        return cls(diagnosis, model, refused, where, firm, nearest, moved, left, suggestion, unsuggested)

    @property
    def gaps(self) -> dict[str, Gap]:
        """The gap by kind of rows; of a model that was not amended nothing changes."""
        found = {"held_out": self.diagnosis.held_out, "train": self.diagnosis.train}
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
        return gap is not None and gap.position("after") > _WORSE * gap.position("before")


def _amended(diagnosis: Diagnosis) -> tuple[RobotModel, str]:
    """Return the amended model and ""; or the given one and why it stays.

    The held-out rows play no part in this choice.
    """
    train = diagnosis.train
    if train.position("after") > _WORSE * train.position("before"):
        return diagnosis.model, "what was found does not bring the fitted rows closer, so the model stays as given"
    try:
        return amended(diagnosis), ""
    except CalibrationError as problem:
        return diagnosis.model, f"what was found is no credible robot ({problem.problem}), so the model stays as given"


def _suggested(diagnosis: Diagnosis) -> tuple[Suggestion, str]:
    """Return what to measure next and ""; or no measurement and why: the diagnosis stands without."""
    try:
        return suggest_measurements(diagnosis), ""
    except PouringRobotError as problem:
        return Suggestion((), (), 0.0), f"no measurements could be suggested: {problem}"


def _by_firmness(diagnosis: Diagnosis) -> tuple[tuple[NamedEffect, ...], tuple[NamedEffect, ...]]:
    """Return the effects that stand, and those in whose place a description without a cause explains better."""
    challenges = {c.effect: found for c, found in zip(*judged(diagnosis), strict=True)}
    limit = DEFAULT_THRESHOLDS.challenge_margin
    beaten = {effect for effect, found in challenges.items() if found.margin > limit}
    firm = tuple(e for e in diagnosis.effects if e.cause.effect not in beaten)
    return firm, tuple(e for e in diagnosis.effects if e.cause.effect in beaten)


def judged(diagnosis: Diagnosis) -> tuple[list[Cause], list[Challenge]]:
    """Return the causes that descriptions were tried against, and the best description for each."""
    causes = [cause for cause in diagnosis.judgement.causes if cause.indices]
    return causes, list(diagnosis.judgement.challenges[: len(causes)])


def free_residuals(diagnosis: Diagnosis) -> FreeResiduals:
    """Return the residuals of the given model, only its frames fitted, of all sound rows."""
    linear = diagnosis.before.every_row
    size = np.linalg.norm(linear.free, axis=0)
    axes, values, _ = np.linalg.svd(linear.free[:, size > 0.0] / size[size > 0.0], full_matrices=False)
    rows: CampaignRows = diagnosis.rows
    return FreeResiduals(
        residual=linear.residual,
        row=linear.row,
        component=linear.component,
        sigma=linear.tracker,
        absorbed=axes[:, values > 1e-10 * values.max(initial=0.0)],
        axes=diagnosis.before.frames.T_tracker_base.rotation,
        drives=np.column_stack([rows.channel(name, linear) for name in CHANNELS]),
        noise_known=not diagnosis.noise.from_residuals,
    )


def named_parameters(diagnosis: Diagnosis, effect: NamedEffect) -> list[tuple[str, FoundParameter]]:
    """Return the parameters of an effect by name; where it takes two forms with a parameter each, the form is added.

    A parameter that two forms share stands once, its values added up.
    """
    forms = [form for (name, _), form in diagnosis.diagnoser.library.forms.items() if name == effect.cause.effect]
    once: dict[int, FoundParameter] = {}
    for found in effect.parameters:
        have = once.get(id(found.parameter))
        value, std = (have.value, have.std) if have else (0.0, 0.0)
        both = FoundParameter(found.parameter, value + found.value, math.hypot(std, found.std))
        once[id(found.parameter)] = both
    names = [found.parameter.name for found in once.values()]
    out = []
    for found in once.values():
        name = found.parameter.name
        if names.count(name) > 1:
            own = next((form.name for form in forms if any(p is found.parameter for p in form.parameters)), "")
            name = f"{name} ({own})"
        out.append((name, found))
    return out
