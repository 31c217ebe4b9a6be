"""Effects: physical causes that move the ladle, each a change of the mechanism's local parameters."""

from pouring_robot.effects.base import Effect, EffectParameter, Form, LocalChanges
from pouring_robot.effects.conditions import Conditions, NominalRows, conditions_of
from pouring_robot.effects.registry import LIBRARY, all_effects, chosen_effects

__all__ = [
    "LIBRARY",
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
