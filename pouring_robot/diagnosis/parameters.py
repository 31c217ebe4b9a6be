"""Parameters of the named effects: values, standard deviations, and what becomes of them in a model file."""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pouring_robot.effects.base import Effect, EffectParameter, Form
from pouring_robot.inference.decision import Cause, Judgement
from pouring_robot.inference.hypotheses import Hypothesis
from pouring_robot.mechanism.arrays import FloatArray

FormsByKey = Mapping[tuple[str, str], Form]


@dataclass(frozen=True, eq=False)
class FoundParameter:
    """One parameter with its value."""

    parameter: EffectParameter  # what it changes
    value: float  # in its unit
    std: float  # standard deviation, in its unit


@dataclass(frozen=True, eq=False)
class NamedEffect:
    """A named effect with its parameters."""

    cause: Cause  # what may be said of it
    story: str  # one line for people
    parameters: tuple[FoundParameter, ...]  # main ones first

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
    hypothesis: Hypothesis, workmanship: Mapping[str, Form], forms: FormsByKey
) -> list[tuple[str, tuple[FoundParameter, ...]]]:
    """Return every group of a hypothesis that has parameters: workmanship by effect, then items as effect/form.

    Workmanship has a form for each kind, in the order of the hypothesis's levels; other forms go by key of the items.
    """
    mean, covariance = hypothesis.coefficients()
    fitted = zip(mean.tolist(), np.sqrt(np.diag(covariance)).tolist(), strict=True)

    def of(form: Form, weights: FloatArray) -> tuple[FoundParameter, ...]:
        values = itertools.islice(fitted, len(form.parameters))
        units = [weight * p.prior_std for weight, p in zip(weights.tolist(), form.parameters, strict=True)]
        each = zip(form.parameters, units, values, strict=True)
        return tuple(FoundParameter(p, unit * value, unit * std) for p, unit, (value, std) in each)

    weights = iter(hypothesis.weights())
    levels = zip(workmanship.items(), hypothesis.levels, strict=True)
    found = [(effect, of(form, next(weights))) for (effect, form), level in levels if level]
    for item, own in zip(hypothesis.items, weights, strict=True):
        if item.key in forms:
            found.append(("/".join(item.key), of(forms[item.key], own)))
        else:  # it has coefficients, but no parameters of the robot
            list(itertools.islice(fitted, len(own)))
    return found


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
