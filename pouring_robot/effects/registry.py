"""Which effects there are: those of a robot's causes and those that installed packages offer.

A package offers effects in its ``pyproject.toml``; the name does not matter, the value is a class:

    [project.entry-points."pouring_robot.effects"]
    screw_wear = "my_package.effects:ScrewWear"
"""

from collections.abc import Sequence
from importlib.metadata import entry_points

from pouring_robot.effects.base import Effect
from pouring_robot.effects.conditions import condition_names
from pouring_robot.effects.facts import known_facts
from pouring_robot.effects.families.base import Family
from pouring_robot.effects.families.drives import LostMotion, Periodic, Scale, Zero
from pouring_robot.effects.families.heat import DriveGrowth, LinkGrowth, LinksGrowth
from pouring_robot.effects.families.joints import Centres, Placement, Tilts
from pouring_robot.effects.families.loads import Deflection, Spring, Stretch
from pouring_robot.effects.families.surroundings import BaseDrift, MetrologyScale, SessionOffset
from pouring_robot.effects.robot_causes import causes_of
from pouring_robot.exceptions import BadInputError, closest
from pouring_robot.robot.description.definition import RobotDefinition
from pouring_robot.robot.model import RobotModel

GROUP = "pouring_robot.effects"
FAMILIES: dict[str, type[Family]] = {
    "zero": Zero,
    "scale": Scale,
    "periodic": Periodic,
    "lost_motion": LostMotion,
    "centres": Centres,
    "tilts": Tilts,
    "placement": Placement,
    "drive_growth": DriveGrowth,
    "link_growth": LinkGrowth,
    "links_growth": LinksGrowth,
    "stretch": Stretch,
    "spring": Spring,
    "deflection": Deflection,
    "base_drift": BaseDrift,
    "metrology_scale": MetrologyScale,
    "session_offset": SessionOffset,
}
"""By the name that a robot's causes have for them."""


def library(robot: RobotDefinition) -> tuple[Effect, ...]:
    """Return the effects that a robot's causes make, in the order they are listed."""
    known, effects = {drive.joint: drive for drive in robot.drives}, []
    for entry in causes_of(robot).entries:
        drives = tuple(known[joint] for joint in entry.options.get("drives", ()))
        effects.append(FAMILIES[entry.family](entry.id, entry.story, **{**entry.options, "drives": drives}))
    return tuple(effects)


def all_effects(robot: RobotDefinition | None = None) -> dict[str, Effect]:
    """Return the library's effects and those of installed packages, by id, by default for the default drawing.

    Raises BadInputError if a package's effect cannot be loaded, is none, or has the id of another one.
    """
    robot = robot or RobotModel().definition
    found: dict[str, Effect] = {effect.id: effect for effect in library(robot)}
    for entry in entry_points(group=GROUP):
        try:
            effect = entry.load()()
        except Exception as problem:  # any package may fail in any way; the user must learn which one
            said = " ".join(str(problem).split()) or type(problem).__name__
            raise BadInputError(f"the effect '{entry.name}' of {entry.value} cannot be loaded: {said}") from problem
        if not isinstance(effect, Effect):
            raise BadInputError(f"'{entry.value}' is offered as an effect but is no subclass of Effect")
        for name in ("id", "story"):
            if not isinstance(getattr(effect, name, None), str):
                raise BadInputError(f"the effect '{entry.name}' of {entry.value} has no {name}; give its class one")
        # Of a bare string each letter is asked for, and none of them is a condition.
        asked = [("needs", name, condition_names(robot)) for name in effect.needs]
        if effect.driven_by:
            asked.append(("is driven by", effect.driven_by, frozenset(known_facts(robot))))
        for verb, name, known in asked:
            if name not in known:
                said = f"the effect '{effect.id}' of {entry.value} {verb} '{name}', which is no condition"
                raise BadInputError(f"{said}{closest(name, known)}")
        if effect.id in found:
            raise BadInputError(f"two effects are called '{effect.id}'; rename the one of {entry.value}")
        found[effect.id] = effect
    return found


def chosen_effects(robot: RobotDefinition | None = None, exclude: Sequence[str] = ()) -> dict[str, Effect]:
    """Return all effects but some; raises BadInputError if an effect to leave out does not exist."""
    found = all_effects(robot)
    for name in exclude:
        if name not in found:
            raise BadInputError(f"there is no effect '{name}'{closest(name, found)}")
    return {name: effect for name, effect in found.items() if name not in exclude}
