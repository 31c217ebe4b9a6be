"""The effect stack of a model file: effects found by diagnosis, with their parameters and standard deviations."""

from __future__ import annotations

import pydantic

from pouring_robot.io.typed_yaml import StrictModel


class ParameterEntry(StrictModel):
    """One parameter of an effect.

    Attributes:
        value: in ``unit``.
        std: standard deviation, in ``unit``.
        unit: the effect's own.
    """

    value: float
    std: float = pydantic.Field(default=0.0, ge=0.0)
    unit: str


class EffectEntry(StrictModel):
    """One effect in one of its forms.

    Attributes:
        effect: its id.
        form: which form.
        placed: whether it is already in ``joint_placements`` and ``drive_offsets``: what does not depend on conditions
            is put there. The entry then only says where they come from.
        parameters: by name; those left out are zero.
    """

    effect: str
    form: str
    placed: bool = False
    parameters: dict[str, ParameterEntry] = pydantic.Field(default_factory=dict)
