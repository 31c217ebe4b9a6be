"""Parameters of the named effects: values, standard deviations, and what becomes of them in a model file."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pouring_robot.effects.base import Effect, EffectParameter, Form
from pouring_robot.inference.decision import Cause, Judgement
from pouring_robot.inference.hypotheses import BACKGROUND_LEVELS, Hypothesis
from pouring_robot.mechanism.arrays import FloatArray

FormsByKey = Mapping[tuple[str, str], Form]


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

    def by_name(self, forms: FormsByKey) -> list[tuple[str, FoundParameter]]:
        """Return the parameters by name; where it takes two forms with a parameter each, the form is added.

        A parameter that two forms share stands once, its values added up.
        """
        own = [form for (effect, _), form in forms.items() if effect == self.cause.effect]
        once: dict[int, FoundParameter] = {}
        for found in self.parameters:
            have = once.get(id(found.parameter), FoundParameter(found.parameter, 0.0, 0.0))
            both = FoundParameter(found.parameter, have.value + found.value, math.hypot(have.std, found.std))
            once[id(found.parameter)] = both
        names = [found.parameter.name for found in once.values()]
        out = []
        for found in once.values():
            name = found.parameter.name
            if names.count(name) > 1:
                form = next((f.name for f in own if any(p is found.parameter for p in f.parameters)), "")
                name = f"{name} ({form})"
            out.append((name, found))
        return out


def found_parameters(
    hypothesis: Hypothesis, backgrounds: Mapping[str, Form], forms: FormsByKey
) -> list[tuple[str, tuple[FoundParameter, ...]]]:
    """Return every group of a hypothesis that has parameters: backgrounds by effect, then items as effect/form.

    Args:
        hypothesis: what was found.
        backgrounds: form of each background, in the order of the hypothesis's levels.
        forms: by key of the hypothesis's items.
    """
    mean, covariance = hypothesis.coefficients()
    deviation = np.sqrt(np.diag(covariance))
    found: list[tuple[str, tuple[FoundParameter, ...]]] = []
    place = 0

    def take(name: str, form: Form, scale: float) -> None:
        nonlocal place
        part = slice(place, place + len(form.parameters))
        found.append((name, _scaled(form, scale, mean[part], deviation[part])))
        place += len(form.parameters)

    for level, (effect, form) in zip(hypothesis.levels, backgrounds.items(), strict=True):
        if BACKGROUND_LEVELS[level]:
            take(effect, form, BACKGROUND_LEVELS[level])
    for item, scale in zip(hypothesis.items, hypothesis.scales, strict=True):
        if item.key in forms:
            take("/".join(item.key), forms[item.key], scale)
        else:
            place += item.columns.shape[1]
    return found


def _scaled(form: Form, scale: float, mean: FloatArray, deviation: FloatArray) -> tuple[FoundParameter, ...]:
    rows = zip(form.parameters, mean.tolist(), deviation.tolist(), strict=True)
    return tuple(FoundParameter(p, scale * p.prior_std * value, scale * p.prior_std * std) for p, value, std in rows)


def named_effects(
    hypothesis: Hypothesis,
    judgement: Judgement,
    effects: Mapping[str, Effect],
    found: Sequence[tuple[str, tuple[FoundParameter, ...]]],
) -> tuple[NamedEffect, ...]:
    """Return the causes of a judgement with their parameters, which :func:`found_parameters` gave."""
    known = dict(found)
    named = []
    for cause in judgement.causes:
        keys = ["/".join(hypothesis.items[k].key) for k in cause.indices] or [cause.effect]
        parameters = tuple(found for key in keys for found in known[key])
        named.append(NamedEffect(cause, effects[cause.effect].story, parameters))
    return tuple(named)
