"""What a model file's effects do: changes of local parameters in the rows of a campaign, or of commands.

What the file may hold is in :mod:`pouring_robot.robot.effect_stack`; which effects there are, in
:mod:`pouring_robot.effects.available`.
"""

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace

import numpy as np

from pouring_robot.batch.structure import Structure
from pouring_robot.campaign.columns import approach_names
from pouring_robot.campaign.data import Campaign
from pouring_robot.effects.available import all_effects
from pouring_robot.effects.base import Effect, EffectParameter
from pouring_robot.effects.condition_facts import sources
from pouring_robot.effects.conditions import (
    FORCE,
    LOAD,
    RISE,
    Conditions,
    conditions_of,
    force_headings,
    forces_measured,
    recorded,
)
from pouring_robot.effects.missing_cells import CAME_FROM, rows_without
from pouring_robot.effects.nominal_rows import NominalRows
from pouring_robot.estimation.changes import RowChanges
from pouring_robot.exceptions import BadInputError, DataError, MissingConditionsError, closest
from pouring_robot.mechanism.arrays import FloatArray, Indices
from pouring_robot.robot.description.definition import RobotDefinition
from pouring_robot.robot.effect_stack import EffectEntry, LearnedCampaign
from pouring_robot.robot.model import RobotModel


def stack_of(
    model: RobotModel,
    campaign: Campaign,
    nominal: NominalRows,
    conditions: Callable[[Campaign, NominalRows, LearnedCampaign | None], Conditions] = conditions_of,
    *,
    seen: bool = True,
) -> tuple[dict[str, FloatArray], tuple[str, ...]]:
    """Return the :func:`local_changes` by those effects of a model that depend on conditions, not being placed.

    Also return, a line each, the effects taken as zero in some rows because they were not learned there. All rows are
    usable, and ``nominal`` are the same by the drawing; ``conditions`` returns their conditions, relative to the
    campaign in which shapes were learned. ``seen``: with effects that move only what is measured, not the robot.

    Raises:
        MissingConditionsError: effects need conditions that are not given.
        BadInputError: an effect, a form or a parameter is unknown, in another unit, or known by the order of rows only.
    """
    parameters, values, not_learned = list[EffectParameter](), list[float](), dict[str, None]()
    known, counted, lacking = all_effects(model.definition), dict[str, Conditions](), list[MissingConditionsError]()
    for entry in model.effects:
        if entry.placed:
            continue
        effect = known.get(entry.effect)
        if effect is None:
            raise model.fault(f"the model has an effect '{entry.effect}'{closest(entry.effect, known)}")
        if not (effect.moves_robot or seen):
            continue
        if entry.learned not in counted:
            counted[entry.learned] = conditions(campaign, nominal, model.learned.get(entry.learned))
        rows = counted[entry.learned]
        try:
            parameters += _parameters_of(model, entry, effect, rows, campaign)
        except MissingConditionsError as problem:
            lacking.append(problem)
            continue
        values += [parameter.value for parameter in entry.parameters.values()]
        for part, count in effect.rows_not_learned(rows, entry.form).items():
            where = f"{count} of {len(rows)} rows" if len(rows) > 1 else "this pose"
            not_learned[f"{entry.effect} of {part} was not learned at the angles of {where}: taken as zero there"] = (
                None
            )
    if lacking:
        raise _together(lacking)
    return local_changes(parameters, values), tuple(not_learned)


def _parameters_of(
    model: RobotModel, entry: EffectEntry, effect: Effect, rows: Conditions, campaign: Campaign
) -> list[EffectParameter]:
    """Return the parameters of an entry with what they change in rows, in its order."""
    learned, given = model.learned.get(entry.learned), recorded(campaign)
    lost = [heading for heading in learned.ranges if heading not in given] if learned else []
    also, instead = _also_needed(effect, model.definition, given, lost)
    missing = tuple(dict.fromkeys((*sources(effect.missing(rows), model.definition), *also)))
    warmed = effect.driven_by.endswith(RISE)
    thermometers = tuple(heading for heading in lost if warmed and heading.endswith("_degC"))
    if thermometers and missing and not {*missing} & {*lost}:
        missing = thermometers  # any would have done where it was learned: those of that campaign
    if missing:  # facts about the machine, which have a dot, are in the model, with the campaign
        needed = [h for h in missing if not learned or "." not in h] or missing
        raise _lacking(model, entry, needed, instead)
    try:
        form = {p.name: p for p in effect.form(entry.form, rows).parameters}
    except BadInputError as problem:
        if thermometers:  # a form is by all those of its campaign
            raise MissingConditionsError(entry.effect, thermometers) from problem
        raise model.fault(str(problem)) from problem
    for name, parameter in entry.parameters.items():
        if name not in form and (needed := _sides_of(name, effect, entry, rows, campaign) or lost):
            raise MissingConditionsError(entry.effect, needed)
        if name not in form:
            said = f"the model's effect '{entry.effect}' in the form '{entry.form}' has no parameter '{name}'"
            raise model.fault(f"{said} under the conditions of this campaign{closest(name, form)}")
        if parameter.unit != form[name].unit:
            said = f"the model's '{name}' of '{entry.effect}' is in '{parameter.unit}'"
            raise model.fault(f"{said}; it must be in '{form[name].unit}'")
        if parameter.value and not _is_known(form[name]):
            some = replace(rows, session=np.full_like(rows.session, -1))
            by_session = _is_known({p.name: p for p in effect.form(entry.form, some).parameters}[name])
            raise _lacking(model, entry, ("session" if by_session else "time_s",))
    return [form[name] for name in entry.parameters]


