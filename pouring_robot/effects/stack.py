"""The effects that a model file has: what they change, row by row, under given conditions."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace

import numpy as np

from pouring_robot.effects.base import EffectParameter
from pouring_robot.effects.conditions import Conditions
from pouring_robot.effects.facts import sources
from pouring_robot.effects.registry import all_effects
from pouring_robot.exceptions import BadInputError, MissingConditionsError, closest
from pouring_robot.mechanism.arrays import FloatArray
from pouring_robot.robot.effect_stack import LearnedCampaign
from pouring_robot.robot.model import RobotModel


def stack_of(
    model: RobotModel,
    given: Collection[str],
    conditions: Callable[[LearnedCampaign | None], Conditions],
    *,
    seen: bool = True,
) -> tuple[list[tuple[EffectParameter, float]], tuple[str, ...]]:
    """Return what of a model depends on conditions, not being placed: parameters, each with its value in its unit.

    Beside them, a line each, the effects taken as none in some rows because nobody learned them there. ``given`` are
    the headings of all conditions that are known, in inner units; ``conditions`` gives those of the rows, as shapes
    that were learned in a campaign count them. ``seen``: with what does not move the robot but what is seen of it.

    Raises:
        MissingConditionsError: an effect needs one that is not given.
        BadInputError: an effect, a form or a parameter is unknown, or in another unit.
    """
    found, untold = list[tuple[EffectParameter, float]](), dict[str, None]()
    known, counted = all_effects(model.definition), dict[str, Conditions]()
    for entry in model.effects:
        if entry.placed:
            continue
        effect = known.get(entry.effect)
        if effect is None:
            raise BadInputError(f"the model has an effect '{entry.effect}'{closest(entry.effect, known)}")
        if not (effect.moves_robot or seen):
            continue
        learned = model.learned.get(entry.learned)
        if entry.learned not in counted:
            counted[entry.learned] = conditions(learned)
        rows = counted[entry.learned]
        missing = sources(effect.missing(rows), model.definition)
        lost = [heading for heading in learned.ranges if heading not in given] if learned else []
        missing += tuple(heading for heading in sources(effect.shaped_by, model.definition) if heading in lost)
        if missing:  # facts of the machine, which have a dot, stand in the model with the campaign
            raise MissingConditionsError(entry.effect, [h for h in missing if not learned or "." not in h] or missing)
        form = {p.name: p for p in effect.form(entry.form, rows).parameters}
        for name, parameter in entry.parameters.items():
            if name not in form and lost:
                raise MissingConditionsError(entry.effect, lost)
            if name not in form:
                said = f"the model's effect '{entry.effect}' in the form '{entry.form}' has no parameter '{name}'"
                raise BadInputError(f"{said} under the conditions of this campaign{closest(name, form)}")
            if parameter.unit != form[name].unit:
                said = f"the model's '{name}' of '{entry.effect}' is in '{parameter.unit}'"
                raise BadInputError(f"{said}; it must be in '{form[name].unit}'")
            if parameter.value and not _is_known(form[name]):
                some = replace(rows, session=np.full_like(rows.session, -1))
                by_session = _is_known({p.name: p for p in effect.form(entry.form, some).parameters}[name])
                raise MissingConditionsError(entry.effect, ("session" if by_session else "time_s",))
            found.append((form[name], parameter.value))
        for part, count in effect.untold(rows).items():
            where = f"{count} of {len(rows)} rows" if len(rows) > 1 else "this pose"
            untold[f"{entry.effect} of {part} was not learned at the angles of {where}: taken as none there"] = None
    return found, tuple(untold)


def _is_known(parameter: EffectParameter) -> bool:
    return all(np.isfinite(change).all() for change in parameter.changes.values())


def local_changes(parameters: Sequence[EffectParameter], values: Sequence[float]) -> dict[str, FloatArray]:
    """Return the change of local parameters that effects make together in n rows, (n,) each, in m and rad, by name.

    The ``values`` are one a parameter, in its unit.
    """
    total: dict[str, FloatArray] = {}
    for parameter, value in zip(parameters, values, strict=True):
        if value:
            for name, change in parameter.changes.items():
                total[name] = total.get(name, 0.0) + value * change
    return total
