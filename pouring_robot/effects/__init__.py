"""Effects: physical causes that move the end body, each a change of the mechanism's local parameters."""

from pouring_robot.effects.base import Effect, EffectParameter, Form, LocalChanges
from pouring_robot.effects.conditions import Conditions, NominalRows, conditions_of
from pouring_robot.effects.registry import FAMILIES, all_effects, chosen_effects

__all__ = [
    "FAMILIES",
    "Conditions",
    "Effect",
    "EffectParameter",
    "Form",
    "LocalChanges",
    "NominalRows",
    "all_effects",
    "chosen_effects",
    "conditions_of",
]