def _together(lacking: Sequence[MissingConditionsError]) -> MissingConditionsError:
    """Return the one error for all effects that need more; what replaces the load must replace it for all of them."""
    effects = dict.fromkeys(problem.effect for problem in lacking)
    headings = dict.fromkeys(heading for problem in lacking for heading in problem.headings)
    instead = min((problem.instead for problem in lacking if LOAD in problem.headings), key=len, default=())
    return MissingConditionsError(next(iter(effects)), [*headings], instead, [*effects][1:])


def _lacking(
    model: RobotModel, entry: EffectEntry, headings: Sequence[str], instead: Sequence[str] = ()
) -> BadInputError:
    """Return the error for an effect that needs more; no time helps one that was learned by the order of rows."""
    if [*headings] != ["time_s"] or not entry.learned or model.learned[entry.learned].timed:
        return MissingConditionsError(entry.effect, headings, instead)
    said = f"the model's effect '{entry.effect}' was learned in a campaign without times, so it is unknown"
    return model.fault(f"{said} what it does elsewhere; remove it")


def _sides_of(parameter: str, effect: Effect, entry: EffectEntry, rows: Conditions, campaign: Campaign) -> list[str]:
    """Return the headings of sides of approach that are not given, if with them a form would have a parameter."""
    every = replace(rows, approach=np.ones(rows.drives.shape))
    if parameter not in {p.name for p in effect.form(entry.form, every).parameters}:
        return []
    return [name for name in approach_names(campaign.robot) if campaign.command(name) is None]


def changes_by_stack(
    model: RobotModel,
    campaign: Campaign,
    nominal: NominalRows,
    structure: Structure,
    refusal: Callable[[str, str], DataError],
) -> tuple[RowChanges, tuple[str, ...]]:
    """Return what a model's effects change in the rows of a campaign.

    As :func:`stack_of`, but a condition that the campaign does not state raises a ``refusal``.
    """
    try:
        local, not_learned = stack_of(model, campaign, nominal)
    except MissingConditionsError as problem:
        raise refusal(
            f"{problem.problem}, and the campaign does not give it",
            "add it to the campaign, or remove the effect from the model file",
        ) from problem
    return RowChanges.of(local, structure, len(campaign)), not_learned


def rows_lacking_conditions(model: RobotModel, campaign: Campaign) -> dict[str, Indices]:
    """Return :func:`rows_without`, of conditions on which the effects of a model depend, by heading."""
    if not model.conditional:
        return {}
    robot, known = model.definition, all_effects(model.definition)
    effects = [known[name] for name in model.conditional if name in known]
    by = {heading for effect in effects for heading in sources((*effect.needs, *effect.shaped_by), robot)}
    if by.intersection(approach_names(robot)):
        by.add(CAME_FROM)
    if any(map(_depends_on_forces, effects)):
        by.add(LOAD)
    return {heading: rows for heading, rows in rows_without(campaign).items() if heading in by}


def _also_needed(
    effect: Effect, robot: RobotDefinition, given: Collection[str], lost: Collection[str]
) -> tuple[list[str], list[str]]:
    """Return those lost headings that an effect depends on though it can be computed without; forces for the load.

    The links' own weight alone puts forces on drives: so the load is required, or all forces that were measured.
    """
    shaped = [heading for heading in sources(effect.shaped_by, robot) if heading in lost and heading != LOAD]
    forces = [heading for heading in force_headings(robot) if heading in lost]
    known = LOAD in given or forces_measured(robot, given) or not (forces or LOAD in lost)
    if known or not _depends_on_forces(effect):
        return shaped, []
    return [*shaped, LOAD], forces if LOAD not in lost or forces_measured(robot, {*given, *forces}) else []


def _depends_on_forces(effect: Effect) -> bool:
    """Return whether an effect depends on the forces on drives, which the load changes."""
    return "weight_n" in effect.shaped_by or any(need.endswith(FORCE) for need in effect.needs)


def learned_ranges(effect: Effect, learned: LearnedCampaign, robot: RobotDefinition) -> dict[str, tuple[float, float]]:
    """Return the ranges over which an effect was learned in a campaign, by heading, in inner units.

    Where it depends on computed forces, a load that the campaign did not state was taken to be zero.
    """
    worked_out = robot.own_weight and not forces_measured(robot, learned.ranges)
    assumed = {LOAD: (0.0, 0.0)} if learned.ranges and worked_out and _depends_on_forces(effect) else {}
    return assumed | learned.ranges


def _is_known(parameter: EffectParameter) -> bool:
    return all(np.isfinite(change).all() for change in parameter.changes.values())


def local_changes(parameters: Sequence[EffectParameter], values: Sequence[float]) -> dict[str, FloatArray]:
    """Return the change of local parameters that effects make together in n rows, (n,) each, in m and rad, by name.

    ``values`` has one for each parameter, in its unit.
    """
    total: dict[str, FloatArray] = {}
    for parameter, value in zip(parameters, values, strict=True):
        if value:
            for name, change in parameter.changes.items():
                total[name] = total.get(name, 0.0) + value * change
    return total
