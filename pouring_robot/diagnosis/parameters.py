"""Parameters of the named effects: values, standard deviations, and what becomes of them in a model file."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pouring_robot.effects.base import Effect, EffectParameter, Form
from pouring_robot.inference.decision import Cause, Judgement
from pouring_robot.inference.explanations import WORKMANSHIP_FORM
from pouring_robot.inference.hypotheses import Hypothesis

FormsByKey = Mapping[tuple[str, str], Form]


@dataclass(frozen=True, eq=False)
class FoundParameter:
    """One parameter with its value."""

    parameter: EffectParameter  # what it changes
    value: float  # in its unit
    std: float  # standard deviation, in its unit


FoundByKey = list[tuple[tuple[str, str], tuple[FoundParameter, ...]]]
"""Parameters by effect and form."""


@dataclass(frozen=True, eq=False, repr=False)
class NamedEffect:
    """A named effect with its parameters."""

    cause: Cause  # what may be said of it
    story: str  # one line for people
    parameters: tuple[FoundParameter, ...]  # main ones first

    def __repr__(self) -> str:
        """Return its id, its form and how sure it is: its parameters hold a number for each row."""
        return f"<NamedEffect: {self.cause.effect}, {self.cause.form}, {self.cause.probability:.0%} sure>"


def found_parameters(hypothesis: Hypothesis, forms: FormsByKey) -> FoundByKey:
    """Return every group of a hypothesis that has parameters of the robot: workmanship, then items."""
    mean, covariance = hypothesis.coefficients()
    std, found = np.sqrt(np.diag(covariance)), []
    for group, weights, own in zip(hypothesis.fitted, hypothesis.weights(), hypothesis.spans, strict=True):
        if group.key in forms:
            parameters = forms[group.key].parameters
            units = weights * np.array([p.prior_std for p in parameters])
            values = zip(parameters, (units * mean[own]).tolist(), (units * std[own]).tolist(), strict=True)
            found.append((group.key, tuple(FoundParameter(*each) for each in values)))
    return found


def named_effects(
    hypothesis: Hypothesis, judgement: Judgement, effects: Mapping[str, Effect], found: FoundByKey
) -> tuple[NamedEffect, ...]:
    """Return the causes of a judgement with their parameters, which :func:`found_parameters` gave."""
    known = dict(found)
    named = []
    for cause in judgement.causes:
        keys = [hypothesis.items[k].key for k in cause.indices] or [(cause.effect, WORKMANSHIP_FORM)]
        parameters = tuple(found for key in keys for found in known[key])
        named.append(NamedEffect(cause, effects[cause.effect].story, parameters))
    return tuple(named)
