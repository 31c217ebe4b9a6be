"""Which effects there are: the library's own and those that installed packages offer.

A package offers effects in its ``pyproject.toml``; the name does not matter, the value is a class:

    [project.entry-points."pouring_robot.effects"]
    screw_wear = "my_package.effects:ScrewWear"
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from importlib.metadata import entry_points

from pouring_robot.effects.base import Effect
from pouring_robot.effects.conditions import Conditions
from pouring_robot.effects.drives import (
    DriveBacklash,
    DriveCyclic,
    DriveScale,
    DriveZeroOffset,
    TiltEncoderEccentricity,
)
from pouring_robot.effects.facts import FACTS
from pouring_robot.effects.heat import LegThermalExpansion, PlatformThermalExpansion
from pouring_robot.effects.joints import JointAxisTilt, JointCentreOffset
from pouring_robot.effects.loads import LegCompliance, TiltDriveCompliance, TrussDeflection
from pouring_robot.effects.surroundings import BaseDrift, MetrologyScale
from pouring_robot.exceptions import BadInputError, closest

GROUP = "pouring_robot.effects"
CONDITION_NAMES = frozenset(name for name in dir(Conditions) if isinstance(getattr(Conditions, name), property)).union(
    field.name for field in dataclasses.fields(Conditions)
)
"""What :attr:`Effect.needs` may ask for: everything that rows have, measured or worked out."""
LIBRARY: tuple[type[Effect], ...] = (
    DriveZeroOffset,
    DriveScale,
    DriveCyclic,
    DriveBacklash,
    JointCentreOffset,
    JointAxisTilt,
    LegThermalExpansion,
    PlatformThermalExpansion,
    LegCompliance,
    TiltDriveCompliance,
    TrussDeflection,
    BaseDrift,
    TiltEncoderEccentricity,
    MetrologyScale,
)
"""The library's own effects, in the order they are listed."""


def all_effects() -> dict[str, Effect]:
    """Return the library's effects and those of installed packages, by id.

    Raises:
        BadInputError: a package's effect cannot be loaded, is none, or has the id of another one.
    """
    found: dict[str, Effect] = {kind.id: kind() for kind in LIBRARY}
    for entry in entry_points(group=GROUP):
        try:
            kind = entry.load()
            effect = kind()
        except Exception as problem:  # any package may fail in any way; the user must learn which one
            said = " ".join(str(problem).split()) or type(problem).__name__
            raise BadInputError(f"the effect '{entry.name}' of {entry.value} cannot be loaded: {said}") from problem
        if not isinstance(effect, Effect):
            raise BadInputError(f"'{entry.value}' is offered as an effect but is no subclass of Effect")
        for name in ("id", "story"):
            if not isinstance(getattr(effect, name, None), str):
                raise BadInputError(f"the effect '{entry.name}' of {entry.value} has no {name}; give its class one")
        # Of a bare string each letter is asked for, and none of them is a condition.
        asked = [("needs", name, CONDITION_NAMES) for name in effect.needs]
        if effect.driven_by:
            asked.append(("is driven by", effect.driven_by, frozenset(FACTS)))
        for verb, name, known in asked:
            if name not in known:
                said = f"the effect '{effect.id}' of {entry.value} {verb} '{name}', which is no condition"
                raise BadInputError(f"{said}{closest(name, known)}")
        if effect.id in found:
            raise BadInputError(f"two effects are called '{effect.id}'; rename the one of {entry.value}")
        found[effect.id] = effect
    return found


def chosen_effects(exclude: Sequence[str] = ()) -> dict[str, Effect]:
    """Return all effects but some.

    Raises:
        BadInputError: an effect to leave out does not exist.
    """
    found = all_effects()
    for name in exclude:
        if name not in found:
            raise BadInputError(f"there is no effect '{name}'{closest(name, found)}")
    return {name: effect for name, effect in found.items() if name not in exclude}
