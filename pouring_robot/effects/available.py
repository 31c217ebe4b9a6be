"""Which effects are available: those of a robot's causes, and those that packages offer.

Within this package an effect belongs to a family (:data:`FAMILIES`). Another package offers effects in its
``pyproject.toml``; the name of the entry does not matter, its value is a class:

    [project.entry-points."pouring_robot.effects"]
    screw_wear = "my_package.effects:ScrewWear"
"""

import functools
import sys
import traceback
from collections.abc import Callable, Iterable, Sequence
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path

from pouring_robot.effects.base import Effect, Family, not_for
from pouring_robot.effects.condition_facts import known_facts
from pouring_robot.effects.conditions import condition_names
from pouring_robot.effects.default_causes import causes_of
from pouring_robot.effects.families.drives import Backlash, Coupling, DriveScale, Periodic, Ratio, ZeroOffset
from pouring_robot.effects.families.growth import DriveGrowth, LinkGrowth, LinksGrowth
from pouring_robot.effects.families.joints import AxisTilts, JointCentres, Placement
from pouring_robot.effects.families.loads import AxialCompliance, BeamDeflection, BearingCompliance, TorsionalCompliance
from pouring_robot.effects.families.surroundings import BaseDrift, MetrologyScale, SessionOffset
from pouring_robot.exceptions import BadInputError, closest
from pouring_robot.io.argument_checks import as_tuple, expect
from pouring_robot.robot.description.definition import RobotDefinition
from pouring_robot.robot.robot import AnyRobot, definition_of

GROUP = "pouring_robot.effects"
FAMILIES: dict[str, type[Family]] = {  # by the name that causes use; a new one is a class in `families/`
    "zero": ZeroOffset,
    "scale": DriveScale,
    "ratio": Ratio,
    "coupling": Coupling,
    "periodic": Periodic,
    "lost_motion": Backlash,
    "centres": JointCentres,
    "tilts": AxisTilts,
    "placement": Placement,
    "drive_growth": DriveGrowth,
    "link_growth": LinkGrowth,
    "links_growth": LinksGrowth,
    "stretch": AxialCompliance,
    "spring": TorsionalCompliance,
    "bearing": BearingCompliance,
    "deflection": BeamDeflection,
    "base_drift": BaseDrift,
    "metrology_scale": MetrologyScale,
    "session_offset": SessionOffset,
}


def library(robot: RobotDefinition) -> tuple[Effect, ...]:
    """Return the effects that a robot's causes make, in the order they are listed."""
    known, effects = {drive.joint: drive for drive in robot.drives}, []
    for entry in causes_of(robot).entries:
        drives = tuple(known[joint] for joint in entry.options.get("drives", ()))
        effects.append(FAMILIES[entry.family](entry.id, entry.story, **{**entry.options, "drives": drives}))
    return tuple(effects)


@functools.lru_cache(maxsize=1)  # it reads the entry points of all packages, and one command asks many times
def _offered(ask: Callable[..., Iterable[EntryPoint]], _: tuple[tuple[str, int], ...]) -> tuple[EntryPoint, ...]:
    return tuple(ask(group=GROUP))


def _places() -> tuple[tuple[str, int], ...]:
    """Return the folders where Python looks for packages, and when each last changed, in ns."""
    there = (Path(folder).absolute() for folder in sys.path)
    return tuple((str(folder), folder.stat().st_mtime_ns) for folder in there if folder.exists())


def all_effects(robot: AnyRobot = None) -> dict[str, Effect]:
    """Return the library's effects and those of installed packages for a robot, by id; by default the default drawing.

    Raises BadInputError if a package's effect cannot be loaded, is no effect, or has the id of another one.
    """
    robot = definition_of(robot)
    found: dict[str, Effect] = {effect.id: effect for effect in library(robot)}
    for entry in _offered(entry_points, _places()):
        try:
            effect = entry.load()()
        except Exception as problem:  # any package may fail in any way; the user must learn which one
            said = " ".join(str(problem).split()) or type(problem).__name__
            raise BadInputError(f"the effect '{entry.name}' of {entry.value} cannot be loaded: {said}") from problem
        if not isinstance(effect, Effect):
            raise BadInputError(f"'{entry.value}' is offered as an effect but is not a subclass of Effect")
        for name in ("id", "story"):
            if not isinstance(getattr(effect, name, None), str):
                raise BadInputError(f"the effect '{entry.name}' of {entry.value} has no {name}; give its class one")
        for names in ("robots", "needs", "shaped_by"):
            if isinstance(bare := getattr(effect, names), str):
                said = f"the effect '{effect.id}' of {entry.value} has the bare text '{bare}' for {names}"
                raise BadInputError(f"{said}; write {names} = ('{bare}',)")
        if effect.robots and robot.name not in effect.robots:
            continue
        needed = {"needs": effect.needs, "is shaped by": effect.shaped_by}
        asked = [(verb, name, condition_names(robot)) for verb, names in needed.items() for name in names]
        if effect.driven_by:
            asked.append(("is driven by", effect.driven_by, frozenset(known_facts(robot))))
        for verb, name, known in asked:
            if name not in known:
                said = f"the effect '{effect.id}' of {entry.value} {verb} '{name}', which is not a condition"
                raise BadInputError(f"{said}{closest(name, known)}; {not_for(robot)}")
        if effect.id in found:
            raise BadInputError(f"two effects are called '{effect.id}'; rename the one of {entry.value}")
        found[effect.id] = effect
    return found


def failed_effect(problem: BaseException) -> str:
    """Return which effect of another package an error was raised in, and where, in words; "" if in none.

    Of several in one file it may be any.
    """
    offered = _offered(entry_points, _places())
    for frame in reversed(traceback.extract_tb(problem.__traceback__)):
        here = [e for e in offered if getattr(sys.modules.get(e.module), "__file__", None) == frame.filename]
        if names := " or ".join(f"'{entry.name}'" for entry in here):
            return f"the effect {names} ({frame.filename}, line {frame.lineno})"
    return ""


def chosen_effects(robot: AnyRobot = None, exclude: str | Sequence[str] = ()) -> dict[str, Effect]:
    """Return all effects but some; raises BadInputError if an effect to leave out does not exist."""
    found, exclude = all_effects(robot), as_tuple(exclude)
    for name in exclude:
        expect(name, str, "an effect is excluded by its name")
        if name not in found:
            raise BadInputError(f"there is no effect '{name}'{closest(name, found)}")
    return {name: effect for name, effect in found.items() if name not in exclude}
