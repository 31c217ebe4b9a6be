"""In words: which measurement tells two effects apart, and what to record so that an effect can be tested at all."""

from collections.abc import Mapping

from pouring_robot.effects.base import Effect
from pouring_robot.effects.conditions import Conditions
from pouring_robot.effects.facts import facts_of, held_still
from pouring_robot.robot.description.definition import RobotDefinition

_OPEN = "measure where the two predict most apart: the poses listed"


def separating_words(first: str, second: str, effects: Mapping[str, Effect], conditions: Conditions) -> str:
    """Return how to tell two explanations apart: by what the campaign held still, else by what differs.

    Args:
        first: id of an effect, or any other explanation.
        second: the same.
        effects: all there are, by id.
        conditions: of the campaign.
    """
    both = [effects[name] for name in (first, second) if name in effects]
    ways = [(effect.driver, effect.separation(conditions)) for effect in both]
    known = [(driver, how) for driver, how in ways if how]
    still = [how for driver, how in known if held_still(driver, conditions)]
    free = [how for driver, how in known if not facts_of(driver, conditions.robot).by_pose]
    chosen = still or free or [how for _, how in known]
    return "; ".join(dict.fromkeys(chosen)) or _OPEN


def untestable_words(untestable: Mapping[str, tuple[str, ...]], robot: RobotDefinition) -> tuple[str, ...]:
    """Return what to record so that effects can be tested, one line each.

    Args:
        untestable: effects with the conditions that the campaign lacks.
        robot: of the drawing.
    """
    lines: dict[str, list[str]] = {}
    for effect, lacking in untestable.items():
        for name in lacking:
            lines.setdefault(facts_of(name, robot).record or name, []).append(effect)
    return tuple(f"record {what}: without it {', '.join(effects)} cannot be tested" for what, effects in lines.items())
