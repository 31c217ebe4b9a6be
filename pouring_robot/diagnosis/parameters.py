"""Parameters of the named effects: values, standard deviations, and what becomes of them in a model file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pouring_robot.diagnosis.hypotheses import BACKGROUND_LEVELS, Hypothesis
from pouring_robot.diagnosis.verdict import Cause, Judgement
from pouring_robot.effects.base import Effect, EffectParameter, Form
from pouring_robot.mechanism import FloatArray

if TYPE_CHECKING:
    from pouring_robot.diagnosis.state import Diagnoser


@dataclass(frozen=True, eq=False)
class FoundParameter:
    """One parameter with its value.

    Attributes:
        parameter: what it changes.
        value: in its unit.
        std: standard deviation, in its unit.
    """

    parameter: EffectParameter
    value: float
    std: float


@dataclass(frozen=True, eq=False)
class NamedEffect:
    """A named effect with its parameters.

    Attributes:
        cause: what may be said of it.
        story: one line for people.
        parameters: main ones first.
    """

    cause: Cause
    story: str
    parameters: tuple[FoundParameter, ...]


def found_parameters(diagnoser: Diagnoser, hypothesis: Hypothesis) -> list[tuple[str, tuple[FoundParameter, ...]]]:
    """Return every group of a hypothesis that has parameters: backgrounds by effect, then items as effect/form."""
    mean, covariance = hypothesis.coefficients()
    deviation = np.sqrt(np.diag(covariance))
    found: list[tuple[str, tuple[FoundParameter, ...]]] = []
    place = 0

    def take(name: str, form: Form, scale: float) -> None:
        nonlocal place
        part = slice(place, place + len(form.parameters))
        found.append((name, _scaled(form, scale, mean[part], deviation[part])))
        place += len(form.parameters)

    for level, (effect, form) in zip(hypothesis.levels, diagnoser.backgrounds.items(), strict=True):
        if BACKGROUND_LEVELS[level]:
            take(effect, form, BACKGROUND_LEVELS[level])
    for item, scale in zip(hypothesis.items, hypothesis.scales, strict=True):
        if item.key in diagnoser.forms:
            take("/".join(item.key), diagnoser.forms[item.key], scale)
        else:
            place += item.columns.shape[1]
    return found


def _scaled(form: Form, scale: float, mean: FloatArray, deviation: FloatArray) -> tuple[FoundParameter, ...]:
    rows = zip(form.parameters, mean.tolist(), deviation.tolist(), strict=True)
    return tuple(FoundParameter(p, scale * p.usual * value, scale * p.usual * std) for p, value, std in rows)


def named_effects(
    diagnoser: Diagnoser, hypothesis: Hypothesis, judgement: Judgement, effects: Mapping[str, Effect]
) -> tuple[NamedEffect, ...]:
    """Return the causes of a judgement with their parameters."""
    known = dict(found_parameters(diagnoser, hypothesis))
    named = []
    for cause in judgement.causes:
        keys = ["/".join(hypothesis.items[k].key) for k in cause.indices] or [cause.effect]
        parameters = tuple(found for key in keys for found in known[key])
        named.append(NamedEffect(cause, effects[cause.effect].story, parameters))
    return tuple(named)
